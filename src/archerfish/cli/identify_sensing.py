"""`archerfish identify sensing`: camera and link of a robot, from two short recordings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.identification.sensing.identify import identify_sensing
from archerfish.logs.timing import Frame

_File = Annotated[Path | None, shown("FILE")]


@dataclass(frozen=True)
class IdentifySensing(Writes):
    """Identify camera and link from a yaw sweep before a plate at rest, and from steps.

    - estimates the camera's rate, latency, time offset to the gimbal, noise and misses, and the delay from command to
      motion, with 95 % intervals; what the logs can't separate is a sum, or left out with what to record
    - writes sensing.json (the record), sensing.html (what is known, what is in doubt, what to do next) and run.json

    Logs are CSV: of the gimbal time_s, yaw, and if logged pitch, yaw_command; of detections time_s, x, y, z, and if
    logged receive_s; of moments time_s; of messages sent_s, received_s.

    Examples:
      archerfish identify sensing sweep.csv --detections plate.csv --out my-robot
      archerfish identify sensing sweep.csv --detections plate.csv --steps steps.csv --target target.csv
        --target-steps moments.csv --commands commands.csv
    """

    sweep: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SWEEP")]
    """Log of the gimbal during the sweep."""
    detections: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Of the plate at rest."""
    steps: Annotated[tuple[Path, ...], shown("FILE…")] = ()
    """Further logs of the gimbal, with steps of the command."""
    target: _File = None
    """Detections of a target that steps, the gimbal at rest."""
    target_steps: _File = None
    """Moments at which it was halfway through its steps, by the clock of receipts."""
    commands: _File = None
    """When commands were sent and received, if the gimbal stamps them."""
    feedback: _File = None
    """When the gimbal's feedback was sent and received, if the gimbal stamps it."""
    frame: Frame = "camera"
    """Of positions: camera (x forward, y left, z up), optical (x right, y down, z forward), or base, which takes the
    angles that rotated each detection, rotated_yaw and rotated_pitch."""
    degrees: Annotated[bool, shown()] = False
    """Angles are in degrees, not radians."""
    gimbal_clock: Literal["receipt", "own"] = "receipt"
    """Who stamped the gimbal's logs: the program on receipt, or the gimbal by a clock of its own."""
    max_offset_s: Annotated[float | None, shown("SECONDS")] = None
    """Largest time offset that is searched; 1 s where the clocks overlap, else any, if not given."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/identify")
    """Folder for the record and its page."""

    def run(self, options: str = "") -> Ending:
        """Identify, write; `options` are as typed, for run.json."""
        logs = {name: each for name, each in vars(self).items() if name not in ("out", "overwrite")}
        given = (self.sweep, self.detections, *self.steps, self.target, self.target_steps, self.commands, self.feedback)
        with self.written(self.out, "identify sensing", options, given, ("sensing.json", "sensing.html")) as folder:
            result = identify_sensing(**logs)
            result.save(folder)
        then = f"archerfish train {self.out}, once its folder has both axes (archerfish identify axis)"
        return Ending(f"{result}", f"open {self.out / 'sensing.html'}", then)

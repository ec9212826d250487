"""`archerfish2 excite`: the commands that identify an axis, and what their logs would give."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from archerfish2 import storage
from archerfish2.identification.excitation.excite import excite
from archerfish2.identification.excitation.plan import ExcitationSettings, Kind
from archerfish2.paper.gimbal import gate_limits
from archerfish2.records.json_files import plain, write_json
from archerfish2.records.limits import LimitsRecord
from archerfish2.records.plant import PlantRecord


@dataclass(frozen=True)
class Excite:
    """Write the commands to play to an axis for its identification, and predict what their logs will give.

    - AXIS_KIND.csv for each signal, with the columns time_s, u (the commanded angle in radians) and expected (what the
      assumed axis makes of it, with noise), and AXIS_KIND_validation.csv, another one to be held back
    - AXIS_excitation.html (tables and figures), AXIS_excitation.json and run.json
    - a command begins and ends at rest at the centre, and is as large as the limits allow, or as asked; the amplitude
      falls with frequency where rate or acceleration would pass the limits
    - the prediction is the identification itself, on the logs that --plant, or an axis of second order, would give

    Examples:
      archerfish2 excite pitch --limits my-robot/limits.json --out runs/excite
      archerfish2 excite yaw --kinds multisine step --amplitude-deg 1
    """

    axis: Annotated[Literal["pitch", "yaw"], tyro.conf.Positional]
    """Whose limits are taken."""
    kinds: tuple[Kind, ...] = ("sweep", "step")
    """Signals, each a log of its own."""
    no_validation: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Do without the commands that are held back."""
    duration_s: float = 10.0
    """Length of sweep, multisine and PRBS."""
    low_hz: float = 2.0
    """Lowest frequency."""
    high_hz: float = 50.0
    """Highest frequency."""
    amplitude_deg: float | None = None
    """Largest distance of sweep, multisine and PRBS from the centre; as large as the limits allow if not given."""
    step_deg: float = 3.0
    """Size of the steps."""
    slew_steps: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Keep the steps, too, within the limits of rate and acceleration."""
    centre_deg: float | None = None
    """Angle about which the axis is moved; the middle of its travel if not given."""
    limits: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Limits record of the robot; those of a gimbal of GM6020 motors if not given."""
    plant: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Plant record of the axis, from an earlier identification; else 10 Hz, damping 0.7, delay 5 ms."""
    sample_period_s: float = 1e-3
    """Sampling period of commands and logs, without --plant."""
    noise_deg: float = 0.013
    """Standard deviation of the measured angle's noise; the default is the rounding of an encoder of 8192 counts."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/excite")
    """Folder for what is written."""
    overwrite: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Replace files in that folder that this command did not write."""

    def run(self) -> None:
        """Plan, predict, write, print."""
        names = ("sample_period_s", "duration_s", "low_hz", "high_hz", "slew_steps")
        angles = {"amplitude": self.amplitude_deg, "step": self.step_deg, "centre": self.centre_deg}
        radians: Any = {name: math.radians(degrees) for name, degrees in angles.items() if degrees is not None}
        found = excite(
            self.axis,
            getattr(LimitsRecord.load(self.limits) if self.limits else gate_limits(), self.axis),
            kinds=self.kinds,
            validation=not self.no_validation,
            plant=PlantRecord.load(self.plant) if self.plant else None,
            noise_sd=math.radians(self.noise_deg),
            settings=ExcitationSettings(**{name: getattr(self, name) for name in names}, **radians),
        )
        facts, inputs = {"options": " ".join(sys.argv[2:])}, [each for each in (self.limits, self.plant) if each]
        with storage.output_folder(self.out, f"excite {self.axis}", inputs, self.overwrite, facts) as folder:
            found.save(folder)
            found.report.write_page(folder / f"{self.axis}_excitation.html")
            write_json(folder / f"{self.axis}_excitation.json", plain(found.report.to_dict()))
        print(f"{found.report}\n\nopen {self.out / self.axis}_excitation.html; the commands are beside it")  # noqa: T201

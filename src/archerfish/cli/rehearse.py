"""`archerfish rehearse`: a controller, a wire and a virtual robot through bytes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from archerfish.cli.emulate import read_faults
from archerfish.cli.options import Ending, ForRobot, Writes, shown
from archerfish.errors import one_line
from archerfish.runtime.configuration import FILE, read_config
from archerfish.studies.live_rehearsal import rehearse_live
from archerfish.studies.rehearse import SwingingPlate, rehearse

_LONGEST = 1000  # characters of a text in a record


@dataclass(frozen=True)
class Rehearse(Writes, ForRobot):
    """Shoot with a virtual robot through the bytes of a wire, as a robot's computer does, in virtual time.

    - the computer has ROBOT's records alone; reports and commands are frames of the wire, detections lines of JSON
    - the operator's switch goes on after 1 s; hits count from 1.5 s on, at a plate that swings from side to side
    - the operator switches off for 1 s, 0.5 s after the end of each fault, or of the last one where faults overlap,
      since after some faults the gate asks for that
    - without MuJoCo, or with --virtual identified, the robot is that of ROBOT's records: its plants, camera and muzzle
    - --task and --command-limit give decision period and limits alone; a policy has those of its training
    - ROBOT/deploy.toml has the wire, the controller, its fallback, the camera's place and the gate; the virtual robot
      has its camera there, too, wherever its file has it
    - prints the hit rate, with its 95 % interval from ten seconds' worth of pellets on, what became of the messages,
      and violations of the robot's limits
    - writes rehearsal.json, report.html and run.json

    Wires:
      sp_vision_25  one frame up and one down, angles in radians
      roborts       angles in 0.1°, fire in a frame of its own
      FILE.toml     your own, as those that come with Archerfish are written

    --live is on this computer's clock, as with hardware, and shows what its load costs.

    Examples:
      archerfish rehearse my-robot
      archerfish rehearse my-robot --controller kalman --wire roborts --seconds 60
      archerfish rehearse my-robot --virtual worn --frequency-hz 0.6 --seed 1
    """

    controller: Annotated[str, shown("NAME|FOLDER")] = ""
    """A policy's file or folder, or a name of archerfish evaluate; ROBOT/policy if there is one, or kalman."""
    wire: Annotated[str, shown("NAME|FILE")] = ""
    """What travels between the computer and the robot; that of ROBOT/deploy.toml, or sp_vision_25."""
    virtual: Annotated[str, shown("NAME|FILE", "(default: infantry; without MuJoCo, identified)")] = ""
    """Virtual robot (infantry, worn), its TOML file, or identified for the robot of the records."""
    fault: Annotated[tuple[str, ...], shown("KIND BEGIN END …")] = ()
    """What goes wrong, from when to when [s], as archerfish emulate takes it; hidden 4 6 hides the plate."""
    seconds: int = 20
    """That count."""
    distance_m: float = SwingingPlate().distance_m
    """Of the plate [m]."""
    amplitude_m: float = SwingingPlate().amplitude_m
    """By which it swings to either side [m]."""
    frequency_hz: float = SwingingPlate().frequency_hz
    """At which it swings [Hz]."""
    seed: int = 0
    """Of the robot's noise and of the dispersion."""
    tuning: Annotated[Literal["kept", "start"], shown("kept|start", "(default: kept)")] = "kept"
    """Settings of a classical controller: those that are kept, which are searched for where there are none, or those
    where the search begins."""
    live: bool = False
    """In real time: the robot in a process of its own, at the other end of a pseudo-terminal, and archerfish deploy."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for the result; ROBOT/rehearsal if not given."""

    def run(self, options: str = "") -> Ending:
        """Rehearse, write."""
        robot, task = self.robot_and_task()
        config = read_config(self.folder)
        controller = self.robot_controller(self.controller or config.controller.mode)
        out = self.out or (self.folder / "rehearsal" if self.folder else Path("runs/rehearse"))
        with self.written(out, "rehearse", options, (), ("rehearsal.json", "report.html")) as folder:
            given: dict[str, Any] = {
                "virtual": self.virtual,
                "seconds": self.seconds,
                "seed": self.seed,
                "target": SwingingPlate(self.distance_m, self.amplitude_m, self.frequency_hz),
                "tuning": self.tuning,
                "faults": read_faults(self.fault),
            }
            wires = (self.wire,) if self.wire else config.wires
            if self.live:
                rehearsal = rehearse_live(controller, robot, task, config.replace(wires=wires), **given)
            else:
                rehearsal = rehearse(controller, robot, task, wire=wires, config=config, **given)
            file = self.folder / FILE if self.folder else None
            settings = f"{file}" if file and file.exists() else f"the defaults of {FILE}"
            about = one_line(f"archerfish rehearse {options}; controller {controller}; settings {settings}")
            rehearsal = rehearsal.replace(about=about[:_LONGEST])
            rehearsal.save(folder / "rehearsal.json")
            rehearsal.report.write_page(folder / "report.html")
        return Ending(f"{rehearsal}", f"open {out / 'report.html'}; every count is in {out / 'rehearsal.json'}")

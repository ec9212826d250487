"""`archerfish record`: the logs of a virtual robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from archerfish.cli.options import Ending, shown
from archerfish.virtual_robot.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class RecordRobot:
    """Record the logs of a virtual robot, as a team records those of its own.

    - writes one folder, which archerfish identify reads: sweeps and steps of both axes, shots at plates and at the
      ground, timing of camera and link, limits.json, tape.json, and a copy of the robot's description
    - --parts records some of them alone; all logs of an earlier recording in the folder are removed, those of other
      parts, too: name another folder to keep them

    Robots:
      infantry    a robot in good repair
      worn        the same after a season: more friction, a slower and wider muzzle
      FILE.toml   one of your own (docs/virtual_robot.md)

    Examples:
      archerfish record --out logs
      archerfish record worn --seed 1 --out worn-logs
      archerfish record my-robot.toml --parts yaw timing --out some-logs
    """

    robot: Annotated[tyro.conf.Positional[str], shown("[ROBOT]")] = "infantry"
    """Name of a virtual robot, or its TOML file."""
    parts: Annotated[tuple[Literal["landings", "yaw", "pitch", "timing", "shots"], ...], shown("NAME…")] = ()
    """Of landings, yaw, pitch, timing and shots; all if none are named."""
    seed: int = 0
    """Of the robot's noise and of the dispersion."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for the logs; runs/NAME-logs if not given."""
    overwrite: Annotated[bool, shown()] = False
    """Replace files in that folder that this command did not write."""

    def run(self, _: str = "") -> Ending:
        """Record."""
        robot = VirtualRobot.load(self.robot)
        out = self.out or Path("runs") / f"{robot.name}-logs"
        robot.record(out, seed=self.seed, parts=self.parts, overwrite=self.overwrite)
        count = len([*out.glob("*.csv")])
        logs = "1 log" if count == 1 else f"{count} logs"
        found = f"{robot.name}: {logs}, limits.json and tape.json"
        return Ending(found, f"all is in {out}", f"archerfish identify {out} --out {robot.name}")

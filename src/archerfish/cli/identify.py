"""`archerfish identify`: a robot from the folder of its logs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from archerfish.cli.options import Ending
from archerfish.identification.robot import identify_robot


@dataclass(frozen=True)
class Identify:
    """Identify a robot from the folder of its logs.

    - takes every part that there are logs of; the others are the paper's, and are named
    - identify axis, identify muzzle and identify sensing do one part, from files of any name
    - prints what is known, how sure that is, what is usable, and what to record next
    - writes the robot's records, robot.html with a page for each part, report.json and run.json

    Logs (docs/your_robot.md has their columns; logs.toml in the folder can name others):
      {pitch,yaw}_{sweep,step}[_validation].csv   command and angle of an axis
      {pitch,yaw}_step_{N}deg.csv                 steps of other sizes, for the report
      shots.csv, landings.csv, tape.json          hits on a plate, landing points, lengths
      timing_{sweep,plate,steps,target,moments,commands,reports}.csv   camera and link
      limits.json                                 what may be commanded

    Examples:
      archerfish identify logs --out my-robot
      archerfish train my-robot
    """

    logs: Annotated[Path, tyro.conf.Positional]
    """Folder of the logs."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder of the robot; runs/NAME of the logs' folder if not given."""
    name: Annotated[str, tyro.conf.arg(help_behavior_hint="")] = ""
    """Name of the robot; that of the folder if not given."""
    seed: int = 0
    """Of the draws."""
    overwrite: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = False
    """Replace files in that folder that this command did not write."""

    def run(self, _: str = "") -> Ending:
        """Identify, write."""
        out = self.out or Path("runs") / self.logs.resolve().name
        found = identify_robot(self.logs, out=out, name=self.name, seed=self.seed, overwrite=self.overwrite)
        usable = f"archerfish train {out}"
        then = (
            usable
            if found.report.usable
            else f"record what is asked for above, and identify again; or {usable} --accept-unusable"
        )
        return Ending(f"{found}", f"open {out / 'robot.html'}", then)

"""`archerfish reproduce`: the whole paper, and a page that compares it with ours."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from archerfish.cli.options import Ending, shown
from archerfish.cli.transfer import RunsStudy, ending, finish
from archerfish.studies.reproduce import reproduce
from archerfish.studies.transfer import check_settings
from archerfish.studies.workers import usual_workers
from archerfish.virtual_robot.virtual_robot import VirtualRobot


@dataclass(frozen=True)
class Reproduce(RunsStudy):
    """Reproduce the paper: in simulation, then on a virtual robot.

    - logs the printed gimbal and identifies it (Fig. 4), fits Table I, trains policies (Figs 5 and 6), and evaluates
      them beside classical controllers under three command limits (Tables II and III)
    - takes a virtual robot through archerfish transfer (Tables IV and V)
    - writes report.html (start there), results.json (every figure of it), and what was logged, identified and trained

    Some six minutes on two processor cores. Ctrl-C leaves the folder as it was. docs/paper.md says what is assumed.

    Examples:
      archerfish reproduce
      archerfish reproduce --quick --out runs/quick
      archerfish reproduce --seed 1 --workers 2
    """

    robot: Annotated[str, shown("NAME|FILE")] = "infantry"
    """Virtual robot of Tables IV and V."""
    seed: int = 0
    """Of everything random."""
    engagements: int = 500
    """Per cell of Tables II and III, of 50 shots each."""
    robot_engagements: int = 250
    """Per cell of Tables IV and V."""
    out: Annotated[Path, shown("FOLDER")] = Path("runs/reproduce")
    """Folder for everything."""

    def run(self, options: str = "") -> Ending:
        """Run the study, write."""
        workers = self.workers or usual_workers()
        check_settings((self.seed,), min(self.engagements, self.robot_engagements), workers)
        VirtualRobot.load(self.robot)
        with self.filled(self.out, "reproduce", options, self.robot) as folder:
            study = reproduce(
                folder,
                robot=self.robot,
                seed=self.seed,
                engagements=self.engagements,
                robot_engagements=self.robot_engagements,
                workers=workers,
                quick=self.quick,
            )
            finish(study, folder)
        return ending(study, self.out, "archerfish identify LOGS, with those of your own robot")

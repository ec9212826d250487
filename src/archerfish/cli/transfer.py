"""`archerfish transfer`: from a virtual robot's logs to a policy on that robot."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from archerfish.cli.options import Ending, Writes, shown
from archerfish.studies.study import Study
from archerfish.studies.transfer import check_settings, transfer
from archerfish.studies.workers import usual_workers
from archerfish.virtual_robot.virtual_robot import VirtualRobot


@dataclass(frozen=True, kw_only=True)
class RunsStudy(Writes):
    """What commands take that run a study."""

    quick: Annotated[bool, shown()] = False
    """Short trainings and few engagements, for a first look; the figures are not to be quoted."""
    workers: Annotated[int, shown("N", "(default: one per core, at most 4)")] = 0
    """Processes to use."""

    @contextmanager
    def filled(self, out: Path, command: str, options: str, robot: str) -> Iterator[Path]:
        """Yield a folder to fill, as `written`; a study that is stopped says what is left of it."""
        inputs = [robot] if Path(robot).is_file() else []
        try:
            with self.written(out, command, options, inputs, ("results.json", "report.html")) as folder:
                yield folder
        except KeyboardInterrupt:
            print(f"nothing in {out} has changed; begin again: archerfish {command} {options}", file=sys.stderr)  # noqa: T201
            raise


@dataclass(frozen=True)
class Transfer(RunsStudy):
    """Take a virtual robot from its logs to a policy that shoots with it, and measure what the step costs.

    - records it, identifies it from the logs alone, trains a policy for it and tunes the classical controllers in the
      identified simulator, then evaluates all there and on the robot, in the same engagements
    - writes report.html (start there), results.json, and the folders logs, robot and policies
    - is a script of archerfish record, identify, train and evaluate, with their defaults

    Some five minutes on two processor cores, for each further seed a minute. Ctrl-C leaves the folder as it was.

    Examples:
      archerfish transfer
      archerfish transfer worn --seeds 0 1 2
      archerfish transfer my-robot.toml --quick
    """

    robot: Annotated[tyro.conf.Positional[str], shown("[ROBOT]")] = "infantry"
    """Name of a virtual robot (infantry, worn), or its TOML file (docs/virtual_robot.md)."""
    seeds: tuple[int, ...] = (0,)
    """Of the trainings; the first one also that of noise and engagements."""
    engagements: int = 400
    """Per cell, of 50 shots each."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for everything; runs/transfer-NAME if not given."""

    def run(self, options: str = "") -> Ending:
        """Run the study, write."""
        workers = self.workers or usual_workers()
        check_settings(self.seeds, self.engagements, workers)
        name = VirtualRobot.load(self.robot).name
        out = self.out or Path("runs") / f"transfer-{name}"
        with self.filled(out, "transfer", options, self.robot) as folder:
            study = transfer(
                self.robot,
                folder,
                seeds=self.seeds,
                engagements=self.engagements,
                workers=workers,
                quick=self.quick,
            )
            finish(study, folder)
        robot = out / "robot"
        return ending(study, out, f"archerfish evaluate {robot}; archerfish view {robot}")


def finish(study: Study, folder: Path) -> None:
    """Write a study and its page into a folder, without the locks of what was made in it."""
    study.save(folder / "results.json")
    page = folder / "report.html"
    study.report.linked(page, [folder / "robot" / "robot.html"]).write_page(page)
    for lock in folder.rglob("*.lock"):
        lock.unlink()


def ending(study: Study, out: Path, then: str) -> Ending:
    """Return what is printed of a study in a folder, and what to type next."""
    return Ending(f"{study}", f"open {out / 'report.html'}; every count is in {out / 'results.json'}", then)

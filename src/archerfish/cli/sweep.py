"""`archerfish sweep`: many trainings, compared."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from archerfish.cli.options import Ending, ForRobot, assigned, shown
from archerfish.errors import InputError
from archerfish.studies.sweep import sweep


@dataclass(frozen=True)
class Sweep(ForRobot):
    """Train with many settings and seeds, and compare the hit rates of the policies.

    - writes results.csv and report.html, a folder for each training, the journal of Optuna (study.jsonl), and best, the
      training of the best setting
    - the same command continues a sweep that was ended, also by kill -9, to the same table

    Examples:
      archerfish sweep --seeds 5
      archerfish sweep my-robot --vary gradient.learning_rate=1e-3,3e-3 gradient.hidden=256,512 --seeds 2
      archerfish sweep --vary gradient.learning_rate=3e-4..1e-2:log frames=3,4 --trials 20 --steps 2000000
      archerfish sweep my-robot --seeds 8 --ray local
    """

    vary: Annotated[tuple[str, ...], shown("NAME=VALUES…")] = ()
    """Settings of a training (docs/training.md lists them): V1,V2,…, all combined; or a range LOW..HIGH, with :log by
    its logarithm, of which Optuna proposes values."""
    trials: Annotated[int | None, shown("N", "(needed for a range)")] = None
    """Settings that Optuna proposes; if not given, all combinations of the values."""
    seeds: Annotated[int, shown("N")] = 1
    """Trainings of each setting."""
    steps: Annotated[int | None, shown("N", "(default: as of train)")] = None
    """Decisions of each training."""
    set: Annotated[tuple[str, ...], shown("NAME=VALUE…")] = ()
    """Settings of all trainings, as of archerfish train."""
    engagements: int = 64
    """Per cell of the task, to measure a policy."""
    seed: int = 0
    """Of Optuna's proposals, and of the first training of each setting."""
    batch: int = 4
    """Settings that Optuna proposes at once."""
    workers: Annotated[int | None, shown("N", "(default: one per core, at most 4)")] = None
    """Trainings that run at once."""
    ray: Annotated[str | None, shown("local|HOST:PORT")] = None
    """Run them in a Ray on this machine, or in a cluster's."""
    out: Annotated[Path | None, shown("FOLDER")] = None
    """Folder for everything; ROBOT/sweep, or runs/sweep without a robot."""

    def run(self, options: str = "") -> Ending:
        """Sweep."""
        robot, task = self.robot_and_task()
        out = self.out or (self.folder / "sweep" if self.folder else Path("runs/sweep"))
        vary = dict(text.partition("=")[::2] for text in self.vary)
        if len(vary) < len(self.vary) or not all(vary.values()):
            raise InputError(f"--vary takes NAME=VALUES, each name once, got {' '.join(self.vary)}; correct it")
        try:
            swept = sweep(
                robot,
                task,
                vary=vary,
                out=out,
                trials=self.trials,
                seeds=self.seeds,
                config=assigned(self.set),
                steps=self.steps,
                engagements=self.engagements,
                seed=self.seed,
                batch=self.batch,
                workers=self.workers,
                ray=self.ray,
            )
        except KeyboardInterrupt:
            print(f"what is finished stays in {out}; continue: archerfish sweep {options}", file=sys.stderr)  # noqa: T201
            raise
        best = out / "best"
        where = f"open {out / 'report.html'}; every setting is in {out / 'results.csv'}"
        if not swept.best:
            return Ending(f"{swept}", where)
        words = [str(self.robot)] if self.folder else []
        words += ["--controllers", str(best), "kalman", *(["--task", self.task] if self.task != "any" else [])]
        return Ending(f"{swept}", f"{where}; the best policy is {best}", shlex.join(["archerfish", "evaluate", *words]))

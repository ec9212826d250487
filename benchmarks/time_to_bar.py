"""How long it takes from a cold process to a policy on disk that reaches the paper, in seconds.

`python benchmarks/time_to_bar.py [--against REVISION]` trains as users do, `af.train(..., out=...)`, in the paper's
task under `box` with the observation `history`: the paper's six numbers hold no velocity, and their policies stay below
its PPO column where targets move far away. With as many decisions as are timed, the policies of five other seeds must
reach that column in all eight cells of Tables II and III. Programs are kept between trainings, or compiled in each.
Where the time goes is in training_stages.py. The machine should do nothing else. Writes results/time_to_bar.json.
"""

import functools
import itertools
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import alternating

DECISIONS = {"ppo": 153_600, "gradient": 51_200}
"""Trainer → decisions, which are enough with the seeds that are checked; two thirds of PPO's are too few."""
TIMED, CHECKED = (0, 1, 2), (10, 11, 12, 13, 14)
"""Seeds of the trainings."""
ENGAGEMENTS = 200
NAMES = tuple(f"{trainer}, programs {state}" for trainer in DECISIONS for state in ("kept", "compiled"))
CODE = """import archerfish as af
task, config = af.Task.load("paper").replace(command_limit="box"), af.TrainConfig(observation="history")
af.train(task=task, config=config, trainer=TRAINER, steps=STEPS, seed=SEED, out=OUT)"""


def train(trainer: str, seed: int, out: Path, cache: Path, code: str = CODE) -> str:
    """Train in a process of its own, and return what it prints."""
    given = {"TRAINER": repr(trainer), "STEPS": str(DECISIONS[trainer]), "SEED": str(seed), "OUT": repr(str(out))}
    for name, value in given.items():
        code = code.replace(name, value)
    environment = {**os.environ, "ARCHERFISH_CACHE": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def check(trainer: str, folder: Path, cache: Path) -> None:
    """Train with other seeds than those that are timed.

    Raises:
      SystemExit: if a policy stays below the paper's PPO column in a cell.
    """
    import archerfish as af

    task = af.Task.load("paper").replace(command_limit="box")
    for seed in CHECKED:
        train(trainer, seed, folder / "policy", cache)
        policy = af.Policy.load(folder / "policy")
        cells = af.evaluate({"policy": policy}, task=task, engagements=ENGAGEMENTS, seed=1).cells
        margin = min(100.0 * cell.rate - (cell.paper or 0.0) for cell in cells)
        print(f"{trainer}, seed {seed}: {margin:+.2f} points from the paper", file=sys.stderr, flush=True)
        if margin < 0.0:
            raise SystemExit(f"{DECISIONS[trainer]:,} decisions are too few for {trainer}")


def prepare() -> alternating.Work:
    """Return name → a training, which returns 1."""
    folder, seeds = tempfile.TemporaryDirectory(), itertools.cycle(TIMED)
    kept, checked = Path(folder.name) / "cache", functools.cache(check)

    def with_kept(trainer: str) -> int:
        checked(trainer, Path(folder.name), kept)  # in the first call, which is not timed
        train(trainer, next(seeds), Path(folder.name) / "policy", kept)
        return 1

    def compiling(trainer: str) -> int:
        with tempfile.TemporaryDirectory() as empty:
            train(trainer, next(seeds), Path(folder.name) / "policy", Path(empty))
        return 1

    work: list[Callable[[], int]] = []
    for trainer in DECISIONS:
        work += [functools.partial(with_kept, trainer), functools.partial(compiling, trainer)]
    return dict(zip(NAMES, work, strict=True))


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=3, in_seconds=True)

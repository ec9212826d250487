"""The policy for any target against three trackers, on motions that its training has and on 42 that it has not.

`python benchmarks/unseen_motions.py FOLDER` evaluates the policies FOLDER/any-SEED on tests/infantry, in engagements
of 1 s and of 3 s at four ranges:

- known: the eight kinds of motion of the task `any`;
- eq (7): the task `paper`, targets at rest and moving ones, 1 s alone, beside the policy of FOLDER/tracked-SEED, which
  was trained for it;
- bursts, others: three and fourteen motions of motions.py, which were looked at while the training was developed;
- depth, late: the zigzag in depth, and four other motions, looked at as well;
- ten: ten more, looked at as well;
- second ten: those that were written before the policies of the stored results were trained.

The trackers `kalman`, `kalman-lq` and `imm-lq` have one setting each, tuned for the task `any`. All controllers shoot
at the same targets with the same dispersion. A cell is one motion at one range in engagements of one length. "Less
imm-lq" and "less best" are differences of hit rates in points; the best is the best of the three trackers in each cell
by itself. Writes results/unseen_motions.json, with the seed in its name but for 0, unless there are fewer
than three policies or 100 engagements a cell.
"""

import argparse
import functools
import itertools
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import archerfish as af
import motions
from archerfish.controllers.registry import make_controller
from archerfish.reports.table import Table
from bars import Bar, finish

ROOT = Path(__file__).parents[1]
TRACKERS = ("kalman", "kalman-lq", "imm-lq")
WORKERS = 2
"""Processes that evaluate side by side."""
COLUMNS = ("less_imm", "less_best", "less_special")
GOALS: dict[str, dict[str, tuple[float, float | None]]] = {  # group → column → least mean, least cell
    "known": {"less_imm": (6.2, -1.0)},
    "eq (7), dynamic": {"less_special": (-1.2, None)},
    "bursts": {"less_imm": (-0.6, -3.0)},
    "others": {"less_imm": (7.5, None)},
    "depth": {"less_best": (-1.0, -2.5)},
    "late": {"less_best": (0.5, -2.5)},
    "ten": {"less_best": (2.0, -3.0)},
    "second ten": {"less_best": (2.0, -3.0)},
}


class Part(NamedTuple):
    """What is evaluated at a time."""

    group: str
    name: str  # of the motion; empty where the cells have motions of their own
    task: af.Task


def parts(task: af.Task) -> Iterator[Part]:
    """Yield what is evaluated."""
    yield Part("known", "", task)
    yield Part("eq (7)", "", af.Task.load("paper"))
    groups = {"bursts": motions.BURSTS, "others": motions.OTHERS, "depth": motions.ZIGZAG, "late": motions.LATE}
    groups |= {"ten": motions.TEN, "second ten": motions.SECOND_TEN}
    for group, functions in groups.items():
        for function, length in itertools.product(functions, motions.LENGTHS):
            motion = f"{motions.__file__}:{function.__name__}_{length:g}"
            yield Part(group, function.__name__, task.replace(motion=motion, lengths_s=(length,)))


def rows_of(part: Part, controllers: dict[str, Any], robot: af.Robot, engagements: int, seed: int) -> list[Any]:
    """Return a row per policy and cell: its hit rate, those of the trackers, and the differences."""
    results = af.evaluate(controllers, robot, part.task, engagements=engagements, seed=seed)
    by_place: dict[Any, dict[str, float]] = {}
    for cell in results.cells:
        place = cell.motion, cell.length_s, cell.range_m
        by_place.setdefault(place, {})[cell.controller] = 100.0 * cell.rate
    rows = []
    for (motion, length, range_m), rates in by_place.items():
        trackers = {name: rates[name] for name in TRACKERS}
        for name in (name for name in rates if name.startswith("any-")):
            special = rates.get(name.replace("any", "tracked"), float("nan"))
            group = f"{part.group}, {motion}" if part.group == "eq (7)" else part.group
            rows.append(
                {
                    "group": group,  # of eq (7) with static or dynamic
                    "motion": (part.name or motion).replace("_", " "),
                    "length_s": length,
                    "range_m": str(range_m),
                    "training": int(name.removeprefix("any-")),
                    "policy": rates[name],
                    **trackers,
                    "less_imm": rates[name] - rates["imm-lq"],
                    "less_best": rates[name] - max(trackers.values()),
                    "less_special": rates[name] - special,
                }
            )
    return rows


@functools.cache
def contenders(folder: Path, seeds: int) -> tuple[af.Robot, dict[str, Any], dict[str, Any]]:
    """Return the robot, the policies and trackers, and the policies trained for eq (7)."""
    robot, task = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any")
    trackers = {name: make_controller(name, robot, task, af.tune(name, robot, task)) for name in TRACKERS}
    policies = {f"any-{seed}": af.Policy.load(folder / f"any-{seed}") for seed in range(seeds)}
    special = {f"tracked-{seed}": af.Policy.load(folder / f"tracked-{seed}") for seed in range(seeds)}
    return robot, policies | trackers, special


def evaluated(job: tuple[int, Path, int, int, int]) -> list[Any]:
    """Return the rows of a part."""
    index, folder, seeds, engagements, seed = job
    robot, controllers, special = contenders(folder, seeds)
    part = list(parts(af.Task.load("any")))[index]
    if part.group == "eq (7)":
        controllers = controllers | special
    return rows_of(part, controllers, robot, engagements, seed)


def summary(rows: list[Any], name: str) -> tuple[Any, ...]:
    """Return a row of the table: mean rates, and mean and least difference."""
    rates = [float(np.mean([row[each] for row in rows])) for each in ("policy", *TRACKERS)]
    found: list[Any] = [f"{rate:.1f}" for rate in rates]
    for column in COLUMNS[:2]:
        values = [row[column] for row in rows]
        found.append(f"{np.mean(values):+.2f} ({min(values):+.2f})")
    return name, *found


def bars_of(rows: list[Any]) -> list[Bar]:
    """Return mean and least cell of each group beside the goals, the means of the trainings as well."""
    bars = []
    for group, goals in GOALS.items():
        own = [row for row in rows if row["group"] == group]
        for column, (mean, least) in goals.items() if own else ():
            values, label = [row[column] for row in own], f"{group}, {column.replace('_', ' ')}"
            bars += [Bar(f"{label}, mean", float(np.mean(values)), mean), Bar(f"{label}, least", min(values), least)]
            for training in sorted({row["training"] for row in own}):
                of_one = [row[column] for row in own if row["training"] == training]
                bars.append(Bar(f"{label}, mean of training {training}", float(np.mean(of_one))))
    return bars


def main() -> None:
    """Evaluate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--engagements", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0, help="of the engagements and the dispersion")
    options = parser.parse_args()
    contenders(options.folder, options.seeds)  # tuned once, before two processes would
    count = len(list(parts(af.Task.load("any"))))
    jobs = [(index, options.folder, options.seeds, options.engagements, options.seed) for index in range(count)]
    rows: list[Any] = []
    with ProcessPoolExecutor(WORKERS, mp_context=multiprocessing.get_context("spawn")) as pool:
        for found in pool.map(evaluated, jobs):
            rows += found
            print(*summary(found, f"{found[0]['group']}: {found[0]['motion']}, {found[0]['length_s']:g} s"), flush=True)
    by_name: dict[str, list[Any]] = {}
    for row in rows:
        by_name.setdefault(f"{row['group']}: {row['motion']}, {row['length_s']:g} s", []).append(row)
    header = ("targets", "policy", *TRACKERS, "less imm-lq (least)", "less best (least)")
    lines = tuple(summary(own, name) for name, own in by_name.items())
    table = Table("Hit rates [%] and differences in points", header, lines)
    conditions = {"engagements": options.engagements, "seed": options.seed, "trainings": options.seeds}
    complete = options.engagements >= 100 and options.seeds >= 3
    finish(f"unseen_motions{options.seed or ''}", bars_of(rows), [table], conditions, rows, complete)


if __name__ == "__main__":
    main()

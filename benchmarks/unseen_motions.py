"""The policy for any target against three trackers, on motions that its training has and on 32 that it has not.

`python benchmarks/unseen_motions.py FOLDER` evaluates the policies FOLDER/any-SEED on tests/infantry, in engagements
of 1 s and of 3 s at four ranges:

- known: the eight kinds of motion of the task `any`;
- eq (7): the paper's motion, beside the policy of FOLDER/tracked-SEED, which was trained for it;
- bursts, others: three and fourteen motions of motions.py, which were looked at while the training was developed;
- depth, late: the zigzag in depth, and four other motions, of shared/data beside the clone; skipped where it is absent;
- ten: those of motions.py that were written before these policies were trained, and not looked at before.

The trackers `kalman`, `kalman-lq` and `imm-lq` have one setting each, tuned for the task `any`. All controllers shoot
at the same targets with the same dispersion. A cell is one motion at one range in engagements of one length. "Less
imm-lq" and "less best" are differences of hit rates in points; the best is the best of the three trackers in each cell
by itself. Writes results/unseen_motions.json, unless fewer than 100 engagements a cell are shot.
"""

import argparse
import importlib.util
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

import archerfish as af
import motions
from archerfish.controllers.registry import make_controller
from archerfish.reports.table import Table
from bars import Bar, finish

ROOT = Path(__file__).parents[1]
TRACKERS = ("kalman", "kalman-lq", "imm-lq")
PLACES = [each / "shared" / "data" / "motions_unseen.py" for each in ROOT.parents]
LATE = ("peek", "random_walk", "late_start", "shuffle")
COLUMNS = ("less_imm", "less_best", "less_special")
GOALS: dict[str, dict[str, tuple[float, float | None]]] = {  # group → column → least mean, least cell
    "known": {"less_imm": (6.2, -1.0)},
    "eq (7)": {"less_special": (-1.2, None)},
    "bursts": {"less_imm": (-0.6, -3.0)},
    "others": {"less_imm": (7.5, None)},
    "depth": {"less_best": (-1.0, -2.5)},
    "late": {"less_best": (0.5, -2.5)},
    "ten": {"less_best": (2.0, -3.0)},
}


class Shot(NamedTuple):
    """What is evaluated at a time."""

    group: str
    name: str  # of the motion; empty where the cells have motions of their own
    task: af.Task


def shared_motions() -> ModuleType | None:
    """Return the file of shared/data with five motions, if it is there."""
    if (path := next(filter(Path.is_file, PLACES), None)) is None:
        return None
    spec: Any = importlib.util.spec_from_file_location("motions_unseen", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def of_shared(name: str) -> Any:
    """Return a motion of shared/data as those of motions.py are."""
    names = ("TIMES", "BEGIN_S", "STEP_S", "along", "driven")
    tools = SimpleNamespace(sideways=motions.Draws.sideways, **{each: getattr(motions, each) for each in names})
    return partial(getattr(shared_motions(), name), tools)


# As names of this file, by which a task finds them.
if shared_motions() is not None:
    for _name in ("depth_zigzag", *LATE):
        globals().update({f"{_name}_{_s:g}": motions.motion(of_shared(_name), _s) for _s in motions.LENGTHS})


def shots(task: af.Task) -> Iterator[Shot]:
    """Yield what is evaluated."""
    yield Shot("known", "", task)
    yield Shot("eq (7)", "eq (7)", af.Task.load("paper"))
    made = {"bursts": motions.BURSTS, "others": motions.OTHERS, "ten": motions.TEN}
    named = [(motions.__file__, group, way.__name__) for group, ways in made.items() for way in ways]
    if shared_motions() is None:
        print(f"depth, late: skipped, no {PLACES[0].name} in shared/data beside the clone")
    else:
        named += [(__file__, "depth", "depth_zigzag"), *[(__file__, "late", name) for name in LATE]]
    for file, group, name in named:
        for length in motions.LENGTHS:
            yield Shot(group, name, task.replace(motion=f"{file}:{name}_{length:g}", lengths_s=(length,)))


def cells_of(shot: Shot, controllers: dict[str, Any], robot: af.Robot, engagements: int, seed: int) -> list[Any]:
    """Return a row per policy and cell: its hit rate, those of the trackers, and the differences."""
    results = af.evaluate(controllers, robot, shot.task, engagements=engagements, seed=seed)
    by_place: dict[Any, dict[str, float]] = {}
    for cell in results.cells:
        by_place.setdefault((cell.table, *cell.place), {})[cell.controller] = 100.0 * cell.rate
    rows = []
    for (_, _, motion, length, range_m), rates in by_place.items():
        trackers = {name: rates[name] for name in TRACKERS}
        for name in (name for name in rates if name.startswith("any-")):
            special = rates.get(name.replace("any", "tracked"), float("nan"))
            rows.append(
                {
                    "group": shot.group,
                    "motion": (shot.name or motion).replace("_", " "),
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
    robot, task = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any")
    trackers = {name: make_controller(name, robot, task, af.tune(name, robot, task)) for name in TRACKERS}
    policies = {f"any-{seed}": af.Policy.load(options.folder / f"any-{seed}") for seed in range(options.seeds)}
    special = {f"tracked-{seed}": af.Policy.load(options.folder / f"tracked-{seed}") for seed in range(options.seeds)}
    rows: list[Any] = []
    for shot in shots(task):
        controllers = policies | trackers | (special if shot.group == "eq (7)" else {})
        found = cells_of(shot, controllers, robot, options.engagements, options.seed)
        rows += found
        print(*summary(found, f"{shot.group}: {found[0]['motion']}, {found[0]['length_s']:g} s"), flush=True)
    by_name: dict[str, list[Any]] = {}
    for row in rows:
        by_name.setdefault(f"{row['group']}: {row['motion']}, {row['length_s']:g} s", []).append(row)
    header = ("targets", "policy", *TRACKERS, "less imm-lq (least)", "less best (least)")
    lines = tuple(summary(own, name) for name, own in by_name.items())
    table = Table("Hit rates [%] and differences in points", header, lines)
    conditions = {"engagements": options.engagements, "seed": options.seed, "trainings": options.seeds}
    finish("unseen_motions", bars_of(rows), [table], conditions, rows, options.engagements >= 100)


if __name__ == "__main__":
    main()

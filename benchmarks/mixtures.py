"""What is gained and lost with the mixture of targets that a training for any motion draws from.

`python benchmarks/mixtures.py TRACKED` trains a policy for each of `MIXTURES` on tests/infantry, in a process of its
own, and evaluates it: on moving targets of eq (7), beside the policy TRACKED that was trained for it alone, and on the
eight kinds of motion and the bursts and others of motions.py, beside `imm-lq`. Differences of hit rates in points, in
the same engagements. Trainings are short, 3 million decisions, so all policies are somewhat worse than by default; what
counts is how they differ. One training each: differences below half a point are noise. Draws docs/mixtures.svg and
writes results/mixtures.json, in about a quarter of an hour on two cores.
"""

import argparse
import itertools
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
import motions
from archerfish.controllers.registry import make_controller
from archerfish.reports.style import plot_style
from archerfish.reports.table import Table
from archerfish.targets import mixture, process
from bars import finish

ROOT = Path(__file__).parents[1]
MIXTURES = ((0.0, 19.0), (0.6, 5.0), (0.6, 19.0), (0.6, 40.0))
"""Share of the process's targets that move along two axes, and weight of eq (7) beside 81 of all others."""
TWO_AXES = process.TWO_AXES
"""The default share."""
FIELDS = ("eq (7)", "eight kinds", "bursts", "others")


def trained(job: tuple[float, float, int, int, Path]) -> dict[str, float]:
    """Train and evaluate a policy with a mixture; return its mean differences in points."""
    two_axes, weight, steps, engagements, tracked = job
    process.TWO_AXES = two_axes
    mixture.MIXTURES["any"]["eq 7"] = weight
    robot, task = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any")
    policy = af.train(robot, task, seed=0, steps=steps)
    imm = make_controller("imm-lq", robot, task, af.tune("imm-lq", robot, task))

    def difference(task: af.Task, other: Any) -> float:
        results = af.evaluate({"policy": policy, "other": other}, robot, task, engagements=engagements, seed=2)
        return 100.0 * float(np.mean([cell.difference for cell in results.compare("policy", "other")]))

    def unseen(functions: Any) -> float:
        named = itertools.product(functions, motions.LENGTHS)
        tasks = [
            task.replace(motion=f"{motions.__file__}:{function.__name__}_{length:g}", lengths_s=(length,))
            for function, length in named
        ]
        return float(np.mean([difference(each, imm) for each in tasks]))

    found = (
        difference(af.Task.load("dynamic"), af.Policy.load(tracked)),
        difference(task, imm),
        unseen(motions.BURSTS),
        unseen(motions.OTHERS),
    )
    return {"two_axes": two_axes, "weight": weight, **dict(zip(FIELDS, found, strict=True))}


def draw(rows: list[dict[str, float]]) -> None:
    """Draw eq (7) against the rest."""
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(7.0, 4.0), layout="constrained")
        axes = figure.add_subplot()
        usual = sorted((row for row in rows if row["two_axes"] == TWO_AXES), key=lambda row: row["weight"])
        others = [row for row in rows if row["two_axes"] != TWO_AXES]
        for name, marker in zip(FIELDS[1:], "osD", strict=True):
            places = [row["eq (7)"] for row in usual], [row[name] for row in usual]
            (line,) = axes.plot(*places, "-", marker=marker, label=name)
            for row in others:
                axes.plot(row["eq (7)"], row[name], marker=marker, mfc="none", color=line.get_color(), ls="")
        for row in rows:
            share, weight = row["two_axes"], row["weight"]
            label = f"{weight:g}" if share == TWO_AXES else f" {weight:g}, two axes {share:.0%}"
            side: dict[str, Any] = (
                {"ha": "center", "va": "bottom"} if share == TWO_AXES else {"ha": "left", "va": "center"}
            )
            axes.annotate(label, (row["eq (7)"], row["others"]), (0, 6), textcoords="offset points", **side)
        axes.axhline(0.0, color="0.7", lw=0.8)
        axes.set_xlabel("eq (7), less the policy trained for it [points]")
        axes.set_ylabel("less imm-lq [points]")
        axes.set_title("Mixtures by the weight of eq (7)")
        axes.legend()
        figure.savefig(ROOT / "docs" / "mixtures.svg", metadata={"Date": None})


def main() -> None:
    """Train, evaluate, draw, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracked", type=Path)
    parser.add_argument("--steps", type=int, default=3_000_000)
    parser.add_argument("--engagements", type=int, default=40)
    options = parser.parse_args()
    jobs = [(*mixture, options.steps, options.engagements, options.tracked) for mixture in MIXTURES]
    rows = []
    # A process each: a compiled training has the mixture in it.
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawned, max_tasks_per_child=1) as pool:
        for row in pool.map(trained, jobs):
            rows.append(row)
            print(*(f"{name} {value:+.2f}" for name, value in row.items()), flush=True)
    if complete := options.engagements >= 40 and options.steps >= 3_000_000:
        draw(rows)
    header = ("two axes", "weight of eq (7)", "eq (7) less its policy", *(f"{name} less imm-lq" for name in FIELDS[1:]))
    lines: list[tuple[Any, ...]] = [
        (f"{r['two_axes']:.0%}", r["weight"], *(f"{r[name]:+.2f}" for name in FIELDS)) for r in rows
    ]
    conditions = {"steps": options.steps, "engagements": options.engagements, "seed": 2}
    finish("mixtures", [], [Table("Points", header, tuple(lines))], conditions, rows, complete)


if __name__ == "__main__":
    main()

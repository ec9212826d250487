"""Tune the classical controllers for the paper's robot and targets, on draws that no evaluation uses.

`python benchmarks/tuning.py` writes src/archerfish/paper/tuning.json, which every evaluation in the paper's
conditions takes its settings from, and results/tuning.json with every setting that was tried. `--controllers` and
`--limits` take some of them, and print what they find beside what is in use, but write nothing.
"""

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.controllers.registry import make_controller
from archerfish.controllers.tuning import GRIDS, Tuning
from archerfish.evaluation.draws import draw
from archerfish.evaluation.run import count
from archerfish.evaluation.tuning_search import search
from archerfish.paper.conditions import paper_tuning
from archerfish.provenance import provenance
from archerfish.records.json_files import plain, write_json
from archerfish.simulation.world import make_world

SEED, ENGAGEMENTS = 0, 200
LIMITS = ("gate", "box", "los-2deg")


def settings(name: str, tuning: Tuning) -> dict[str, float]:
    """Return what is tuned of a controller; `acceleration_sd`, which every tuning has, of all."""
    return {field: getattr(tuning, field) for field in dict.fromkeys(("acceleration_sd", *GRIDS[name]))}


def hit_rates(name: str, task: af.Task, engagements: int) -> Callable[[Tuning], float]:
    """Return the hit rate of a controller in the cells of a task as a function of its settings, 0…1."""
    robot = af.Robot.paper()
    world = make_world(robot, task)
    drawn = draw(task.cells(), engagements, SEED, "tuning", world.normals, world.plants)

    def rate(tuning: Tuning) -> float:
        return float(np.mean(count(world, make_controller(name, robot, task, tuning), *drawn).hit))

    return rate


def main() -> None:
    """Tune, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--controllers", nargs="+", choices=tuple(GRIDS), default=tuple(GRIDS))
    parser.add_argument("--limits", nargs="+", choices=LIMITS, default=LIMITS)
    parser.add_argument("--engagements", type=int, default=ENGAGEMENTS, help="of each cell; fewer are not written")
    options = parser.parse_args()
    found: list[dict[str, Any]] = []
    trials: list[dict[str, Any]] = []
    for limit in options.limits:
        task, in_use = af.Task.load("paper").replace(command_limit=limit), paper_tuning(limit)
        for name in options.controllers:
            rate = hit_rates(name, task, options.engagements)
            tuned, what = search(name, rate), {"command_limit": limit, "controller": name}
            chosen = settings(name, tuned.tuning)
            found.append({**what, "settings": chosen, "hit_rate": tuned.hit_rate, "tried": len(tuned.tried)})
            trials += [{**what, **settings(name, tuning), "hit_rate": share} for tuning, share in tuned.tried]
            before = 100 * rate(Tuning(**in_use[name]))
            print(f"{limit:9} {name:12} {100 * tuned.hit_rate:.2f} %, in use {before:.2f} %   {chosen}", flush=True)
    whole = set(options.controllers) == set(GRIDS) and set(options.limits) == set(LIMITS)
    if whole and options.engagements >= ENGAGEMENTS:
        facts = {"stream": "tuning", "engagements": options.engagements, "provenance": provenance(SEED)}
        write_json(ROOT / "src" / af.__name__ / "paper" / "tuning.json", plain({**facts, "controllers": found}))
        write_json(ROOT / "benchmarks" / "results" / "tuning.json", plain({**facts, "trials": trials}))


if __name__ == "__main__":
    main()

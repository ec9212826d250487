"""Trained policies against those of release 0.1, by their hit rates on the same engagements.

`python benchmarks/trained_policies.py FOLDER` evaluates the policies of FOLDER/NAME-SEED: paper-box, history-gate,
tracked-infantry and kinds-infantry. The rates of three policies of each kind of release 0.1 but the last are in
results/trained_policies_reference.json; of kinds-infantry the rates alone are printed. Goals: mean difference of each
kind within 0.3 points or above, no cell below -1.0. `--train` makes policies that are not there. Writes
results/trained_policies.json.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import archerfish as af

ROOT, RESULTS = Path(__file__).parents[1], Path(__file__).parent / "results"
NAMES = ("paper-box", "history-gate", "tracked-infantry", "kinds-infantry")
SEEDS, ENGAGEMENTS = 3, 500


def setting(name: str) -> tuple[af.Robot, af.Task, af.TrainConfig]:
    """Return robot, task and settings of a kind of policy."""
    robot = af.Robot.load(ROOT / "tests" / "infantry") if "infantry" in name else af.Robot.paper()
    task = af.Task.load("kinds" if name.startswith("kinds") else "paper")
    task = task.replace(command_limit="box") if name.endswith("box") else task
    given: dict[str, Any] = {"observation": "paper"} if name.startswith("paper") else {}
    return robot, task, af.TrainConfig(**given | ({"still_share": 0.5} if name.startswith("tracked") else {}))


def compared(cells: tuple[Any, ...], reference: dict[str, list[float]]) -> dict[str, Any]:
    """Return what the rates are above the reference [points]: mean, the least with its cell, and how many are below."""
    differences = []
    for cell in cells:
        label = f"{cell.motion}, {cell.range_m[0]:g}–{cell.range_m[1]:g} m, {cell.length_s:g} s"
        earlier = reference[label][int(cell.controller.removeprefix("seed "))]
        differences.append((100 * cell.rate - earlier, f"{label}, {cell.controller}"))
    points = [difference for difference, _ in differences]
    found = {"mean": round(sum(points) / len(points), 3), "cells": len(points)}
    least, least_cell = min(differences)
    below = sum(difference < -1.0 for difference in points)
    return {**found, "least": round(least, 2), "least_cell": least_cell, "below_1_point": below}


def main() -> None:
    """Train what is missing, evaluate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--train", action="store_true")
    parser.add_argument("--kinds", nargs="+", choices=NAMES, default=NAMES, help="only these; the result isn't written")
    parser.add_argument("--seeds", type=int, choices=range(1, SEEDS + 1), default=SEEDS, help="fewer aren't written")
    options, rows = parser.parse_args(), {}
    reference = json.loads((RESULTS / "trained_policies_reference.json").read_text())["rates_percent"]
    for name in options.kinds:
        robot, task, config = setting(name)
        policies, seconds = {}, []
        for seed in range(options.seeds):
            place, begun = options.folder / f"{name}-{seed}", time.monotonic()
            if options.train and not (place / "policy.safetensors").exists():
                af.train(robot, task, config=config, seed=seed, out=place)
                seconds.append(round(time.monotonic() - begun, 1))
            policies[f"seed {seed}"] = af.Policy.load(place)
        cells = af.evaluate(policies, robot, task, engagements=ENGAGEMENTS, seed=0).cells
        rows[name] = {"rate_percent": round(sum(100 * cell.rate for cell in cells) / len(cells), 3), "train_s": seconds}
        if name in reference:
            rows[name] |= compared(cells, reference[name])
        print(name, rows[name], flush=True)
    if set(options.kinds) == set(NAMES) and options.seeds == SEEDS:
        content = {"conditions": {"engagements": ENGAGEMENTS, "seed": 0}, "points": rows}
        (RESULTS / "trained_policies.json").write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Trained policies of the second edition against those of the first, paired on the same engagements.

`python benchmarks2/trained_policies.py FOLDER` evaluates the policies of FOLDER/NAME-SEED beside those of the same name
and seed in ../shared, which the first edition trained: paper-box, history-gate, tracked-infantry, and kinds-infantry,
the first's any-infantry. Goals: mean difference of each kind within 0.3 points or above, no cell below -1.0. `--train`
makes those that are not there. Writes results/trained_policies.json.
"""

import argparse
import json
import runpy
import time
from pathlib import Path
from typing import Any

import archerfish2 as af

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT.parent / "shared" / "second_edition" / "reference" / "policies"
NAMES = {"paper-box": "paper-box", "history-gate": "history-gate", "tracked-infantry": "tracked-infantry",
         "kinds-infantry": "any-infantry"}  # fmt: skip


def setting(name: str) -> tuple[af.Robot, af.Task, af.TrainConfig]:
    """Return robot, task and settings of a kind of policy, as the first edition trained it."""
    robot = af.Robot.load(ROOT / "tests2" / "infantry") if "infantry" in name else af.Robot.paper()
    task = af.Task.load("kinds" if name.startswith("kinds") else "paper")
    task = task.replace(command_limit="box") if name.endswith("box") else task
    given: dict[str, Any] = {"observation": "paper"} if name.startswith("paper") else {}
    return robot, task, af.TrainConfig(**given | ({"still_share": 0.5} if name.startswith("tracked") else {}))


def main() -> None:
    """Train what is missing, evaluate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--train", action="store_true")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--engagements", type=int, default=500)
    options, rows = parser.parse_args(), {}
    read_first = runpy.run_path(str(ROOT / "tests2" / "against_first" / "test_policies.py"))["read_first"]
    for name, theirs in NAMES.items():
        robot, task, config = setting(name)
        differences, means, seconds = [], [], []
        for seed in range(options.seeds):
            place, begun = options.folder / f"{name}-{seed}", time.monotonic()
            if options.train and not (place / "policy.safetensors").exists():
                af.train(robot, task, config=config, seed=seed, out=place)
                seconds.append(round(time.monotonic() - begun, 1))
            both = {"ours": af.Policy.load(place), "first": read_first(REFERENCE / f"{theirs}-{seed}")}
            results = af.evaluate(both, robot, task, engagements=options.engagements, seed=0)
            found = results.compare("ours", "first")
            differences += [(seed, each.motion, each.range_m, each.length_s, each.difference) for each in found]
            means.append(round(100 * sum(each.difference for each in found) / len(found), 3))
        least = min(differences, key=lambda each: each[-1])
        rows[name] = {"mean": round(sum(means) / len(means), 3), "by_seed": means, "cells": len(differences)}
        rows[name] |= {"least": round(100 * least[-1], 2), "least_cell": str(least[:-1]), "train_s": seconds}
        rows[name]["below_1_point"] = sum(100 * each[-1] < -1.0 for each in differences)
        print(name, rows[name], flush=True)
    conditions = {"engagements": options.engagements, "seed": 0}
    path = Path(__file__).parent / "results" / "trained_policies.json"
    path.write_text(json.dumps({"conditions": conditions, "points": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()

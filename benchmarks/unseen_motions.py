"""The policy for any target against `imm-lq`: on motions that its training has, and on seventeen that it has not.

`python benchmarks/unseen_motions.py FOLDER` evaluates the policies FOLDER/any-SEED on tests/infantry, in engagements
of 1 s and of 3 s at four ranges: on the eight kinds of motion, on eq (7) beside the policy of FOLDER/tracked-SEED that
was trained for it, on three motions in bursts, and on fourteen others, made up to be unlike the drawn ones. `imm-lq`
has one setting, tuned for the task `any`. All shoot at the same targets with the same dispersion. Goals, in points,
means over the seeds: eight kinds at least +6.2, eq (7) at least -1.2, bursts at least -1.0 and no cell below -3.5,
fourteen others at least +7.5. Writes results/unseen_motions.json.
"""

import argparse
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
import motions
from archerfish.controllers.registry import make_controller
from motions import BURSTS, LENGTHS, OTHERS

ROOT = Path(__file__).parents[1]


def difference(robot: af.Robot, task: af.Task, ours: af.Policy, rival: Any, engagements: int, seed: int) -> list[float]:
    """Return ours less the rival's hit rate in each cell, in points."""
    results = af.evaluate({"ours": ours, "rival": rival}, robot, task, engagements=engagements, seed=seed)
    return [100.0 * each.difference for each in results.compare("ours", "rival")]


def main() -> None:
    """Evaluate, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--engagements", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the engagements and the dispersion")
    options = parser.parse_args()
    robot, task = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any")
    rival = make_controller("imm-lq", robot, task, af.tune("imm-lq", robot, task))
    found: dict[str, dict[str, list[float]]] = {}
    for seed in range(options.seeds):
        ours = af.Policy.load(options.folder / f"any-{seed}")
        count, draws = options.engagements, options.seed
        shoot = partial(difference, robot, ours=ours, engagements=count, seed=draws)
        known = af.evaluate({"ours": ours, "rival": rival}, robot, task, engagements=count, seed=draws)
        for each in known.compare("ours", "rival"):
            found.setdefault(f"known: {each.motion} {each.length_s:g} s", {}).setdefault(str(seed), []).append(
                100.0 * each.difference
            )
        special = af.Policy.load(options.folder / f"tracked-{seed}")
        found.setdefault("eq (7)", {})[str(seed)] = shoot(af.Task.load("paper"), rival=special)
        for ways, group in ((BURSTS, "burst"), (OTHERS, "other")):
            for way in ways:
                for length in LENGTHS:
                    moved = task.replace(motion=f"{motions.__file__}:{way.__name__}_{length:g}", lengths_s=(length,))
                    name = f"{group}: {way.__name__.replace('_', ' ')} {length:g} s"
                    found.setdefault(name, {})[str(seed)] = shoot(moved, rival=rival)
                    print(f"{seed} {name:40} {np.mean(found[name][str(seed)]):+6.2f}", flush=True)
    rows: dict[str, Any] = {}
    for name, by_seed in found.items():
        cells = [each for values in by_seed.values() for each in values]
        means = [round(float(np.mean(each)), 2) for each in by_seed.values()]
        rows[name] = {"mean": round(float(np.mean(cells)), 2), "least": round(min(cells), 2), "by_seed": means}
    groups: dict[str, Any] = {}
    for group in ("known", "eq (7)", "burst", "other"):
        mine = [row for name, row in rows.items() if name.startswith(group)]
        mean, least = np.mean([row["mean"] for row in mine]), min(row["least"] for row in mine)
        by_seed = np.mean([row["by_seed"] for row in mine], axis=0).round(2).tolist()
        groups[group] = {"mean": round(float(mean), 2), "least": least, "by_seed": by_seed}
    for name, row in (rows | groups).items():
        print(f"{name:40} mean {row['mean']:+6.2f}  least {row['least']:+6.2f}  seeds {row['by_seed']}")
    conditions = {"engagements": options.engagements, "seed": options.seed}
    if options.engagements >= 100:
        made = json.dumps({"conditions": conditions, "groups": groups, "points": rows}, indent=1)
        (Path(__file__).parent / "results" / f"unseen_motions{options.seed or ''}.json").write_text(made + "\n")


if __name__ == "__main__":
    main()

"""Steps of the environments for Gymnasium per second against the first edition's.

Each edition runs in a process of its own; the two alternate: `python benchmarks2/environment_speed.py`. 256 engagements
side by side, on tests2/infantry for targets of any motion with the observation of a training (goal: 20 of the first
edition's figures) and in the paper's task; and a single environment in the paper's task. The environment without an
adapter is in training.py. Writes results/environment_speed.json.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import alternating

ROOT = Path(__file__).parents[1]
INFANTRY = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"
MEMBERS, STEPS, NAMES = 256, 50, ("vector, any", "vector, paper", "single, paper")


def first_edition() -> dict[str, Callable[[], int]]:
    """Return what is measured of the first edition."""
    import archerfish.simulation.registration  # noqa: F401
    from archerfish.records.limits import read_limits
    from archerfish.records.muzzle import read_muzzle
    from archerfish.records.sensing import read_sensing

    records = {"muzzle": read_muzzle, "sensing": read_sensing, "limits": read_limits}
    given: dict[str, Any] = {name: read(INFANTRY / f"{name}.json") for name, read in records.items()}
    given |= {"plant": str(INFANTRY), "target": "any", "observation": "multimodel"}
    return _works("archerfish/Shooting-v0", given, {"target": "dynamic"})


def second_edition() -> dict[str, Callable[[], int]]:
    """Return the same of the second edition."""
    given = {"robot": str(ROOT / "tests2" / "infantry"), "task": "kinds"}
    return _works("archerfish2.learning.gymnasium:archerfish/Shooting-v0", given, {"task": "paper"})


def _works(name: str, of_any: dict[str, Any], of_paper: dict[str, Any]) -> dict[str, Callable[[], int]]:
    import gymnasium
    import numpy as np

    def many(options: dict[str, Any]) -> Callable[[], int]:
        envs = gymnasium.make_vec(name, num_envs=MEMBERS, **options)
        envs.reset(seed=0)
        actions = np.zeros((MEMBERS, 2), np.float32)

        def run() -> int:
            for _ in range(STEPS):
                envs.step(actions)
            return STEPS * MEMBERS

        return run

    env, action = gymnasium.make(name, **of_paper), np.zeros(2, np.float32)

    def one() -> int:
        env.reset(seed=0)
        for _ in range(STEPS):
            env.step(action)
        return STEPS

    return dict(zip(NAMES, (many(of_any), many(of_paper), one), strict=True))


if __name__ == "__main__":
    EDITIONS = {"first": first_edition, "second": second_edition}
    alternating.run(__doc__, __file__, EDITIONS, NAMES, pairs=7)

"""Steps of the vector environment per second against the first edition's, for targets of any motion.

Each edition runs in a process of its own; the two alternate: `python benchmarks2/environment_speed.py`. 256 engagements
on tests2/infantry with the observation of a training. Goal: 20 of the first edition's figures. Writes
results/environment_speed.json.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import alternating

ROOT = Path(__file__).parents[1]
INFANTRY = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"
MEMBERS, STEPS = 256, 50


def first_edition() -> dict[str, Callable[[], int]]:
    """Return what is measured of the first edition."""
    import archerfish.simulation.registration  # noqa: F401
    from archerfish.records.limits import read_limits
    from archerfish.records.muzzle import read_muzzle
    from archerfish.records.sensing import read_sensing

    records = {"muzzle": read_muzzle, "sensing": read_sensing, "limits": read_limits}
    given: dict[str, Any] = {name: read(INFANTRY / f"{name}.json") for name, read in records.items()}
    given |= {"plant": str(INFANTRY), "target": "any", "observation": "multimodel"}
    return {"vector, any": _stepped("archerfish/Shooting-v0", given)}


def second_edition() -> dict[str, Callable[[], int]]:
    """Return the same of the second edition."""
    given = {"robot": str(ROOT / "tests2" / "infantry"), "task": "kinds"}
    return {"vector, any": _stepped("archerfish2:archerfish2/Shooting-v0", given)}


def _stepped(name: str, options: dict[str, Any]) -> Callable[[], int]:
    import gymnasium
    import numpy as np

    envs = gymnasium.make_vec(name, num_envs=MEMBERS, **options)
    envs.reset(seed=0)
    actions = np.zeros((MEMBERS, 2), np.float32)

    def run() -> int:
        for _ in range(STEPS):
            envs.step(actions)
        return STEPS * MEMBERS

    return run


if __name__ == "__main__":
    EDITIONS = {"first": first_edition, "second": second_edition}
    alternating.run(__doc__, __file__, EDITIONS, ("vector, any",), pairs=7)

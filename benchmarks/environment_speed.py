"""Steps of the environments for Gymnasium per second.

`python benchmarks/environment_speed.py [--against REVISION]`: 256 engagements side by side, on tests/infantry for
targets of any motion and in the paper's task, and a single environment in the paper's task. The environment without an
adapter is in training.py. Writes results/environment_speed.json.
"""

from collections.abc import Callable
from typing import Any

import alternating

ID = "archerfish.learning.gymnasium:archerfish/Shooting-v0"
MEMBERS, STEPS = 256, 50
NAMES = ("vector, kinds", "vector, paper", "single, paper")


def prepare() -> alternating.Work:
    """Return name → steps of environments, which return how many."""
    import gymnasium
    import numpy as np

    def many(**options: Any) -> Callable[[], int]:
        envs = gymnasium.make_vec(ID, num_envs=MEMBERS, **options)
        envs.reset(seed=0)
        actions = np.zeros((MEMBERS, 2), np.float32)

        def run() -> int:
            for _ in range(STEPS):
                envs.step(actions)
            return STEPS * MEMBERS

        return run

    env, action = gymnasium.make(ID, task="paper"), np.zeros(2, np.float32)

    def one() -> int:
        env.reset(seed=0)
        for _ in range(STEPS):
            env.step(action)
        return STEPS

    infantry = str(alternating.ROOT / "tests" / "infantry")
    return dict(zip(NAMES, (many(robot=infantry, task="kinds"), many(task="paper"), one), strict=True))


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=7)

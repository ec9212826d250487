"""Whether the vector adapter hands out every transition that single environments of the same seeds do, and no other."""

import numpy as np

from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.gymnasium_env import ShootingEnv
from archerfish.simulation.vector_env import ShootingVectorEnv

TOLERANCE = 1e-3
"""Of observations, which magnify the last bits of angles a hundred times."""


def transitions_that_differ(environment: ShootingEnvironment, environments: int, steps: int) -> int:
    """Count the transitions in which the two disagree, of environments × steps.

    Args:
      environment: where.
      environments: side by side.
      steps: of each.
    """
    vector = ShootingVectorEnv(environments, environment)
    alone = [ShootingEnv(environment) for _ in range(environments)]
    vector.reset(seed=0)
    for seed, env in enumerate(alone):
        env.reset(seed=seed)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, environments, 2)).astype(np.float32)
    different = 0
    for asked in actions:
        seen, reward, _, truncated, infos = vector.step(asked)
        for member, env in enumerate(alone):
            final, own, _, ended, _ = env.step(asked[member])
            told = infos["final_obs"][member] if truncated[member] else seen[member]
            first = env.reset()[0] if ended else final
            pairs = ((told, final), (seen[member], first), (reward[member], own))
            same = ended == truncated[member] and all(np.allclose(*each, atol=TOLERANCE) for each in pairs)
            different += not same
    return different

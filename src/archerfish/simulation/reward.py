"""What a decision is worth in training: the distance of eq (8), and a hit.

Where a target may or may not turn back, the nearest place on average is one that neither hits, so a hit is worth
something in itself. A step at the armor's edge has no slope, though: for a trainer that follows the simulator's
gradient the hit is smoothed, as a logistic function of the margin, as a little more spread of the pellets would do.
"""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.simulation.shooting import miss_distance


class Reward(NamedTuple):
    """Weights of the reward; shape () each. As it stands by default: eq (8)."""

    distance: Array = np.float32(1.0)
    """Weight of eq (8), the negative distance between pellet and armor."""
    hit: Array = np.float32(0.0)
    """What a hit adds [m]; zero in the paper."""
    width: Array = np.float32(0.0)
    """Scale of the logistic function that smooths a hit [m]; zero for a step at the hit radius."""


EQ_8 = Reward()
"""The paper's reward."""


def reward(weights: Reward, miss: Array, hit_radius: Array) -> tuple[Array, Array]:
    """Return the reward of a shot, and whether it hit.

        r = −w |miss| + h σ((R − |miss|) / s),   with the step |miss| ≤ R in the place of σ where s = 0

    Eq (8) is w = 1, h = 0.

    Args:
      weights: w, h and s.
      miss: pellet minus armor in y and z [m], shape B + (2,).
      hit_radius: R, largest miss that hits [m].

    Returns:
      Reward [m], shape B; whether each shot hit, shape B.
    """
    xp = namespace(miss)
    distance = miss_distance(miss)
    hit = distance <= hit_radius
    smooth = weights.width > 0.0
    steepness = (hit_radius - distance) / xp.where(smooth, xp.asarray(weights.width), 1.0)
    likely = 1.0 / (1.0 + xp.exp(xp.clip(-steepness, -_STEEPEST, _STEEPEST)))
    worth = xp.where(smooth, likely, xp.where(hit, 1.0 + 0.0 * distance, 0.0 * distance))
    return weights.hit * worth - weights.distance * distance, hit


_STEEPEST = 40.0
"""Beyond it the logistic function is 0 or 1 in float32, and its exponential would overflow."""

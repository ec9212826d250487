"""Variations of drawn motions for training, slower or swaying: a policy meets more than the motions' names say.

Without them a policy takes slow targets for those of eq (7), the only slow ones in its training, and is wrong about
targets that do two things at once.
"""

import math

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import VARIATION, way_along
from archerfish.targets.path import TIMES, at_pace
from archerfish.targets.sinusoid import LARGEST_ACCELERATION

SLOWER, SWAYING = 0.15, 0.2
"""Shares of the targets that are slower, and that sway; chosen on draws that no evaluation has."""
CHANCES = 6
"""Uniform draws per target."""


def varied(way: Array, chance: Array) -> Array:
    """Let some targets go their way at a smaller pace, and others sway about it along a line.

    Args:
      way: level way at `path.TIMES` [m], shape B + (N, 2).
      chance: uniform draws, shape B + (CHANCES,).
    """
    xp = namespace(way, chance)
    which, phase = chance[..., 0], chance[..., 5]
    pace, amplitude, frequency, heading = (
        each.draw(chance[..., 1 + index]) for index, each in enumerate(VARIATION.values())
    )
    slower = at_pace(way, xp.where(which < SLOWER, pace, 1.0 + 0.0 * pace))
    rate = xp.minimum(2.0 * math.pi * frequency, xp.sqrt(LARGEST_ACCELERATION / amplitude))[..., None]
    angle = rate * lift(xp.asarray(TIMES, dtype=chance.dtype), rate) + 2.0 * math.pi * phase[..., None]
    amplitude = xp.where(which >= 1.0 - SWAYING, amplitude, 0.0 * amplitude)[..., None]
    return slower + way_along(math.pi / 180.0 * heading, amplitude * xp.sin(angle))

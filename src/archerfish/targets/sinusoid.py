"""A target that swings about a place."""

import math
from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import draw_parameters, way_along
from archerfish.targets.path import TIMES

LARGEST_ACCELERATION = 8.0
"""Of targets in curves [m/s²]; as the largest of `distributions.ACCELERATION`."""


class Sinusoid(NamedTuple):
    """A target that swings about a place."""

    center: Array
    """[m], shape B + (3,)."""
    amplitude: Array
    """[m] in each coordinate, shape B + (3,)."""
    angular_frequency: Array
    """[rad/s], shape B."""
    phase: Array
    """[rad], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.center, time)
        return self.center + self.amplitude * xp.sin(self.angular_frequency * time + self.phase)[..., None]


def sinusoid_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw swings along a line, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    amplitude, frequency, heading = draw_parameters("sinusoid", chance)
    rate = xp.minimum(2.0 * math.pi * frequency, xp.sqrt(LARGEST_ACCELERATION / amplitude))
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), rate[..., None])
    angle = rate[..., None] * time + 2.0 * math.pi * chance[..., 3, None]
    return way_along(heading, amplitude[..., None] * xp.sin(angle))

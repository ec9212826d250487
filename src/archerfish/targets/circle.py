"""A target that drives in a level circle."""

import math
from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import draw_parameters
from archerfish.targets.path import TIMES
from archerfish.targets.sinusoid import LARGEST_ACCELERATION


class Circle(NamedTuple):
    """A target that drives in a level circle."""

    center: Array
    """[m], shape B + (3,)."""
    radius: Array
    """[m], shape B."""
    angular_rate: Array
    """[rad/s], left positive, shape B."""
    phase: Array
    """Angle at time zero [rad], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.center, time)
        angle = self.phase + self.angular_rate * time
        forward, left = self.radius * xp.cos(angle), self.radius * xp.sin(angle)
        return self.center + xp.stack([forward, left, 0.0 * angle], axis=-1)


def circle_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw circles about the place, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    radius, speed = draw_parameters("circle", chance)
    rate = xp.minimum(speed, xp.sqrt(LARGEST_ACCELERATION * radius)) / radius
    rate = xp.where(chance[..., 2] < 0.5, -rate, rate)
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), rate[..., None])
    angle = rate[..., None] * time + 2.0 * math.pi * chance[..., 3, None]
    return radius[..., None, None] * xp.stack([xp.cos(angle), xp.sin(angle)], axis=-1)

"""A target that drives straight on."""

import math
from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import draw_parameters, way_along
from archerfish.targets.path import TIMES


class Line(NamedTuple):
    """A target that drives straight on."""

    start: Array
    """Position at time zero [m], shape B + (3,)."""
    velocity: Array
    """[m/s], shape B + (3,)."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        time = namespace(self.start, time).asarray(time)[..., None]
        return lift(self.start, time) + lift(self.velocity, time) * time


def pass_way(chance: Array, duration: Array) -> Array:
    """Draw straight ways that pass the place at some moment of the engagement, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    speed, heading = draw_parameters("pass", chance)
    to_left = xp.where(chance[..., 2] < 0.5, 0.0, math.pi)
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), speed[..., None])
    return way_along(heading + to_left, speed[..., None] * (time - (duration * chance[..., 3])[..., None]))

"""A target that strafes: to and fro at one speed, turning back at random moments."""

import math

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import draw_parameters, way_along
from archerfish.targets.legs import driven, leg_ends

LEGS = 12
"""Turns that are drawn; targets with more in an engagement drive on after the last."""


def strafe_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw ways with turns at random times, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    speed, heading, mean, irregularity, acceleration = draw_parameters("strafe", chance)
    to_left = xp.where(chance[..., 5] < 0.5, 0.0, math.pi)
    ends = leg_ends(mean, irregularity, chance[..., 7 : 7 + LEGS], chance[..., 6])
    signs = xp.asarray([-2.0 if leg % 2 == 0 else 2.0 for leg in range(LEGS)], dtype=chance.dtype)
    changes = speed[..., None] * lift(signs, ends)
    return way_along(heading + to_left, driven(speed, changes, ends, acceleration))

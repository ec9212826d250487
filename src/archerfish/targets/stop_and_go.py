"""A target that drives a little, stands, and drives again, to either side."""

import itertools

from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.targets.distributions import draw_parameters, way_along
from archerfish.targets.legs import driven, leg_ends

LEGS = 12
"""Starts and stops that are drawn."""


def stop_and_go_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw ways that alternate between driving and standing, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    speed, heading, mean, irregularity, acceleration = draw_parameters("stop-and-go", chance)
    ends = leg_ends(mean, irregularity, chance[..., 7 : 7 + LEGS], chance[..., 6])
    way = xp.where(chance[..., 7 + LEGS : 8 + LEGS + LEGS // 2] < 0.5, -1.0, 1.0)
    # Half of the targets drive when the path begins.
    driving = chance[..., 5] < 0.5
    velocity = [xp.where(driving, way[..., 0], 0.0)]
    for leg in range(LEGS):
        stops = xp.where(driving, leg % 2 == 0, leg % 2 == 1)
        velocity.append(xp.where(stops, 0.0, way[..., (leg + 1) // 2]))
    changes = speed[..., None] * xp.stack([after - before for before, after in itertools.pairwise(velocity)], axis=-1)
    return way_along(heading, driven(speed * velocity[0], changes, ends, acceleration))

"""Manoeuvres of Singer's model (1970): the acceleration is noise with a memory.

da/dt = −a / τ + white noise, with the stationary standard deviation σ of a, along and across
"""

import math

import numpy as np

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import direction, draw_parameters
from archerfish.targets.path import BEGIN_S, STEP_S, TIMES

KNOT_S = 0.2
"""Between moments at which the acceleration is drawn, linear between them [s]."""
KNOTS = 1 + math.ceil((float(TIMES[-1]) - BEGIN_S) / KNOT_S - 1e-9)
FORWARD_SHARE = 0.5
"""Of the acceleration towards the gimbal, to that across the line of sight."""


def _integrals() -> tuple[np.ndarray, int]:
    """Return the matrix from accelerations at the knots to the way at `TIMES`, (K, N), at rest at time zero."""
    share = (TIMES - BEGIN_S) / KNOT_S
    weight = np.maximum(1.0 - np.abs(share[None, :] - np.arange(KNOTS)[:, None]), 0.0)
    middle = 0.5 * (weight[:, 1:] + weight[:, :-1])
    speed = np.concatenate([np.zeros((KNOTS, 1)), np.cumsum(STEP_S * middle, axis=1)], axis=1)
    zero = round(-BEGIN_S / STEP_S)
    speed = speed - speed[:, zero, None]
    way = np.concatenate(
        [np.zeros((KNOTS, 1)), np.cumsum(STEP_S * 0.5 * (speed[:, 1:] + speed[:, :-1]), axis=1)], axis=1
    )
    return way - way[:, zero, None], zero


_INTEGRAL, _ZERO = _integrals()


def singer_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw manoeuvres that begin at the place with some velocity, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    speed, heading, sd, memory = draw_parameters("singer", chance)
    # Box and Muller: two independent normals of two uniforms, for the two directions.
    one, two = (chance[..., 4 + part * KNOTS : 4 + (part + 1) * KNOTS] for part in range(2))
    radius = xp.sqrt(-2.0 * xp.log(1.0 - xp.clip(one, 0.0, 1.0 - 1e-6)))
    kept = xp.exp(-KNOT_S / memory)
    scale = sd * xp.sqrt(1.0 - kept**2)
    integral = xp.asarray(_INTEGRAL, dtype=chance.dtype)
    first = speed[..., None] * direction(heading)
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), speed[..., None])
    ways = []
    for axis, turn, share in ((0, xp.sin, FORWARD_SHARE), (1, xp.cos, 1.0)):
        normal = radius * turn(2.0 * math.pi * two)
        acceleration = [sd * normal[..., 0]]
        for knot in range(1, KNOTS):
            acceleration.append(kept * acceleration[-1] + scale * normal[..., knot])
        way = share * (xp.stack(acceleration, axis=-1) @ integral)
        ways.append(way + first[..., axis, None] * time)
    return xp.stack(ways, axis=-1)

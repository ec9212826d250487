"""Which angles hit a point, and a moving target: the inverse of the flat-fire flight."""

from collections.abc import Callable
from typing import NamedTuple

from archerfish.arrays import Array, lift, namespace
from archerfish.dynamics.muzzle import Muzzle
from archerfish.dynamics.pellet import flat_fire_drop, flat_fire_time

NEWTON_ITERATIONS = 3
"""Newton iterations: they leave less than 1e-7 rad at 18 m/s within 8 m, and less than 1e-4 rad at 12 m/s."""
NEAREST_M, FARTHEST_M = 0.05, 1000.0
"""Distances that an aim is computed for [m]: targets of a task are at most so far away."""
FLIGHT_TIME_ROUNDS = 3
"""Rounds of the flight-time iteration; each shrinks the error by target speed over muzzle speed."""


class Aim(NamedTuple):
    """How to hit a point."""

    angle: Array  # pitch and yaw of the gimbal [rad], B + (2,)
    flight_time: Array  # [s], B


def aim_at(point: Array, muzzle: Muzzle) -> Aim:
    """Solve for the gimbal's angles whose mean pellet passes through a point, drop and drag included.

    Args:
      point: against the pivot [m], shape B + (3,). For one that can't be reached the angles are finite, but of no use.
      muzzle: speed, mean disturbance angles, drag and length.
    """
    xp = namespace(point)
    level = xp.sqrt(point[..., 0] ** 2 + point[..., 1] ** 2)
    height, time, drop = point[..., 2], 0.0 * level, 0.0 * level
    for _ in range(NEWTON_ITERATIONS):
        slant = xp.minimum(xp.maximum(xp.sqrt(level**2 + (height + drop) ** 2), NEAREST_M), FARTHEST_M)
        time = flat_fire_time(slant - muzzle.length, muzzle.speed, muzzle.drag)
        fall = flat_fire_drop(time, muzzle.drag * muzzle.speed)
        # Newton's step, as the fall grows with the square of the distance.
        drop = drop + (fall - drop) / (1.0 - 2.0 * fall * (height + drop) / slant**2)
    pitch = xp.atan2(height + drop, level)
    yaw = xp.atan2(point[..., 1], point[..., 0])
    angle = xp.stack([pitch, yaw], axis=-1)
    # The offset turns the pellet about the muzzle, not about the pivot: less of it acts, the nearer the target.
    turned = (1.0 - muzzle.length / slant)[..., None]
    return Aim(angle - turned * lift(muzzle.offset, angle), time)


def intercept(
    position_after: Callable[[Array], Array],
    delay: Array,
    muzzle: Muzzle,
    mean_after: Callable[[Array], Array] | None = None,
) -> Aim:
    """Solve for the angles at which a pellet fired after a delay hits a moving target.

    Args:
      position_after: predicted position against the pivot [m], shape B + (3,), after a time [s] from now, shape B.
      delay: time until the pellet leaves the muzzle [s], shape B.
      muzzle: speed, drag, offsets and length.
      mean_after: a cheaper prediction, near enough for the time of flight; `position_after` if not given.
    """
    near = position_after if mean_after is None else mean_after
    time = 0.0 * delay
    for _ in range(FLIGHT_TIME_ROUNDS):
        time = aim_at(near(delay + time), muzzle).flight_time
    return aim_at(position_after(delay + time), muzzle)


def line_of_sight(point: Array) -> Array:
    """Return pitch and yaw of a point seen from the pivot [rad], shape B + (3,) → B + (2,)."""
    xp = namespace(point)
    level = xp.sqrt(point[..., 0] ** 2 + point[..., 1] ** 2)
    return xp.stack([xp.atan2(point[..., 2], level), xp.atan2(point[..., 1], point[..., 0])], axis=-1)

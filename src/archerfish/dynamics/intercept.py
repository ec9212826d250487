"""Where to point so that a pellet meets a moving target: drop, drag, delay and the target's way."""

from collections.abc import Callable

from archerfish.dynamics.aiming import Aim, aim_at
from archerfish.dynamics.array_namespace import Array
from archerfish.dynamics.muzzle import Muzzle

ROUNDS = 3
"""Rounds of the flight-time iteration; each shrinks the error by target speed over muzzle speed."""


def intercept(
    position_after: Callable[[Array], Array],
    delay: Array,
    muzzle: Muzzle,
    mean_after: Callable[[Array], Array] | None = None,
) -> Aim:
    """Solve for the angles at which a pellet fired after a delay meets the target.

    Args:
      position_after: predicted position [m], shape B + (3,), after a time [s] from now, shape B.
      delay: time until the pellet leaves the muzzle [s], shape B.
      muzzle: speed, drag, offsets and length.
      mean_after: a cheaper prediction, near enough for the time of flight; `position_after` if not given.
    """
    near = position_after if mean_after is None else mean_after
    time = 0.0 * delay
    for _ in range(ROUNDS):
        time = aim_at(near(delay + time), muzzle).flight_time
    return aim_at(position_after(delay + time), muzzle)

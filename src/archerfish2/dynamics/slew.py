"""The fastest slew of a command to an aim under limits of its rate and acceleration: time-optimal switching."""

from archerfish2.arrays import Array, lift, namespace
from archerfish2.dynamics.command_limits import fastest_approach


def approach(aim: Array, command: Array, max_rate: Array, max_acceleration: Array, period: Array | float) -> Array:
    """Return the next command on the fastest slew to an aim that can stop there.

    Args:
      aim: where to go [rad], shape B + (2,).
      command: in force now [rad], shape B + (2,).
      max_rate: of the command [rad per unit of the period], shape (2,).
      max_acceleration: by how much that rate may change in a unit, shape (2,).
      period: until the next decision; with 1, rates are moves per decision.
    """
    xp = namespace(aim, command)
    distance = aim - command
    max_rate, max_acceleration = lift(max_rate, distance), lift(max_acceleration, distance)
    rate = xp.minimum(max_rate, fastest_approach(xp.abs(distance), max_acceleration, period))
    # An aim within reach is taken exactly: no rounding by a detour over the rate.
    return xp.where(xp.abs(distance) <= rate * period * (1.0 + 1e-5), aim, command + xp.sign(distance) * rate * period)

"""The fastest slew of a command to an aim under limits of its rate and acceleration: time-optimal switching."""

from archerfish2.arrays import Array, lift, namespace
from archerfish2.dynamics.command_limits import CommandLimits, fastest_approach


def approach(limits: CommandLimits, aim: Array, command: Array, period: Array) -> Array:
    """Return the next command on the fastest slew to an aim that can stop there.

    Args:
      limits: acceleration and rate are used.
      aim: where to go [rad], shape B + (2,).
      command: in force now [rad], shape B + (2,).
      period: until the next decision [s].
    """
    xp = namespace(aim, command)
    distance = aim - command
    max_rate, max_acceleration = lift(limits.max_rate, distance), lift(limits.max_acceleration, distance)
    rate = xp.minimum(max_rate, fastest_approach(xp.abs(distance), max_acceleration, period))
    # An aim within reach is taken exactly: no rounding by a detour over the rate.
    return xp.where(xp.abs(distance) <= rate * period * (1.0 + 1e-5), aim, command + xp.sign(distance) * rate * period)

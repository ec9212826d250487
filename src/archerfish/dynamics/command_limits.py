"""Limits of commands, between any controller and the axes, and the fastest slew that keeps them.

Three settings of one function. `box` keeps the angle ranges alone, as the paper prints. `gate` adds the rate and the
acceleration of the commanded angle that a real gimbal can follow. `los-2deg` instead holds the yaw command within 2°
of the line of sight. A limit that a setting does not use is so large that it never acts, so one compiled program
serves all three.
"""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.errors import InputError
from archerfish.records.limits import UNLIMITED, LimitsRecord

COMMAND_LIMITS = ("box", "gate", "los-2deg")
"""Names of the settings."""
NEVER = UNLIMITED
"""A limit that never acts: rad, rad/s, rad/s²."""
_ROUNDING = 1.0 - 1e-5
"""Share of the acceleration limit that is used, so that second differences of float32 commands keep it too."""


class CommandLimits(NamedTuple):
    """Limits of the pitch and yaw command, shape (2,) each; low and high are B + (2,) where the base turns."""

    low: Array  # smallest angle [rad]
    high: Array  # largest angle [rad]
    max_rate: Array  # largest rate of the command [rad/s]
    max_acceleration: Array  # largest change of that rate per time [rad/s²]
    max_lead: Array  # largest distance of the command from the line of sight [rad]


def named_limits(name: str, record: LimitsRecord, yaw_lead: float) -> CommandLimits:
    """Return the limits of a name in `COMMAND_LIMITS`.

    Args:
      name: "box", "gate" or "los-2deg".
      record: ranges, rates and accelerations.
      yaw_lead: of `los-2deg` [rad].

    Raises:
      InputError: if the name is unknown.
    """
    if name not in COMMAND_LIMITS:
        raise InputError(f"command_limit must be one of {', '.join(COMMAND_LIMITS)}, got {name!r}; choose one of them")
    pitch, yaw = record.pitch, record.yaw
    low, high = np.array([pitch.ends, yaw.ends]).T
    rate = np.array([pitch.max_rate, yaw.max_rate])
    acceleration = np.array([pitch.max_acceleration, yaw.max_acceleration])
    never = np.full(2, NEVER)
    if name == "gate":
        return CommandLimits(low, high, rate, _ROUNDING * acceleration, never)
    lead = np.array([NEVER, yaw_lead]) if name == "los-2deg" else never
    return CommandLimits(low, high, never, never, lead)


def limit_command(
    limits: CommandLimits, desired: Array, previous: Array, previous_rate: Array, line_of_sight: Array, period: Array
) -> Array:
    """Return the command nearest to the desired one that the limits allow.

    A command that keeps the limits passes unchanged. Near the end of the range the rate is bounded so that the
    acceleration limit suffices to stop there.

    Args:
      limits: the limits.
      desired: wanted pitch and yaw command [rad], shape B + (2,).
      previous: command in force until now [rad], shape B + (2,).
      previous_rate: rate at which it was reached [rad/s], shape B + (2,).
      line_of_sight: its pitch and yaw [rad], shape B + (2,).
      period: decision period [s].
    """
    xp = namespace(desired, previous)
    limits = CommandLimits(*(lift(limit, desired) for limit in limits))
    desired = xp.clip(desired, line_of_sight - limits.max_lead, line_of_sight + limits.max_lead)
    desired = xp.clip(desired, limits.low, limits.high)
    wanted = (desired - previous) / period
    change = limits.max_acceleration * period
    rate = xp.clip(wanted, previous_rate - change, previous_rate + change)
    rate = xp.clip(
        rate,
        -xp.minimum(limits.max_rate, fastest_approach(previous - limits.low, limits.max_acceleration, period)),
        xp.minimum(limits.max_rate, fastest_approach(limits.high - previous, limits.max_acceleration, period)),
    )
    # What no limit touches is the desired command itself: no rounding by a detour over the rate.
    reached = xp.where(rate == wanted, desired, previous + rate * period)
    return xp.clip(reached, limits.low, limits.high)


def fastest_approach(distance: Array, max_acceleration: Array, period: Array) -> Array:
    """Largest rate for the coming period from which one can still stop within a distance.

    Braking by a T each period from rate v covers at most max_N [v N T − a T² N (N − 1) / 2] before it stops, so
    v ≤ min_N [distance / (N T) + a T (N − 1) / 2]; the smallest is next to N = √(2 distance / (a T²)).

    Args:
      distance: left [rad], ≥ 0, shape B.
      max_acceleration: a [rad/s²], shape B.
      period: T [s].

    Returns:
      Rate [rad/s], shape B.
    """
    xp = namespace(distance, max_acceleration)
    distance = xp.maximum(distance, 0.0)
    change = max_acceleration * period
    count = xp.maximum(xp.floor(xp.sqrt(2.0 * distance / (change * period))), 1.0)

    def rate(count: Array) -> Array:
        return distance / (count * period) + change * (count - 1.0) / 2.0

    return xp.minimum(rate(count), rate(count + 1.0))


def approach(aim: Array, command: Array, max_rate: Array, max_acceleration: Array, period: Array | float) -> Array:
    """Return the next command on the fastest slew to an aim that can stop there: time-optimal switching.

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

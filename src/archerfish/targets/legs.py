"""Ways in legs: a velocity along a line that changes at some moments, each time within the time that driving takes."""

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.path import BEGIN_S, TIMES

SOONEST_S = 1e-3
"""Shortest time that a change of velocity takes [s]."""


def leg_ends(mean: Array, irregularity: Array, chance: Array, first: Array) -> Array:
    """Draw the moments at which legs end.

    A leg lasts m ((1 − r) + r E) with an exponentially distributed E: at r = 1 ends come without memory (a Poisson
    process), at r = 0 at equal times.

    Args:
      mean: m, of a leg's length [s], shape B.
      irregularity: r, shape B.
      chance: uniform draws, shape B + (L,).
      first: uniform draw: how much of the first leg is left when the path begins, shape B.

    Returns:
      L moments [s], shape B + (L,).
    """
    xp = namespace(chance)
    exponential = -xp.log(1.0 - xp.clip(chance, 0.0, 1.0 - 1e-6))
    lengths = mean[..., None] * ((1.0 - irregularity[..., None]) + irregularity[..., None] * exponential)
    left = xp.concat([first[..., None] * lengths[..., :1], lengths[..., 1:]], axis=-1)
    return BEGIN_S + xp.cumulative_sum(left, axis=-1)


def driven(first: Array, change: Array, moment: Array, acceleration: Array) -> Array:
    """Return the way of a velocity that changes at some moments, at constant acceleration each time.

    Args:
      first: velocity before the first change [m/s], shape B.
      change: of the velocity at each moment [m/s], shape B + (L,).
      moment: at which it begins [s], shape B + (L,).
      acceleration: magnitude [m/s²], shape B.

    Returns:
      Way at `TIMES`, zero at time zero [m], shape B + (N,).
    """
    xp = namespace(change, moment)
    time = xp.asarray(TIMES, dtype=change.dtype)
    way = first[..., None] * lift(time, first[..., None])
    ramp = xp.maximum(xp.abs(change) / acceleration[..., None], SOONEST_S)
    for leg in range(change.shape[-1]):
        begin, length, step = (each[..., leg, None] for each in (moment, ramp, change))
        since = xp.maximum(lift(time, begin) - begin, 0.0)
        ramped = xp.minimum(since, length)
        way = way + step * (ramped**2 / (2.0 * length) + since - ramped)
    start = way[..., _ZERO, None]
    return way - start


_ZERO = round(-BEGIN_S / (TIMES[1] - TIMES[0]))
"""Index of time zero."""

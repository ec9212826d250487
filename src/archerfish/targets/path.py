"""A path in even steps: what every drawn motion becomes, so that one program serves all of them."""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.distributions import LARGEST_FORWARD, LARGEST_LATERAL, LARGEST_SPEED

STEP_S = 0.02
"""Between two points of a path [s]: a line between them leaves at most 0.5 mm of a curve at 10 m/s²."""
BEGIN_S, LONGEST_S = -0.3, 3.0
"""Begin of a path, before an engagement, for cameras show what was; longest engagement [s]."""
FLIGHT_S = 0.7
"""A path goes on for so long after its engagement [s]: no pellet flies longer."""
TIMES = BEGIN_S + STEP_S * np.arange(round((LONGEST_S + FLIGHT_S - BEGIN_S) / STEP_S) + 1)
"""Of the points [s], shape (N,)."""


class Path(NamedTuple):
    """Places at even times, linear between them, at rest before the first and after the last."""

    places: Array
    """[m], shape B + (N, 3); or B + (N, 2), of level ways."""
    begin: Array
    """Time of the first [s], shape B."""
    step: Array
    """Between two [s], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,), or B + (2,) of level ways.

        Several times at once come as shape (M,) + B, and give positions of shape (M,) + B + (3,).
        """
        xp = namespace(self.places, time)
        count, batch = self.places.shape[-2], self.places.shape[:-2]
        time = xp.asarray(time)
        at = xp.clip((time - lift(self.begin, time)) / lift(self.step, time), 0.0, count - 1.0)
        whole = xp.clip(xp.floor(at), 0.0, count - 2.0)
        before, share = xp.astype(whole, xp.int32), (at - whole)[..., None]
        # Rows of one table, so that a path may meet several times at once by broadcasting.
        rows = xp.reshape(self.places, (-1, self.places.shape[-1]))
        member = xp.reshape(xp.arange(int(np.prod(batch)), dtype=xp.int32), batch)
        row = count * lift(member, before) + before
        return (1.0 - share) * rows[row] + share * rows[row + 1]


def at_pace(way: Array, pace: Array) -> Array:
    """Return ways that are gone at a share of their pace, at the same place at time zero.

    Args:
      way: at `TIMES` [m], shape B + (N, 2).
      pace: share, 0…1, shape B.
    """
    xp = namespace(way, pace)
    times = xp.reshape(xp.asarray(TIMES, dtype=way.dtype), (-1,) + (1,) * pace.ndim)
    zero = 0.0 * pace
    slowed = Path(way, zero + BEGIN_S, zero + STEP_S)
    return xp.moveaxis(slowed.position(lift(pace, times) * times), 0, -2)


def path_about(place: Array, way: Array, duration: Array) -> Path:
    """Return the path of targets about their places, no faster and no farther than targets may be.

    A target that would be too fast, or go too far, keeps the shape of its path and moves less.

    Args:
      place: middle or begin of the way [m], shape B + (3,).
      way: level way from there at `TIMES` [m], shape B + (N, 2).
      duration: of the engagement [s], shape B or (); what comes after it and the last flight does not count.
    """
    xp = namespace(place, way)
    time = lift(xp.asarray(TIMES, dtype=way.dtype), way[..., 0])
    counts = time <= xp.asarray(duration)[..., None] + FLIGHT_S
    distance = place[..., 0]
    forward, lateral = (xp.max(xp.where(counts, xp.abs(way[..., index]), 0.0), axis=-1) for index in (0, 1))
    moved = xp.sqrt(xp.sum((way[..., 1:, :] - way[..., :-1, :]) ** 2, axis=-1))
    speed = xp.max(xp.where(counts[..., 1:], moved, 0.0), axis=-1) / STEP_S
    excess = xp.maximum(forward / (LARGEST_FORWARD * distance), lateral / (LARGEST_LATERAL * distance))
    less = 1.0 / xp.maximum(xp.maximum(excess, speed / LARGEST_SPEED), 1.0)
    level = place[..., None, :2] + less[..., None, None] * way
    height = place[..., None, 2:] + 0.0 * level[..., :1]
    zero = 0.0 * distance
    return Path(xp.astype(xp.concat([level, height], axis=-1), place.dtype), zero + BEGIN_S, zero + STEP_S)

"""How far a target was from where it was expected: what its past says about whether it keeps its velocity.

At each decision the velocity is taken to stay as it is. Some decisions later the target's place is compared with where
that would have led, across the line of sight. Means of these errors, over a short and a long time, tell a target that
drives on for long from one that stops or turns back again and again.
"""

from typing import NamedTuple

from archerfish.arrays import Array, namespace
from archerfish.tracking.detections import level_distance

HORIZON_S = 0.2
"""How far ahead a velocity is taken to stay, about the time until a pellet arrives [s]."""
MEMORIES_S = (0.3, 1.5)
"""Time constants of the means [s]."""
UNIT_M, LARGEST_ERROR = 0.05, 4.0
"""Unit of errors [m], and their bound in that unit."""


class PredictionErrors(NamedTuple):
    """Errors of the latest predictions, in units of `UNIT_M`."""

    before: Array  # at the last decisions, oldest first: place [m], velocity [m/s] and time [s], B + (K, 5)
    latest: Array  # to the left, B
    means: Array  # error, distance driven, and error along the velocity, for each of `MEMORIES_S`, B + (6,)


def begin_errors(place: Array, velocity: Array, count: int) -> PredictionErrors:
    """Begin at the first decision, without errors.

    Args:
      place: of the target against the own pivot [m], shape B + (2,).
      velocity: against the own one [m/s], shape B + (2,).
      count: K, decisions from a prediction to its comparison.
    """
    xp, none = namespace(place), 0.0 * place[..., 0]
    now = _row(place, velocity, none)
    return PredictionErrors(xp.stack([now] * count, axis=-2), none, xp.stack([none] * 6, axis=-1))


def step_errors(
    errors: PredictionErrors, place: Array, velocity: Array, clock: Array, elapsed: Array
) -> PredictionErrors:
    """Compare the oldest prediction with where the target is, and remember the newest one.

    Args:
      errors: before.
      place: of the target against the own pivot [m], shape B + (2,).
      velocity: against the own one [m/s], shape B + (2,).
      clock: time since the first decision [s], shape B.
      elapsed: since the last decision [s], shape B.
    """
    xp = namespace(place, clock)
    oldest = errors.before[..., 0, :]
    start, speed, ahead = oldest[..., :2], oldest[..., 2:4], clock[..., None] - oldest[..., 4:]
    direction = place / xp.maximum(level_distance(place), 1e-6)[..., None]

    def left(level: Array) -> Array:
        return direction[..., 0] * level[..., 1] - direction[..., 1] * level[..., 0]

    error, driven = left(place - start - ahead * speed), left(place - start)
    sizes = xp.abs(error), xp.abs(driven), error * xp.tanh(5.0 * left(speed))
    numbers = xp.clip(xp.stack([error, *sizes], axis=-1) / UNIT_M, -LARGEST_ERROR, LARGEST_ERROR)
    due = clock >= HORIZON_S - 0.25 * elapsed
    means = []
    for at, memory in enumerate(MEMORIES_S):
        mean = errors.means[..., 3 * at : 3 * at + 3]
        share = xp.where(due, xp.clip(elapsed / memory, 0.0, 1.0), 0.0 * elapsed)
        means.append(mean + share[..., None] * (numbers[..., 1:] - mean))
    newest = _row(place, velocity, clock)[..., None, :]
    before = xp.concat([errors.before[..., 1:, :], newest], axis=-2)
    return PredictionErrors(before, xp.where(due, numbers[..., 0], errors.latest), xp.concat(means, axis=-1))


def _row(place: Array, velocity: Array, clock: Array) -> Array:
    return namespace(place).concat([place, velocity, clock[..., None]], axis=-1)

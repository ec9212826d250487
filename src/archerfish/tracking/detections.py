"""Detections in camera frames as trackers use them: slots without identity, frames that are missing, a base that moves.

A tracker keeps its estimate in frame O as of the latest detection, with its age. Frames are processed oldest first;
from each the detection nearest to the predicted place is taken. Detection noise lies along and across the line from
the own pivot at the exposure, so filters update relative to that pivot.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from archerfish.arrays import Array, fold, lift, namespace, select
from archerfish.dynamics.muzzle import direction
from archerfish.protocols import Base, Frames, Seen

T = TypeVar("T")  # state of a tracker
GUESS_DISTANCE_M, GUESS_AGE_S = 3.0, 1.0
"""Where a target is assumed ahead of the barrel while no frame has shown any, and the age of that guess."""


class Detection(NamedTuple):
    """The detection of a frame that a tracker takes, with the fields below; O is the frame at rest.

    `place` and `own` are positions in O [m], B + (3,); `distance` [m], `age` [s] and `fresh` (bool) have shape B.
    """

    place: Array  # in O [m], B + (3,); the predicted place where there is none
    distance: Array  # from the predicted place [m], B
    own: Array  # the own pivot at the exposure, in O [m], B + (3,)
    age: Array  # since the exposure [s], B
    fresh: Array  # whether there is one that is not in the estimate yet, bool, B


def first_detection(seen: Seen) -> Detection:
    """Return the latest detection at the first decision, the nearest of its frame; where there is none, a guess.

    The guess is 3 m ahead of the barrel, with an age of 1 s and `fresh` false.

    Args:
      seen: at the first decision, shape B.
    """
    xp = namespace(seen.command)
    guess = seen.base.position + GUESS_DISTANCE_M * direction(seen.command)
    none = seen.elapsed < 0.0  # false, of the batch's shape
    begun = Detection(guess, 0.0 * seen.elapsed, seen.base.position, seen.elapsed + GUESS_AGE_S, none)

    def latest(before: Detection, frame: Frames) -> Detection:
        valid = frame.received[..., None] & frame.found
        place, distance = _nearest(valid, frame.position, seen.base.position)
        found = xp.any(valid, axis=-1)
        return select(found, Detection(place, distance, _own(seen.base, frame.age), frame.age, found), before)

    return _fold(latest, begun, seen)


def update_with_frames(
    update: Callable[[Any, Detection], Any], predicted: Callable[[Any, Array], Array], state: Any, seen: Seen
) -> Any:
    """Update a tracker with the frames that were received since the last decision.

    Args:
      update: (state, detection) → state; a detection that is not fresh must leave the estimate as it is.
      predicted: (state, age) → where the target was so long before now, in O [m], B → B + (3,).
      state: of the tracker.
      seen: at this decision; the frames of the first one are in the state already, by `first_detection`.
    """
    xp = namespace(seen.command)

    def take(before: Any, frame: Frames) -> Any:
        valid = frame.received[..., None] & frame.found
        # Kept out of `valid`, which may be a constant to the compiler.
        fresh = xp.any(valid, axis=-1) & (seen.elapsed > 0.0)
        place, distance = _nearest(valid, frame.position, predicted(before, frame.age))
        return update(before, Detection(place, distance, _own(seen.base, frame.age), frame.age, fresh))

    return _fold(take, state, seen)


def relative_place(place: Array, base: Base, time: Array) -> Array:
    """Return a place relative to the own pivot, which goes on at its velocity, as do the pellets.

    Args:
      place: of the target a time from now, in O [m], shape B + (3,).
      base: now.
      time: from now [s], shape B.
    """
    return place - base.position - time[..., None] * base.velocity


def unwrapped(angle: Array, command: Array) -> Array:
    """Return the same direction with the yaw nearest to that of a command: in O yaw is not wrapped.

    Args:
      angle: pitch and yaw [rad], shape B + (2,).
      command: in force [rad], shape B + (2,).
    """
    xp = namespace(angle)
    turn = lift(xp.asarray([0.0, 2.0 * xp.pi], dtype=angle.dtype), angle)  # elementwise: fuses with what follows
    return angle + turn * xp.round((command - angle) / (2.0 * xp.pi))


def azimuth_near(place: Array, other: Array) -> Array:
    """Return the azimuth of a place, shape B + (3,), as near as can be to another, shape B [rad]."""
    xp = namespace(place)
    angle = xp.atan2(place[..., 1], place[..., 0])
    return angle + 2.0 * xp.pi * xp.round((other - angle) / (2.0 * xp.pi))


def level_distance(place: Array) -> Array:
    """Return the distance on level ground [m], shape B + (3,) → B."""
    return namespace(place).sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)


def _fold(function: Callable[[T, Frames], T], state: T, seen: Seen) -> T:
    return fold(function, state, seen.frames, seen.elapsed.ndim)


def _own(base: Base, age: Array) -> Array:
    return base.position - age[..., None] * base.velocity


def _nearest(valid: Array, position: Array, here: Array) -> tuple[Array, Array]:
    """Return the valid place nearest to a point and its distance; the point itself where none is valid."""
    xp = namespace(position)
    # Replaced before any arithmetic: of a masked zero a Kalman update makes 0/0, and NaN gradients behind a `where`.
    place = xp.where(valid[..., None], position, here[..., None, :])
    square = xp.sum((place - here[..., None, :]) ** 2, axis=-1)
    if valid.shape[-1] == 1:
        return place[..., 0, :], xp.sqrt(square[..., 0] + 1e-20)
    square = xp.where(valid, square, 1e12)
    slot = xp.argmin(square, axis=-1)[..., None]
    nearest = xp.take_along_axis(place, slot[..., None], axis=-2)[..., 0, :]
    return nearest, xp.sqrt(xp.take_along_axis(square, slot, axis=-1)[..., 0] + 1e-20)

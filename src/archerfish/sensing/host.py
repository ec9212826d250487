"""What a program makes of the messages of a robot: the gimbal as of its latest report, the plate in the base frame.

A frame shows the plate in the camera's frame, at its exposure; where the gimbal pointed then is looked up in its
reports, which are stamped. With the angles of another moment a turning gimbal would seem to move the plate.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.muzzle import direction

Array = NDArray[np.float64]

REMEMBERED_S = 0.25
"""Reports are kept for so long [s]; no frame comes later than that."""


class Reports(NamedTuple):
    """What the gimbal reported of late, oldest first.

    A place that no report has taken repeats the one before, or has a stamp of −∞ where there is none.
    """

    stamp: Array
    """When its sensors were read [s], rising, shape (B, L)."""
    angle: Array
    """Pitch and yaw [rad], shape (B, L, 2)."""
    rate: Array
    """Their rates [rad/s], shape (B, L, 2)."""


class Frames(NamedTuple):
    """Frames of late that show the plate, oldest first; places without one have a moment of −∞."""

    exposed: Array
    """When, on the clock of the reports [s], rising, shape (B, L)."""
    position: Array
    """The plate in the camera's frame [m], shape (B, L, 3)."""


class Sighting(NamedTuple):
    """The plate as seen last."""

    plate: Array
    """In the base frame [m], shape (B, 3)."""
    exposed: Array
    """When [s], shape (B,)."""
    fresh: NDArray[np.bool_]
    """Whether it came with the latest messages, shape (B,)."""


def no_reports(batch: int) -> Reports:
    """Return the memory of a program that has just begun."""
    return Reports(np.full((batch, 1), -np.inf), np.zeros((batch, 1, 2)), np.zeros((batch, 1, 2)))


def no_frames(batch: int) -> Frames:
    """Return the memory of a program that has just begun."""
    return Frames(np.full((batch, 1), -np.inf), np.zeros((batch, 1, 3)))


def with_frames(frames: Frames, exposed: Array, found: NDArray[np.bool_], position: Array, now: float) -> Frames:
    """Add frames that show the plate, and forget old ones.

    Args:
      frames: known so far.
      exposed: when each new one was exposed, on the clock of the reports [s], NaN where there is none, shape (B, G).
      found: whether it shows the plate, shape (B, G).
      position: the plate in the camera's frame [m], shape (B, G, 3).
      now: the present [s].
    """
    missing = np.isnan(exposed) | ~found
    stamps = np.concatenate([frames.exposed, np.where(missing, -np.inf, exposed)], axis=1)
    places = np.concatenate([frames.position, np.where(missing[..., None], 0.0, position)], axis=1)
    order = _of_late(stamps, now)
    return Frames(np.take_along_axis(stamps, order, axis=1), np.take_along_axis(places, order[..., None], axis=1))


def with_reports(reports: Reports, stamp: Array, angle: Array, rate: Array, now: float) -> Reports:
    """Add reports and forget old ones.

    Args:
      reports: known so far.
      stamp: of the new ones [s], NaN where there is none, shape (B, F).
      angle: shape (B, F, 2).
      rate: shape (B, F, 2).
      now: the present [s].
    """
    unsorted = Reports(np.where(np.isnan(stamp), -np.inf, stamp), angle, rate)
    new = _taken(unsorted, np.argsort(unsorted.stamp, axis=1, kind="stable"))
    # With the latest report in the place of each that is missing, those of before need not move: there are hundreds.
    latest, missing = Reports(*(each[:, -1:] for each in reports)), np.isinf(new.stamp)
    new = Reports(
        np.where(missing, latest.stamp, new.stamp),
        *(np.where(missing[..., None], old, each) for old, each in zip(latest[1:], new[1:], strict=True)),
    )
    joined = Reports(*(np.concatenate(each, axis=1) for each in zip(reports, new, strict=True)))
    if np.any(new.stamp < latest.stamp):
        joined = _taken(joined, np.argsort(joined.stamp, axis=1, kind="stable"))
    kept = _kept(joined.stamp, now)
    return Reports(*(each[:, -kept:] for each in joined))


def _taken(reports: Reports, order: NDArray[np.int64]) -> Reports:
    """Return the reports in another order, shape (B, L)."""
    trial = np.arange(len(order))[:, None]
    return Reports(*(each[trial, order] for each in reports))


def angle_at(reports: Reports, moment: Array) -> Array:
    """Interpolate the gimbal's angles at moments [s], shape (B, G) → (B, G, 2); before the first report they are held.

    Args:
      reports: at least one per trial.
      moment: up to the last report; may be NaN.
    """
    latest = reports.stamp.shape[1] - 1
    after = np.sum(reports.stamp[:, None, :] <= moment[..., None], axis=-1)
    first = np.argmax(np.isfinite(reports.stamp), axis=1)[:, None]
    low, high = np.clip(after - 1, first, latest), np.clip(after, first, latest)
    begin, end = (np.take_along_axis(reports.stamp, index, axis=1) for index in (low, high))
    gap = end - begin
    share = np.where(gap > 0.0, np.clip((moment - begin) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0), 0.0)
    here, there = (np.take_along_axis(reports.angle, index[..., None], axis=1) for index in (low, high))
    return np.asarray(here + share[..., None] * (there - here))


def into_base(position: Array, angle: Array) -> Array:
    """Turn a place in the camera's frame, shape B + (3,), into the base frame by pitch and yaw, shape B + (2,)."""
    forward = direction(angle)
    yaw = angle[..., 1]
    left = np.stack([-np.sin(yaw), np.cos(yaw), 0.0 * yaw], axis=-1)
    upward = np.cross(forward, left)
    return np.asarray(position[..., :1] * forward + position[..., 1:2] * left + position[..., 2:] * upward)


def _of_late(stamps: Array, now: float) -> NDArray[np.int64]:
    """Return the order of the stamps by time, shape (B, L) → (B, kept), without those that no trial needs any more."""
    return np.argsort(stamps, axis=1, kind="stable")[:, -_kept(stamps, now) :]


def _kept(stamps: Array, now: float) -> int:
    """Return how many of the latest stamps some trial still needs, at least one, shape (B, L)."""
    return int(np.max(np.sum(stamps > now - REMEMBERED_S, axis=1), initial=1))


def latest_sighting(sighting: Sighting, reports: Reports, frames: Frames) -> Sighting:
    """Take in the latest frame that the reports cover.

    A frame that is newer than the latest report waits: where the gimbal pointed then is not known yet, and a guess
    would move the plate while the gimbal turns.

    Args:
      sighting: before.
      reports: of the gimbal.
      frames: of late, those that waited included.
    """
    stamp, position = frames
    usable = (stamp <= reports.stamp[:, -1:]) & (stamp > sighting.exposed[:, None])
    newest = np.argmax(np.where(usable, stamp, -np.inf), axis=1)[:, None]
    moment = np.take_along_axis(stamp, newest, axis=1)
    place = np.take_along_axis(position, newest[..., None], axis=1)
    plate = into_base(place, angle_at(reports, moment))[:, 0]
    fresh = np.any(usable, axis=1)
    return Sighting(
        np.where(fresh[:, None], plate, sighting.plate), np.where(fresh, moment[:, 0], sighting.exposed), fresh
    )

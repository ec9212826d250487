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
    """What the gimbal reported of late, oldest first; places without a report have a stamp of −∞."""

    stamp: Array
    """When its sensors were read [s], rising, shape (B, L)."""
    angle: Array
    """Pitch and yaw [rad], shape (B, L, 2)."""
    rate: Array
    """Their rates [rad/s], shape (B, L, 2)."""


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


def with_reports(reports: Reports, stamp: Array, angle: Array, rate: Array, now: float) -> Reports:
    """Add reports and forget old ones.

    Args:
      reports: known so far.
      stamp: of the new ones [s], NaN where there is none, shape (B, F).
      angle: shape (B, F, 2).
      rate: shape (B, F, 2).
      now: the present [s].
    """
    missing = np.isnan(stamp)
    stamps = np.concatenate([reports.stamp, np.where(missing, -np.inf, stamp)], axis=1)
    angles = np.concatenate([reports.angle, np.where(missing[..., None], 0.0, angle)], axis=1)
    rates = np.concatenate([reports.rate, np.where(missing[..., None], 0.0, rate)], axis=1)
    order = np.argsort(stamps, axis=1, kind="stable")
    kept = int(np.max(np.sum(stamps > now - REMEMBERED_S, axis=1), initial=1))
    order = order[:, -max(kept, 1) :]
    return Reports(
        np.take_along_axis(stamps, order, axis=1),
        np.take_along_axis(angles, order[..., None], axis=1),
        np.take_along_axis(rates, order[..., None], axis=1),
    )


def angle_at(reports: Reports, moment: Array) -> Array:
    """Interpolate the gimbal's angles at moments [s], shape (B, G) → (B, G, 2).

    Before the first report the angle is held; after the last one it goes on at the reported rate.

    Args:
      reports: at least one per trial.
      moment: may be NaN.
    """
    latest = reports.stamp.shape[1] - 1
    after = np.sum(reports.stamp[:, None, :] <= moment[..., None], axis=-1)
    first = np.argmax(np.isfinite(reports.stamp), axis=1)[:, None]
    low, high = np.clip(after - 1, first, latest), np.clip(after, first, latest)
    begin, end = (np.take_along_axis(reports.stamp, index, axis=1) for index in (low, high))
    gap = end - begin
    share = np.where(gap > 0.0, np.clip((moment - begin) / np.where(gap > 0.0, gap, 1.0), 0.0, 1.0), 0.0)
    here, there = (np.take_along_axis(reports.angle, index[..., None], axis=1) for index in (low, high))
    beyond = np.clip(np.nan_to_num(moment - reports.stamp[:, -1:]), 0.0, REMEMBERED_S)
    return np.asarray(here + share[..., None] * (there - here) + beyond[..., None] * reports.rate[:, -1:])


def into_base(position: Array, angle: Array) -> Array:
    """Turn a place in the camera's frame, shape B + (3,), into the base frame by pitch and yaw, shape B + (2,)."""
    forward = direction(angle)
    yaw = angle[..., 1]
    left = np.stack([-np.sin(yaw), np.cos(yaw), 0.0 * yaw], axis=-1)
    upward = np.cross(forward, left)
    return np.asarray(position[..., :1] * forward + position[..., 1:2] * left + position[..., 2:] * upward)


def with_frames(
    sighting: Sighting, reports: Reports, exposed: Array, found: NDArray[np.bool_], position: Array
) -> Sighting:
    """Take in new frames: the one that was exposed last counts.

    Args:
      sighting: before.
      reports: of the gimbal, those that came with the frames included.
      exposed: when each frame was exposed, on the clock of the reports [s], NaN where there is none, shape (B, G).
      found: whether it shows the plate, shape (B, G).
      position: the plate in the camera's frame [m], shape (B, G, 3).
    """
    if exposed.shape[1] == 0:
        return sighting._replace(fresh=np.zeros_like(sighting.fresh))
    usable = found & ~np.isnan(exposed) & (exposed > sighting.exposed[:, None])
    newest = np.argmax(np.where(usable, exposed, -np.inf), axis=1)[:, None]
    moment = np.take_along_axis(exposed, newest, axis=1)
    place = np.take_along_axis(position, newest[..., None], axis=1)
    plate = into_base(np.where(np.isnan(place), 0.0, place), angle_at(reports, moment))[:, 0]
    fresh = np.any(usable, axis=1)
    return Sighting(
        np.where(fresh[:, None], plate, sighting.plate), np.where(fresh, moment[:, 0], sighting.exposed), fresh
    )

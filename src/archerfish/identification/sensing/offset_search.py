"""Rough time offset between camera and gimbal: where the plate's azimuth best mirrors the yaw."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.sensing.gimbal_track import GimbalTrack
from archerfish.records.errors import InputError

Array = NDArray[np.float64]

STEP = 0.005
"""Distance of the offsets tried [s]."""
NEAR = 1.0
"""Offsets up to this [s] are tried where the clocks of both logs overlap."""
_INSIDE = 0.8
_AMBIGUOUS = 1.5
_APART = 0.05


class OffsetScan(NamedTuple):
    """How well the azimuth mirrors the yaw at each offset tried."""

    offset: Array
    """What is added to the stamps of detections [s], shape (M,)."""
    misfit: Array
    """Robust standard deviation of azimuth plus yaw [rad], shape (M,)."""


def search_offset(
    track: GimbalTrack, stamps: Array, azimuth: Array, max_offset: float | None = None
) -> tuple[float, OffsetScan]:
    """Try offsets and return the best with the whole scan.

    Args:
      track: the gimbal.
      stamps: of the detections, on the camera's clock [s], shape (K,).
      azimuth: of the plate in the camera's frame [rad], shape (K,).
      max_offset: largest offset that is tried [s]; `NEAR` if not given and the clocks overlap, else any.

    Raises:
      InputError: if the logs can't overlap, the azimuth doesn't mirror the yaw at any offset, or at several.
    """
    offsets = _candidates(track.time, stamps, max_offset)
    # A few detections of something else must not steer the search.
    middle = np.median(azimuth)
    reach = 3 * 1.4826 * np.median(np.abs(azimuth - middle))
    clipped = np.clip(azimuth, middle - reach, middle + reach)
    lines = np.array([_line(track, stamps + offset, clipped) for offset in offsets])
    best = int(np.argmax(np.abs(lines[:, 0])))
    _check_mirror(float(lines[best, 0]), float(lines[best, 1]))
    misfit = np.array([_misfit(track, stamps + offset, azimuth) for offset in offsets])
    best = int(np.argmin(misfit))
    _check_unique(offsets, misfit, best)
    return float(offsets[best]), OffsetScan(offsets, misfit)


def _candidates(time: Array, stamps: Array, max_offset: float | None) -> Array:
    """Return the offsets that lay most of the detections inside the gimbal log."""
    slack = (1 - _INSIDE) * (stamps[-1] - stamps[0])
    low, high = time[0] - stamps[0] - slack, time[-1] - stamps[-1] + slack
    limit = max_offset if max_offset is not None else NEAR if low <= 0 <= high else np.inf
    low, high = max(low, -limit), min(high, limit)
    if low > high:
        raise InputError(
            f"the gimbal log ({time[-1] - time[0]:.1f} s) does not cover the detections "
            f"({stamps[-1] - stamps[0]:.1f} s) at any offset within ±{limit:g} s; log the gimbal before, during and "
            "after the sweep, or raise --max-offset-s"
        )
    return np.asarray(np.arange(np.floor(low / STEP), np.ceil(high / STEP) + 1) * STEP)


def _yaw_inside(track: GimbalTrack, moments: Array) -> tuple[Array, NDArray[np.bool_]]:
    inside = (moments >= track.time[0]) & (moments <= track.time[-1])
    return np.interp(moments[inside], track.time, track.yaw), inside


def _line(track: GimbalTrack, moments: Array, azimuth: Array) -> tuple[float, float]:
    """Return the correlation of azimuth and yaw, and the slope."""
    yaw, inside = _yaw_inside(track, moments)
    if yaw.size < 10:
        return 0.0, 0.0
    x, y = yaw - yaw.mean(), azimuth[inside] - azimuth[inside].mean()
    products, squares = float(x @ y), float(x @ x)
    scale = float(np.sqrt(squares * (y @ y)))
    return (products / scale, products / squares) if scale > 0 else (0.0, 0.0)


def _misfit(track: GimbalTrack, moments: Array, azimuth: Array) -> float:
    yaw, inside = _yaw_inside(track, moments)
    if yaw.size < 10:
        return np.inf
    total = azimuth[inside] + yaw
    return float(1.4826 * np.median(np.abs(total - np.median(total))))


def _check_mirror(correlation: float, slope: float) -> None:
    if abs(correlation) < 0.9:
        raise InputError(
            f"the plate's bearing follows the yaw at no offset (correlation {correlation:.2f} at best); keep the plate "
            "still, sweep the yaw by more than 10° and pass the two logs of one recording"
        )
    for factor, found in ((180 / np.pi, "radians and detections as if in degrees"), (np.pi / 180, "degrees")):
        if 0.7 < abs(slope) / factor < 1.4:
            raise InputError(
                f"the plate's bearing moves by {abs(slope):.3g} times the yaw: the gimbal's angles seem to be in "
                f"{found}; say --degrees if they are in degrees, else leave it out"
            )
    if 0.7 < slope < 1.4:
        raise InputError(
            "the plate's bearing moves with the yaw, not against it: yaw and y must both be positive to the left; "
            "turn the sign of one column, or name the frame of the detections"
        )
    if not -1.4 < slope < -0.7:
        raise InputError(
            f"the plate's bearing moves by {slope:.3g} times the yaw, expected about -1; check the units of the "
            "angles, the camera's calibration and that the plate stands still"
        )


def _check_unique(offsets: Array, misfit: Array, best: int) -> None:
    away = np.abs(offsets - offsets[best]) > _APART
    rivals = away & (misfit < _AMBIGUOUS * misfit[best])
    if rivals.any():
        rival = offsets[rivals][np.argmin(misfit[rivals])]
        raise InputError(
            f"the sweep repeats itself: offsets of {offsets[best]:.3f} s and {rival:.3f} s fit alike; record a sweep "
            "whose frequency changes, or narrow the search with --max-offset-s"
        )

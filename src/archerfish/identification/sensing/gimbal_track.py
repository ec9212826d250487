"""A gimbal log as angles at any moment, and what it shows of the feedback: how often it is refreshed, how finely."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from archerfish.identification.doctor.time_stamps import GAP_PERIODS
from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import GimbalLog

Array = NDArray[np.float64]

_SMOOTHED = 0.025
"""Span of the local cubics [s]: a gimbal moves at some 10 Hz and below, where they are exact to 0.1 %."""
_HELD_SHARE = 0.2
_MARGIN = 0.05
"""Time to the ends of a log within which its angles count as not logged, and the shortest gap in it [s]."""


class GimbalTrack(NamedTuple):
    """A gimbal's angles between samples."""

    time: Array
    """Moments of the nodes [s], shape (N,)."""
    yaw: Array
    """Smoothed yaw at the nodes [rad], shape (N,)."""
    angles: CubicSpline
    """Yaw and pitch over time [rad], result of shape B + (2,)."""


class Feedback(NamedTuple):
    """What a log shows of the feedback."""

    rate_hz: float
    """How often the angle is refreshed [Hz]."""
    quantum: float | None
    """Step of the angle [rad], where it is visible."""
    fresh: NDArray[np.bool_]
    """Samples that are not a repetition of the one before while the axis moves, shape (N,)."""


def examine_feedback(log: GimbalLog) -> Feedback:
    """Find the rate at which the logged yaw is refreshed, which may be below the rate of the log, and its quantum.

    Raises:
      InputError: if the log has fewer than 20 samples or its yaw never changes.
    """
    if log.time.size < 20:
        raise InputError(f"{log.source}: {log.time.size} samples are too few, expected at least 20; record longer")
    if np.ptp(log.yaw) == 0:
        raise InputError(f"{log.source}: the yaw is {log.yaw[0]:g} rad throughout; pass a log in which it moves")
    quantum = _quantum(log.yaw)
    fresh = np.ones(log.time.size, dtype=bool)
    changed = np.diff(log.yaw) != 0
    # Neighbouring samples may agree only because an angle is rounded; not while it crosses several steps per sample.
    period = float(np.median(np.diff(log.time)))
    reach = max(int(_SMOOTHED / period), 2)
    speed = np.abs(log.yaw[2 * reach :] - log.yaw[: -2 * reach]) / (2 * reach)
    moving = np.concatenate([np.zeros(reach, bool), speed > 2 * (quantum or 1e-9), np.zeros(reach, bool)])[1:]
    held = float(np.mean(~changed[moving])) if moving.sum() >= 20 else 0.0
    if held > _HELD_SHARE:
        fresh[1:] = changed | ~moving
        return Feedback((1 - held) / period, quantum, fresh)
    return Feedback((log.time.size - 1) / float(log.time[-1] - log.time[0]), quantum, fresh)


def _quantum(angles: Array) -> float | None:
    """Return the step of which all differences are multiples, None if the levels are too many to tell."""
    levels = np.unique(angles)
    if levels.size < 3 or levels.size > angles.size / 2:
        return None
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9]
    # Printing rounds the levels: the smallest gaps scatter about the step.
    quantum = float(np.mean(gaps[gaps < 1.5 * gaps.min()]))
    steps = np.round(gaps / quantum)
    quantum = float(gaps.sum() / steps.sum())
    return quantum if np.mean(np.abs(gaps / quantum - steps) < 0.2) > 0.95 else None


def gimbal_track(log: GimbalLog, fresh: NDArray[np.bool_]) -> GimbalTrack:
    """Interpolate a log's angles by cubics; where it is sampled densely, smooth the encoder's steps first.

    Args:
      log: the log.
      fresh: samples to use, shape (N,).
    """
    time = log.time[fresh]
    angles = np.column_stack([log.yaw, log.pitch])[fresh]
    count = int(_SMOOTHED / float(np.median(np.diff(time)))) // 2 * 2 + 1
    if count >= 7 and time.size > count:
        even = np.linspace(time[0], time[-1], time.size)
        resampled = np.column_stack([np.interp(even, time, angle) for angle in angles.T])
        time, angles = even, savgol_filter(resampled, count, 3, axis=0)
    return GimbalTrack(time, angles[:, 0], CubicSpline(time, angles))


def is_logged(log: GimbalLog, track: GimbalTrack, moments: Array) -> NDArray[np.bool_]:
    """Return at which moments the gimbal's angle is logged: not outside the log, nor in a gap of it.

    Args:
      log: the log.
      track: its angles.
      moments: on the log's clock [s], shape (K,).

    Returns:
      Shape (K,).
    """
    intervals = np.diff(log.time)
    gaps = intervals > max(_MARGIN, GAP_PERIODS * float(np.median(intervals)))
    interval = np.clip(np.searchsorted(log.time, moments) - 1, 0, intervals.size - 1)
    inside = (moments > track.time[0] + _MARGIN) & (moments < track.time[-1] - _MARGIN)
    return np.asarray(inside & ~gaps[interval])

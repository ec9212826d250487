"""A gimbal log as angles at any moment, and what it shows of the feedback: how often it is refreshed, how finely."""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from archerfish2.errors import InputError
from archerfish2.identification.statistics import Array
from archerfish2.logs.timing import GimbalLog

_SMOOTHED_S = 0.025  # span of the local cubics: a gimbal moves at some 10 Hz and below, where they are exact to 0.1 %
_HELD_SHARE = 0.2  # of repeated angles during motion, from which the feedback is slower than the log
_GAP_S, _GAP = 0.05, 3.0  # longest intervals that are no gap: in seconds, and in median intervals


class GimbalTrack(NamedTuple):
    """A gimbal's angles between samples."""

    time: Array  # moments of the nodes [s], (N,)
    angles: Any  # spline, moments (...) → yaw and pitch (..., 2) [rad]
    stamps: Array  # of the log's samples [s], (M,)
    rate_hz: float  # at which the logged yaw is refreshed [Hz]
    quantum: float | None  # step of the logged yaw [rad], where it is visible

    def covers(self, moments: Array) -> Any:
        """Return at which moments, shape (K,), the log has angles: neither outside it nor in a gap; shape (K,)."""
        longest = max(_GAP_S, _GAP * float(np.median(np.diff(self.stamps))))
        intervals = np.diff(self.stamps, prepend=-np.inf, append=np.inf)
        return intervals[np.searchsorted(self.stamps, moments)] <= longest


def gimbal_track(log: GimbalLog) -> GimbalTrack:
    """Interpolate a log's fresh angles by cubics; where they are dense, smooth the encoder's steps first.

    Raises:
      InputError: if the log has fewer than 20 samples or its yaw never changes.
    """
    time, yaw = np.asarray(log.time, float), np.asarray(log.yaw, float)
    if time.size < 20 or np.ptp(yaw) == 0:
        problem = f"the yaw has {np.unique(yaw).size} values in {time.size} samples"
        raise InputError(f"{log.source}: {problem}; log at least 20, in which it moves", "no-motion")
    quantum, fresh, changed = _quantum(yaw), np.ones(time.size, dtype=bool), np.diff(yaw) != 0
    # Neighbouring samples may agree only because an angle is rounded; not while it crosses several steps per sample.
    period = float(np.median(np.diff(time)))
    reach = max(int(_SMOOTHED_S / period), 2)
    speed = np.abs(yaw[2 * reach :] - yaw[: -2 * reach]) / (2 * reach)
    moving = np.pad(speed > 2 * (quantum or 1e-9), reach)[1:]
    repeated = float(np.mean(~changed[moving])) if moving.sum() >= 20 else 0.0
    rate = (time.size - 1) / float(time[-1] - time[0])
    if repeated > _HELD_SHARE:
        fresh[1:], rate = changed | ~moving, (1 - repeated) / period
    nodes, angles = time[fresh], np.column_stack([yaw, log.pitch])[fresh]
    count = int(_SMOOTHED_S / float(np.median(np.diff(nodes)))) // 2 * 2 + 1
    if 7 <= count < nodes.size:
        even = np.linspace(nodes[0], nodes[-1], nodes.size)
        nodes, angles = even, savgol_filter([np.interp(even, nodes, each) for each in angles.T], count, 3).T
    return GimbalTrack(nodes, CubicSpline(nodes, angles), time, rate, quantum)


def _quantum(angles: Array) -> float | None:
    """Return the step of which all differences are multiples; None where levels are too many to say."""
    gaps = np.diff(np.unique(angles))
    gaps = gaps[gaps > 1e-9]
    if gaps.size < 2:
        return None
    quantum = float(np.mean(gaps[gaps < 1.5 * gaps.min()]))  # printing rounds: the smallest gaps scatter about the step
    steps = gaps / quantum
    return quantum if np.mean(np.abs(steps - np.round(steps)) < 0.2) > 0.95 else None

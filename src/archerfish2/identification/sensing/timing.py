"""Frame period, share of missed frames, and jitter of the latency."""

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification import statistics
from archerfish2.identification.statistics import Array
from archerfish2.reports.table import Estimate

OUT_OF_VIEW_S = 0.25
"""Longer gaps are the plate out of view, not frames in which it was missed [s]."""


def frame_timing(stamps: Array, source: str = "detections") -> tuple[Estimate, Estimate]:
    """Estimate the frame period [s] and the share of frames without a detection.

    Stamps may jitter by up to a quarter of a period. Of the frames, those count that are not out of view.

    Args:
      stamps: increasing [s], shape (K,).
      source: name of the log, for messages.

    Raises:
      InputError: if there are fewer than 20 stamps, or hardly two close to each other.
    """
    intervals = np.diff(stamps)
    counted = intervals < OUT_OF_VIEW_S
    if stamps.size < 20 or counted.sum() < 10:
        problem = f"has {stamps.size} detections, {counted.sum()} of them within {OUT_OF_VIEW_S} s of the one before"
        raise InputError(f"{source}: {problem}; record longer, the plate in view", "too-short")
    # Where many frames are missed the median may already be two periods; a quartile is one up to 75 % of misses.
    period = float(np.median(intervals[intervals < 1.5 * np.quantile(intervals[counted], 0.25)]))
    steps, grid = np.empty(intervals.size), float(stamps[0])
    for index, stamp in enumerate(stamps[1:].tolist()):  # along the frames' grid, so that jitter counts once, not twice
        # Zero is allowed: a stamp that jumped ahead a whole period is followed by one that has no period of its own.
        steps[index] = count = max(round((stamp - grid) / period), 0)
        error = stamp - (grid + count * period)
        grid += count * period + 0.1 * error
        period += 0.002 * error / max(count, 1)
    seen = int(counted.sum()) + 1
    frames = max(int(steps[counted].sum()) + 1, seen)
    return _period(stamps, steps), statistics.share_estimate(frames - seen, frames)


def _period(stamps: Array, steps: Array) -> Estimate:
    """Estimate the period by how the errors of intervals follow each other.

    Jitter about an even grid makes a long interval follow a short one; the grid is then known far better than by the
    mean interval, whose standard error holds for a timer that each frame restarts.
    """
    index = np.concatenate([[0.0], np.cumsum(steps)])
    mean = float(stamps[-1] - stamps[0]) / index[-1]
    errors = np.diff(stamps) - steps * mean
    if errors[1:] @ errors[:-1] > -0.25 * (errors @ errors):
        return statistics.normal_estimate(mean, statistics.standard_error(errors) * errors.size / index[-1])
    slope, start = np.polyfit(index, stamps, 1)
    score = (index - index.mean()) * (stamps - start - slope * index)
    # Estimated from a line's residuals, the long-run variance comes out some percent low, and uncertain; stamps of a
    # grid are hardly ever known better than independent jitter lets them be.
    spread = max(statistics.long_run_covariance(score[:, None]).item(), float(np.mean(score**2)))
    return statistics.normal_estimate(slope, np.sqrt(spread * index.size) / np.sum((index - index.mean()) ** 2))


def latency_jitter(delay: Array, stamp_jitter: Estimate) -> Estimate:
    """Return the standard deviation of the latency, from the times between stamp and receipt [s], shape (K,)."""
    scatter = statistics.scatter_estimate(delay)
    if scatter.value < 1e-6:  # frames that are stamped on receipt carry the latency's jitter in their stamps
        return stamp_jitter
    rest = statistics.difference(*(statistics.converted(each, lambda sd: sd**2) for each in (scatter, stamp_jitter)))
    return statistics.converted(rest, lambda variance: float(np.sqrt(max(variance, 0.0))))

"""Frames and messages in time: period and missed frames, and the intervals of what is counted and averaged."""

from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, norm, trim_mean

from archerfish2.errors import InputError
from archerfish2.identification.statistics import Array, long_run_covariance
from archerfish2.reports.table import Estimate

Z95 = float(norm.ppf(0.975))
OUT_OF_VIEW_S = 0.25
"""Longer gaps are the plate out of view, not frames in which it was missed [s]."""
_IN_STEP = 200  # stamps that give the rough period: a timer restarted by each frame falls out of step later


class Frames(NamedTuple):
    """When frames came, and how many."""

    period: float  # time from frame to frame [s]
    period_sd: float  # its standard error [s]
    jitter: float  # standard deviation of an interval about its multiple of the period [s]
    seen: int  # frames with a detection
    missed: int  # frames without one between them
    out_of_view: int  # gaps that were left out


def frame_timing(stamps: Array, source: str = "detections") -> Frames:
    """Find the frame period and count the missing frames, while stamps jitter by less than a quarter of a period.

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
    short = intervals[intervals < 1.5 * np.quantile(intervals[counted], 0.25)]
    first, guess = stamps[:_IN_STEP] - stamps[0], float(np.median(short))
    frequencies = np.arange(0.7 / guess, 1.4 / guess, 0.4 / max(float(first[-1]), 20 * guess))
    powers = np.abs(np.exp(2j * np.pi * np.outer(frequencies, first)).sum(axis=1))
    steps = _steps(stamps, float(1 / frequencies[np.argmax(powers)]))
    period, period_sd = _refined(stamps, steps)
    seen, jitter = int(counted.sum()), float((intervals - steps * period)[counted].std())
    return Frames(period, period_sd, jitter, seen + 1, int(steps[counted].sum()) - seen, int((~counted).sum()))


def _steps(stamps: Array, period: float) -> Array:
    """Return the number of periods in each interval, following the frames' grid: jitter then counts once, not twice."""
    steps, grid = np.empty(stamps.size - 1), float(stamps[0])
    for index, stamp in enumerate(stamps[1:].tolist()):
        # Zero is allowed: a stamp that jumped ahead a whole period is followed by one that has no period of its own.
        steps[index] = count = max(round((stamp - grid) / period), 0)
        error = stamp - (grid + count * period)
        grid += count * period + 0.1 * error
        period += 0.002 * error / max(count, 1)
    return steps


def _refined(stamps: Array, steps: Array) -> tuple[float, float]:
    """Return the period and its standard error, by how the errors of intervals follow each other.

    Jitter about an even grid makes a long interval follow a short one; the grid is then known far better than by the
    mean interval, whose standard error holds for a timer that each frame restarts.
    """
    index = np.concatenate([[0.0], np.cumsum(steps)])
    mean = float(stamps[-1] - stamps[0]) / index[-1]
    errors = np.diff(stamps) - steps * mean
    if errors[1:] @ errors[:-1] > -0.25 * (errors @ errors):
        return mean, standard_error(errors) * errors.size / index[-1]
    slope, start = np.polyfit(index, stamps, 1)
    score = (index - index.mean()) * (stamps - start - slope * index)
    # Estimated from a line's residuals, the long-run variance comes out some percent low, and uncertain; stamps of a
    # grid are hardly ever known better than independent jitter lets them be.
    spread = max(long_run_covariance(score[:, None]).item(), float(np.mean(score**2)))
    return float(slope), float(np.sqrt(spread * index.size) / np.sum((index - index.mean()) ** 2))


def standard_error(series: Array) -> float:
    """Return the standard error of the mean of a series with serial correlation, shape (n,)."""
    return float(np.sqrt(max(long_run_covariance((series - series.mean())[:, None]).item(), 0.0) / series.size))


def normal_estimate(value: float, error: float, unit: str = "s") -> Estimate:
    """Return an estimate with the interval of a normal error."""
    return Estimate(value, value - Z95 * error, value + Z95 * error, unit)


def share_estimate(count: int, total: int) -> Estimate:
    """Return a share with Wilson's interval."""
    interval = binomtest(count, total).proportion_ci(method="wilson")
    return Estimate(count / total, interval.low, interval.high)


def deviation_estimate(variance: float, error: float, unit: str = "s") -> Estimate:
    """Return a standard deviation by its square and that square's standard error.

    Args:
      variance: the square.
      error: its standard error.
      unit: of the standard deviation.
    """
    if variance > 2 * error:
        # The logarithm of a variance is nearly normal long before the variance is.
        low, high = variance * np.exp(np.array([-Z95, Z95]) * error / variance)
    else:
        low, high = 0.0, variance + Z95 * error
    return Estimate(*np.sqrt([variance, low, high]).tolist(), unit)


def scatter_estimate(sample: Array) -> Estimate:
    """Return a standard deviation without the assumption of normality (Bonett 2006), of a sample of shape (n,) [s]."""
    count, squares = sample.size, (sample - sample.mean()) ** 2
    variance, correction = float(squares.sum()) / (count - 1), count / (count - Z95)
    trimmed = trim_mean(sample, 1 / (2 * np.sqrt(max(count - 4, 1))))
    kurtosis = count * float(np.sum((sample - trimmed) ** 4)) / max(float(squares.sum()) ** 2, 1e-300)
    error = correction * np.sqrt(max(kurtosis - (count - 3) / count, 0.0) / (count - 1))
    low, high = np.sqrt(correction * variance * np.exp(np.array([-Z95, Z95]) * error))
    return Estimate(float(np.sqrt(variance)), float(low), float(high), "s")


def difference(first: Estimate, second: Estimate) -> Estimate:
    """Return the difference of two independent estimates, whose errors add in squares."""
    value = first.value - second.value
    low = np.hypot(first.value - first.low, second.high - second.value)
    return Estimate(value, value - low, value + np.hypot(first.high - first.value, second.value - second.low), "s")

"""Rates and gaps that stamps show, and the standard error of a mean whose terms may be correlated."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from archerfish.records.errors import InputError

Array = NDArray[np.float64]
Interval = tuple[float, float]

Z95 = float(norm.ppf(0.975))
OUT_OF_VIEW = 0.25
"""Longer gaps [s] are the plate out of view, not frames in which it was missed."""
_IN_STEP = 200
"""Stamps from which the rough period comes: a timer that starts anew with each frame falls out of step later."""


class FrameTiming(NamedTuple):
    """When frames came, and how many."""

    period: float
    """Time from frame to frame [s]."""
    period_sd: float
    """Its standard error [s]."""
    jitter: float
    """Standard deviation of a stamped interval about its multiple of the period [s]."""
    seen: int
    """Frames with a detection."""
    missed: int
    """Frames without one between them."""
    out_of_view: int
    """Gaps that were left out because they are longer than `OUT_OF_VIEW`."""


def frame_timing(stamps: Array, source: str = "detections") -> FrameTiming:
    """Find the frame period and count the missing frames.

    An interval is a whole number of periods and jitter; the number is found by rounding to a grid that follows the
    stamps, which holds while their jitter is below a quarter of a period.

    Args:
      stamps: increasing [s], shape (K,).
      source: name of the log, for messages.

    Raises:
      InputError: if there are fewer than 20 stamps.
    """
    if stamps.size < 20:
        raise InputError(f"{source}: {stamps.size} detections are too few, expected at least 20; record longer")
    intervals = np.diff(stamps)
    within = intervals[intervals < OUT_OF_VIEW]
    if within.size < 10:
        raise InputError(f"{source}: hardly two detections come within {OUT_OF_VIEW} s; keep the plate in view")
    steps = _steps(stamps, _rough_period(stamps, within))
    counted = intervals < OUT_OF_VIEW
    period, period_sd = _refined(stamps, steps)
    errors = (intervals - steps * period)[counted]
    return FrameTiming(
        period=period,
        period_sd=period_sd,
        jitter=float(errors.std()),
        seen=int(counted.sum()) + 1,
        missed=int(steps[counted].sum()) - int(counted.sum()),
        out_of_view=int((~counted).sum()),
    )


def _rough_period(stamps: Array, within: Array) -> float:
    """Return the period at which the first few hundred stamps are most in step with each other."""
    # Where many frames are missed the median may already be two periods; a quartile is one up to 75 % of misses.
    short = float(np.quantile(within, 0.25))
    guess = float(np.median(within[within < 1.5 * short]))
    first = stamps[:_IN_STEP] - stamps[0]
    frequencies = np.arange(0.7 / guess, 1.4 / guess, 0.4 / max(float(first[-1]), 20 * guess))
    return float(1 / frequencies[np.argmax(np.abs(np.exp(2j * np.pi * np.outer(frequencies, first)).sum(axis=1)))])


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
    mean interval, whose standard error holds for a timer that starts anew with each frame.
    """
    total = float(steps.sum())
    mean = float(stamps[-1] - stamps[0]) / total
    errors = np.diff(stamps) - steps * mean
    if errors[1:] @ errors[:-1] > -0.25 * (errors @ errors):
        return mean, standard_error(errors) * errors.size / total
    index = np.concatenate([[0.0], np.cumsum(steps)])
    for _ in range(3):
        slope, start = np.polynomial.Polynomial.fit(index, stamps - stamps[0], 1).convert().coef[::-1]
        index = np.round((stamps - stamps[0] - start) / slope)
    mean, index = float(slope), index - index.mean()
    squares = float(index @ index)
    change = float(index @ (stamps - stamps.mean() - mean * index)) / squares
    residual = stamps - stamps.mean() - (mean + change) * index
    score = index * residual
    # Estimated from the residuals of the line, the long-run variance comes out some percent low, and uncertain; stamps
    # of a grid are hardly ever known better than independent jitter lets them be.
    spread = max(long_run_covariance(score[:, None]).item(), float(np.mean(score**2)))
    return mean + change, float(np.sqrt(spread * index.size)) / squares


def long_run_covariance(scores: Array) -> Array:
    """Covariance of √n times the mean of a series with serial correlation (Newey and West 1987, Bartlett's weights).

    Args:
      scores: n terms, shape (n, q), whose mean is taken as zero.

    Returns:
      Shape (q, q).
    """
    count = scores.shape[0]
    total = scores.T @ scores / count
    lags = min(int(np.ceil(4 * (count / 100) ** (2 / 9))) + 4, count - 1)
    for lag in range(1, lags + 1):
        cross = scores[lag:].T @ scores[:-lag] / count
        total = total + (1 - lag / (lags + 1)) * (cross + cross.T)
    return np.asarray(total)


def standard_error(series: Array) -> float:
    """Return the standard error of the mean of a series with serial correlation, shape (n,)."""
    centred = (series - series.mean())[:, None]
    return float(np.sqrt(max(long_run_covariance(centred).item(), 0.0) / series.size))


def around(value: float, error: float) -> Interval:
    """Return the 95 % interval of an estimate from its standard error."""
    return value - Z95 * error, value + Z95 * error


def share_interval(count: int, total: int) -> Interval:
    """Return Wilson's 95 % interval of a share."""
    share, z2 = count / total, Z95**2
    centre = (share + z2 / (2 * total)) / (1 + z2 / total)
    half = Z95 * np.sqrt(share * (1 - share) / total + z2 / (4 * total**2)) / (1 + z2 / total)
    return max(float(centre - half), 0.0), min(float(centre + half), 1.0)

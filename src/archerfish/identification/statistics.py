"""Variance components, intervals of a plain sample, and the variance of a mean under serial correlation."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from archerfish.reports.table import Estimate

Array = NDArray[np.float64]

_ROUNDS = 50
Z95 = float(ndtri(0.975))
"""Half width of a 95 % interval in standard errors."""


class VarianceComponents(NamedTuple):
    """Weighted least squares whose weights are estimated too; p coefficients, c variances."""

    coefficients: Array  # of the columns, (p,)
    variances: Array  # of the components, none negative, (c,)
    variances_covariance: Array  # of the variances, robust to tails that are not normal (sandwich), (c, c)
    unconstrained: Array  # the variances that Fisher scoring gives where they may be negative, (c,)
    errors: Array  # standard errors of the variances for normal noise, (c,)
    sd: Array  # of each measurement, (N,)


def variance_components(
    measured: Array, columns: Array, scales: Array, known: Array | float = 0.0
) -> VarianceComponents:
    """Fit measured = columns · β + noise, whose variance is scales · θ + known, by restricted maximum likelihood.

    REML (Patterson and Thompson 1971) by Fisher scoring: with V = diag(scales θ + known) and P = V⁻¹ − V⁻¹ X (Xᵀ V⁻¹
    X)⁻¹ Xᵀ V⁻¹ each step solves tr(P A_j P A_k) θ_k = yᵀ P A_j P y; θ ≥ 0 by non-negative least squares.

    Args:
      measured: y, shape (N,).
      columns: X, shape (N, p); a rank below p is allowed.
      scales: variance of each measurement per unit of each component, the diagonals of A_j, shape (N, c).
      known: part of the variance that is not estimated, shape (N,) or ().
    """
    from scipy.optimize import nnls  # slow to load

    count, components = scales.shape
    parts = np.column_stack([scales, np.broadcast_to(known, count)])  # the variance of the last one is 1
    scatter = np.mean((measured - columns @ np.linalg.lstsq(columns, measured)[0]) ** 2)
    theta = scatter / components / np.maximum(scales.mean(axis=0), 1e-300)
    for _ in range(_ROUNDS):
        variance = np.maximum(parts @ np.append(theta, 1.0), 1e-9 * scatter + 1e-300)
        root = 1 / np.sqrt(variance)
        left, size, right = np.linalg.svd(columns * root[:, None], full_matrices=False)
        rank = size > 1e-9 * size.max(initial=0.0)
        basis = left[:, rank]
        coefficients = right[rank].T @ (basis.T @ (measured * root) / size[rank])
        squares = ((measured - columns @ coefficients) * root) ** 2
        shares = parts / variance[:, None]
        inner = np.einsum("np,nj,nq->jpq", basis, shares, basis)
        information = shares.T @ (shares * (1 - 2 * np.sum(basis**2, axis=1))[:, None])
        information += np.einsum("jpq,kqp->jk", inner, inner)
        scale = 1 / np.sqrt(np.maximum(np.diag(information)[:-1], 1e-300))
        normal = information[:-1, :-1] * np.outer(scale, scale) + 1e-10 * np.eye(components)
        factor = np.linalg.cholesky(normal)
        target = scale * (shares[:, :-1].T @ squares - information[:-1, -1])
        before, theta = theta, scale * nnls(factor.T, np.linalg.solve(factor, target))[0]
        if np.max(np.abs(theta - before) / scale) <= 1e-7 * np.max(theta / scale):
            break
    bread = np.linalg.inv(normal) * np.outer(scale, scale)
    unconstrained, errors = bread @ (target / scale), np.sqrt(2 * np.diag(bread))
    scores = shares[:, :-1] * (squares - 1)[:, None]
    spread = bread @ (scores.T @ scores) @ bread
    return VarianceComponents(coefficients, theta, spread, unconstrained, errors, np.sqrt(variance))


def sample_mean(sample: Array, unit: str = "s") -> Estimate:
    """Return the mean of a normal sample, shape (N,) [s], with Student's interval; a single value has none."""
    if sample.size < 2:
        return Estimate(float(sample.mean()), np.nan, np.nan, unit)
    error = stdtrit(sample.size - 1, 0.975) / Z95 * sample.std(ddof=1) / np.sqrt(sample.size)
    return normal_estimate(sample.mean(), error, unit)


def _lags(count: int) -> int:
    """Return up to which lag the correlation of a series counts: four more than Newey and West (1994), within it."""
    return min(int(np.ceil(4 * (count / 100) ** (2 / 9))) + 4, count // 4)


def long_run_covariance(scores: Array) -> Array:
    """Covariance of √n times the mean of a series with serial correlation (Newey and West 1987, Bartlett's weights).

    Args:
      scores: n terms, shape (n, q), whose mean is taken as zero.

    Returns:
      Shape (q, q).
    """
    count, lags = len(scores), _lags(len(scores))
    crosses = [(1 - lag / (lags + 1)) * scores[lag:].T @ scores[: count - lag] for lag in range(1, lags + 1)]
    one_sided = sum(crosses, scores.T @ scores / 2)
    return np.asarray(one_sided + one_sided.T) / count


def standard_error(series: Array) -> float:
    """Return the standard error of the mean of a series with serial correlation, shape (n,).

    The variance is divided by its expectation for independent values, which the estimated mean makes less than one.
    """
    count, lag = series.size, np.arange(1, _lags(series.size) + 1)
    expected = 1 - 1 / count - 2 / count**2 * np.sum((1 - lag / (lag.size + 1)) * (count - lag))
    variance = long_run_covariance((series - series.mean())[:, None]).item() / expected
    return float(np.sqrt(max(variance, 0.0) / count))


def normal_estimate(value: float, error: float, unit: str = "s") -> Estimate:
    """Return an estimate with the interval of a normal error."""
    return Estimate(float(value), float(value - Z95 * error), float(value + Z95 * error), unit)


def mean_estimate(series: Array) -> Estimate:
    """Return the mean of a series with serial correlation, shape (n,) [s].

    The interval is Student's, with the 3 n / (2 (lags + 1)) degrees of freedom of Bartlett's weights (Priestley 1981),
    less one for the mean.
    """
    freedom = max(1.5 * series.size / (_lags(series.size) + 1) - 1, 1.0)
    return normal_estimate(series.mean(), stdtrit(freedom, 0.975) / Z95 * standard_error(series))


def share_estimate(count: int, total: int) -> Estimate:
    """Return a share with Wilson's interval."""
    from scipy.stats import binomtest  # slow to load

    low, high = binomtest(count, total).proportion_ci(method="wilson")
    return Estimate(count / total, low, high)


def deviation_estimate(variance: float, error: float, unit: str = "s") -> Estimate:
    """Return a standard deviation by its square and that square's standard error.

    Args:
      variance: the square.
      error: its standard error.
      unit: of the standard deviation.
    """
    low, high = 0.0, variance + Z95 * error
    if variance > 2 * error:  # the logarithm of a variance is nearly normal long before the variance is
        low, high = variance * np.exp(np.array([-Z95, Z95]) * error / variance)
    return converted(Estimate(variance, low, high), np.sqrt, unit)


def scatter_estimate(sample: Array) -> Estimate:
    """Return a standard deviation without the assumption of normality (Bonett 2006), of a sample of shape (n,) [s]."""
    from scipy.stats import trim_mean  # slow to load

    count, variance, correction = sample.size, float(sample.var(ddof=1)), sample.size / (sample.size - Z95)
    trimmed = trim_mean(sample, 1 / (2 * np.sqrt(max(count - 4, 1))))
    kurtosis = count * float(np.sum((sample - trimmed) ** 4)) / max((variance * (count - 1)) ** 2, 1e-300)
    error = correction * np.sqrt(max(kurtosis - (count - 3) / count, 0.0) / (count - 1))
    low, high = correction * variance * np.exp(np.array([-Z95, Z95]) * error)
    return converted(Estimate(variance, low, high), np.sqrt)


def difference(first: Estimate, second: Estimate) -> Estimate:
    """Return the difference of two independent estimates, whose errors add in squares."""
    value = first.value - second.value
    low = np.hypot(first.value - first.low, second.high - second.value)
    return Estimate(value, value - low, value + np.hypot(first.high - first.value, second.value - second.low), "s")


def converted(estimate: Estimate, change: Callable[[float], float], unit: str = "s") -> Estimate:
    """Return an estimate under a monotonic function."""
    low, high = sorted((change(estimate.low), change(estimate.high)))
    return Estimate(float(change(estimate.value)), float(low), float(high), unit)

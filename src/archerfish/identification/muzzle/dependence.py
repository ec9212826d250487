"""Shots that depend on the ones before, such as speeds that drift in rapid fire, and what that does to intervals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

Array = NDArray[np.float64]


class Succession(NamedTuple):
    """Durbin and Watson's test of a series in the order of fire."""

    statistic: float
    """Σ (e_i − e_{i−1})² / Σ e_i²: 2 where successive shots are independent, less where they are alike."""
    p_value: float
    """Chance of a statistic as low, if they are independent (normal approximation)."""


def durbin_watson(series: Array) -> Succession:
    """Test whether successive deviations are alike, shape (N,)."""
    total = float(series @ series)
    if total == 0.0:
        return Succession(2.0, 1.0)
    statistic = float(np.sum(np.diff(series) ** 2)) / total
    return Succession(statistic, float(norm.sf((1 - statistic / 2) * np.sqrt(series.size))))


def widening(scores: Array, information: Array) -> Array:
    """How much longer standard errors are than if the shots were independent, shape (k,), at least 1.

    Heteroscedasticity and autocorrelation consistent (HAC) over independent: Newey and West's long-run variance of the
    scores, with Bartlett's weights and Andrews' bandwidth, over their variance.

    Args:
      scores: each shot's part in the derivatives of the log-likelihood, shape (N, k).
      information: expected information, shape (k, k).
    """
    inverse = np.linalg.pinv(information)
    centred = scores - scores.mean(axis=0)
    own = centred.T @ centred
    total = own.copy()
    lags = _bandwidth(centred)
    for lag in range(1, lags + 1):
        product = centred[lag:].T @ centred[:-lag]
        total += (1 - lag / (lags + 1)) * (product + product.T)
    ratio = np.diag(inverse @ total @ inverse) / np.maximum(np.diag(inverse @ own @ inverse), 1e-300)
    return np.sqrt(np.maximum(ratio, 1.0))


def _bandwidth(scores: Array) -> int:
    """Andrews' lag for Bartlett's weights, from first-order autoregressions of the scores; at most N/4."""
    before, after = scores[:-1], scores[1:]
    rho = np.sum(before * after, axis=0) / np.maximum(np.sum(before**2, axis=0), 1e-300)
    rho = float(np.clip(np.max(np.abs(rho)), 0.0, 0.97))
    alpha = 4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)
    return int(min(np.ceil(1.1447 * (alpha * len(scores)) ** (1 / 3)), len(scores) // 4))

"""Tests of the residual of a free run: whether it depends on past inputs, and whether there is feedback.

Disturbances may be coloured, so the residual need not be white; what counts is that it does not depend on past inputs
(Söderström and Stoica, System Identification, 1989, section 11.2). For a fixed input u and a stationary
residual e that is independent of it, the sums Σₜ e[t] u[t−τ] have the covariances

    γ(d) = ∫ S_e(ω) |U(ω)|² exp(iωd) dω / 2π,    d the difference of two lags,

for sweeps and steps alike, S_e being the spectrum of an autoregression. Where the input was made from the output the
innovations of both are correlated at negative lags (Haugh 1976); a sweep has none. Bands are simultaneous, by
Bonferroni: a good model leaves them at some lag in at most 1 % of logs.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.special import ndtri

from archerfish.identification.simulation import TINY, Array
from archerfish.logs.recording import Values

_LAGS = 25  # largest lag [samples]
_FALSE_ALARM = 0.01
_ORDER = 20  # of the autoregression
_MOST_ROWS = 20_000  # samples that are regressed on inputs; of a longer log every few
_FEEDBACK = 0.1  # share of the residual's innovations that later ones of an input explain, from which there is feedback
_UNPREDICTABLE = 3e-4  # share of an input's power that its innovations have at least, to say anything of feedback
_LEADS, _MOST_OF_LEAD = 40, 0.9  # largest lead [samples]; share of what all of them explain that shows how many act
_DEPENDENT = 1e-5  # singular value over the largest, below which inputs of several lags depend on each other


class ResidualTests(NamedTuple):
    """Tests of one output of one log, with the band that the correlations of a good model do not leave."""

    lags: NDArray[np.int64]  # −25…25 [samples]; at a positive one the input comes first, (L,)
    correlation: Array  # of the residual with each input, −1…1, (m, L)
    band: Array  # half width of its band, the same at all lags, (m, 1)
    explained_share: float  # of the residual's power by the last 25 inputs, linearly, 0…1
    independent: bool  # whether no input's correlation leaves its band at a lag ≥ 0
    feedback: bool  # whether an input's innovations follow those of the residual


def residual_tests(residual: Array, inputs: Values) -> ResidualTests | None:
    """Test a residual; None of a log with fewer than 100 samples for each input and 100 more.

    Args:
      residual: measured less simulated output, shape (N,).
      inputs: of the log, shape (N, m).
    """
    (samples, channels), lags = inputs.shape, np.arange(-_LAGS, _LAGS + 1)
    if samples < 4 * _LAGS * (1 + channels):
        return None
    e, us = residual - residual.mean(), (inputs - inputs.mean(0)).T
    power, taps = _autoregression(e)
    spectrum = power / np.abs(np.fft.fft(taps, 2 * samples)) ** 2
    variance = np.mean(spectrum * np.abs(np.fft.fft(us, 2 * samples)) ** 2, axis=1)[:, None]  # γ(0)
    scale = np.sqrt(np.maximum((e @ e) * np.sum(us**2, 1), TINY))[:, None]
    correlation = np.array([np.correlate(np.pad(e, _LAGS), u) for u in us]) / scale  # Σₜ e[t] u[t−τ]
    band = -ndtri(_FALSE_ALARM / 2 / (channels * (_LAGS + 1))) * np.sqrt(np.maximum(variance, TINY)) / scale
    independent = not np.any((np.abs(correlation) > band)[:, lags >= 0])
    feedback = any(_follows(u, np.convolve(e, taps)[: len(e)]) for u in us)
    return ResidualTests(lags, correlation, band, _explained_share(e, us), independent, feedback)


def _autoregression(e: Array) -> tuple[float, Array]:
    """Return the innovations' power and the taps 1 + a₁ z + … of an autoregression, by Yule and Walker's equations."""
    covariance = np.correlate(np.pad(e, (0, min(_ORDER, len(e) // 20))), e) / len(e)
    covariance[0] = covariance[0] * (1 + 1e-9) + TINY  # regular, where the residual is all but predictable
    taps = np.append(1, solve_toeplitz(covariance[:-1], -covariance[1:]))
    return float(np.mean(np.convolve(e, taps)[len(taps) : len(e)] ** 2)), taps


def _follows(u: Array, innovations: Array) -> bool:
    """Return whether innovations of an input depend on earlier ones of the residual."""
    power, taps = _autoregression(u)
    if power < _UNPREDICTABLE * np.mean(u**2):
        return False
    both = np.stack([np.convolve(u, taps)[: len(u)], innovations])[:, _ORDER:]
    own, theirs = both - both.mean(1, keepdims=True)
    size = np.sqrt(max(float((own @ own) * (theirs @ theirs)), TINY))
    correlation = np.correlate(np.pad(theirs, (_LAGS, 0)), own)[:-1] / size
    limit = -ndtri(_FALSE_ALARM / 2 / _LAGS) / np.sqrt(len(own))
    return bool(np.abs(correlation).max() > limit and correlation @ correlation > _FEEDBACK)


def lead(residual: Array, inputs: Values) -> tuple[int, float]:
    """Return how many samples an output leads its input by, at least, and the share of a residual that shows it.

    That share is what later inputs explain of a residual beyond its past inputs. A filter that runs both ways leaves
    little else; of feedback the disturbance itself remains.

    Args:
      residual: measured less simulated output, shape (N,).
      inputs: of one channel, shape (N,).
    """
    stride, count = -(-len(residual) // _MOST_ROWS), len(residual) - _LAGS - _LEADS
    if count < 4 * (_LAGS + _LEADS):
        return 0, 0.0
    steps = [*range(0, -_LAGS - 1, -1), *range(1, _LEADS + 1)]
    columns = np.stack([inputs[_LAGS + step : _LAGS + step + count : stride] for step in steps], axis=1)
    target = residual[_LAGS : _LAGS + count : stride]
    basis, triangle = np.linalg.qr(columns - columns.mean(0))
    moves = np.abs(np.diag(triangle)) > _DEPENDENT * np.ptp(inputs)  # the directions of others are arbitrary
    explained = moves * (basis.T @ (target - target.mean())) ** 2
    left = count / stride * np.var(target) - explained[: _LAGS + 1].sum()
    later = np.cumsum(explained[_LAGS + 1 :])
    return 1 + int(np.argmax(later > _MOST_OF_LEAD * later[-1])), float(later[-1] / max(left, TINY))


def _explained_share(e: Array, us: Array) -> float:
    """Return the share of the power that a regression on the last inputs explains, less what noise would explain."""
    stride, rows = -(-len(e) // _MOST_ROWS), range(_LAGS + 1)
    columns = np.stack([u[_LAGS - lag : len(e) - lag : stride] for u in us for lag in rows], axis=1)
    columns, target = columns - columns.mean(0), e[_LAGS::stride] - e[_LAGS::stride].mean()
    found, _, rank, _ = np.linalg.lstsq(columns, target, rcond=_DEPENDENT)
    rest = 1 - np.sum((columns @ found) ** 2) / max(float(target @ target), TINY)
    return float(max(0.0, 1 - rest * (len(target) - 1) / (len(target) - rank - 1)))

"""What the residuals of a free run still hold: tests of whiteness, of independence of the input, and for feedback.

A free run judges an output-error model: it explains what the input does and leaves the disturbance as it comes. Its
residuals may be coloured, so whiteness is reported only; what counts is that they do not depend on past inputs. They
depend on what is surprising in future inputs where the output was fed back to the input; on what those inputs' own past
foretells they depend in any plant that is not quite right (surprises.py).

With residual e and input u, means taken off, the test looks at Σₜ e[t] u[t−τ]. For any fixed u and a stationary e that
is independent of it these sums have the covariances

    γ(d) = ∫ S_e(ω) |U(ω)|² exp(iωd) dω / 2π,    d the difference of two lags,

which holds for coloured residuals and for sweeps and steps alike (the usual band 2.58 / √N holds for neither). S_e is
the spectrum of an autoregression fitted to e. All bands are simultaneous: a good model leaves them at some lag in 1 %
of recordings.
"""

import functools
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz, solve_triangular, toeplitz
from scipy.special import fdtrc, ndtr, ndtri

from archerfish.identification.validation.surprises import surprises

Array = NDArray[np.float64]

LAGS = 25
"""Longest lag that is tested [samples]."""
CONFIDENCE = 0.99
"""Share of the recordings of a good model that pass."""

_LONGEST_MEMORY = 30
"""Highest order of the autoregression that stands for the residual's spectrum."""
_PAST = 100
"""Past inputs that are given before future ones are asked for [samples]: a slow model error must not pass for them."""
_FEEDBACK_SHARE = 0.1
"""Share of the innovations, explained by future surprises, from which there is feedback. In recorded loops it is 40 %
and more; saturation, friction, backlash and too low an order come to more in 1 % of simulated open-loop logs."""
_OVER_PAST = 0.5
"""How much that must be of what past surprises explain: a model error shows in those first. In recorded loops 0.86 and
more, in the open-loop logs above the share no more than 0.3."""
_MOST_ROWS = 20_000
"""Samples whose residual is regressed on inputs; of a longer recording every few are. More find nothing that these
leave: what explains a thousandth of the residual shows in them beyond doubt."""
_PIECE = 4096
"""Samples of which lagged products are formed at a time."""
_TINY = float(np.finfo(float).tiny)
_TRIALS = 10_000
"""Enough to place the 99 % limit within 0.03 of itself."""


class Correlogram(NamedTuple):
    """Correlations over lags, with the band that a good model keeps."""

    lag: NDArray[np.int64]
    """Lags [samples]; at a positive lag the input comes first, shape (L,)."""
    correlation: Array
    """−1…1, shape (L,)."""
    half_width: Array
    """Half width of the simultaneous 99 % band, shape (L,)."""
    p_value: float
    """Chance that a good model strays as far; below 0.01 the test fails. Negative lags don't count."""

    @property
    def passed(self) -> bool:
        """Whether the correlations stay inside the band."""
        return self.p_value >= 1 - CONFIDENCE


class ResidualTests(NamedTuple):
    """The tests of one output of one recording."""

    whiteness: Correlogram
    """Residual with itself, lags 1…25. A failure is no fault of the plant."""
    independence: tuple[Correlogram, ...]
    """Residual with each input, lags −25…25, judged on 0…25."""
    explained_share: float
    """Share of the residual's power that the last 25 inputs explain linearly, 0…1."""
    feedback_share: float
    """Share of the residual's innovations that surprises in future inputs explain beyond past inputs; 0 where that may
    be chance, or a model error."""

    @property
    def independent(self) -> bool:
        """Whether the residual is independent of every input."""
        return all(each.passed for each in self.independence)

    @property
    def feedback(self) -> bool:
        """Whether the output seems to be fed back to the input."""
        return self.feedback_share > _FEEDBACK_SHARE


def residual_tests(residual: Array, inputs: Array, parameter_error: Array | None = None) -> ResidualTests:
    """Test the residual of a recording's free run.

    Args:
      residual: measured less simulated output, shape (N,), N at least 4 lags.
      inputs: inputs of the recording, shape (N, m).
      parameter_error: outputs of plants drawn from the posterior less those of the plant, shape (k, N). On a recording
        that was not fitted the residual holds that error too; where it was fitted, leave this out.
    """
    e, u = residual - residual.mean(), inputs - inputs.mean(axis=0)
    memory = _autoregression(e)
    errors = np.zeros((0, e.size)) if parameter_error is None else parameter_error
    return ResidualTests(
        whiteness=_whiteness(e),
        independence=tuple(_independence(e, channel, memory, errors) for channel in u.T),
        explained_share=_explained_share(e, u),
        feedback_share=_feedback_share(e, u, memory),
    )


def long_enough(count: int, inputs: int = 1) -> bool:
    """Return whether a recording of `count` samples and so many inputs is long enough for the tests."""
    return count >= 4 * LAGS * (1 + inputs)


def _whiteness(e: Array) -> Correlogram:
    lags = np.arange(1, LAGS + 1)
    correlation = _lagged_products(e, e, lags) / max(float(e @ e), _TINY)
    # Under the hypothesis the correlations are independent with variance (N − lag) / N².
    deviation = np.sqrt(e.size - lags) / e.size
    multiple = -ndtri((1 - CONFIDENCE ** (1 / LAGS)) / 2)
    inside = 1 - 2 * ndtr(-np.max(np.abs(correlation) / deviation))
    return Correlogram(lags, correlation, multiple * deviation, float(1 - inside**LAGS))


def _independence(e: Array, u: Array, memory: Array, errors: Array) -> Correlogram:
    lags = np.arange(-LAGS, LAGS + 1)
    judged = lags >= 0
    scale = max(float(np.sqrt((e @ e) * (u @ u))), _TINY)
    covariance = toeplitz(_sum_covariance(e, u, memory)[: lags.size])
    if len(errors):
        strays = _stray_products(errors, u)
        covariance = covariance + strays.T @ strays / len(errors)
    deviation = np.sqrt(np.maximum(covariance.diagonal(), _TINY))
    products = _lagged_products(e, u, lags)
    strays_by_chance = _largest_by_chance(covariance[np.ix_(judged, judged)])
    p_value = np.mean(strays_by_chance >= np.max(np.abs(products / deviation)[judged]))
    half_width = np.quantile(strays_by_chance, CONFIDENCE) * deviation / scale
    return Correlogram(lags, products / scale, half_width, float(p_value))


def _largest_by_chance(covariance: Array) -> Array:
    """Return the largest |z| of correlated normal sums, each from the same draws, shape (trials,)."""
    deviation = np.sqrt(np.maximum(covariance.diagonal(), _TINY))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(np.abs(_normals(len(root)) @ root.T).max(axis=1))


@functools.cache
def _normals(count: int) -> Array:
    return np.random.default_rng(0).standard_normal((_TRIALS, count))


def _sum_covariance(e: Array, u: Array, memory: Array) -> Array:
    """Return γ(d) for d = 0…N−1, from the residual's autoregressive spectrum and the input's own."""
    size = 2 * e.size
    innovations = np.convolve(e, memory)[memory.size : e.size]
    spectrum = np.mean(innovations**2) / np.abs(np.fft.rfft(memory, size)) ** 2
    energy = np.abs(np.fft.rfft(u, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum * energy, size)[: e.size])


def _lagged_products(e: Array, u: Array, lags: NDArray[np.int64]) -> Array:
    """Return Σₜ e[t] u[t−τ] for each lag τ."""
    pairs = ((e[max(lag, 0) : e.size + min(lag, 0)], u[max(-lag, 0) : u.size - max(lag, 0)]) for lag in lags.tolist())
    return np.array([later @ earlier for later, earlier in pairs])


def _stray_products(errors: Array, u: Array) -> Array:
    """Return the lagged products of many signals less their means at all lags −25…25, shape (k, 51).

    Args:
      errors: shape (k, N).
      u: shape (N,).
    """
    means = errors.mean(axis=1, keepdims=True)
    # Row t holds u[t+25] … u[t−25], zero where there is none.
    shifts = sliding_window_view(np.pad(u, LAGS), 2 * LAGS + 1)[:, ::-1]
    products = np.zeros((len(errors), shifts.shape[1]))
    for start in range(0, u.size, _PIECE):
        part = slice(start, start + _PIECE)
        products += (errors[:, part] - means) @ shifts[part]
    return products


def _autoregression(e: Array) -> Array:
    """Fit 1 + a₁ z⁻¹ + … by Yule–Walker, which is always stable; the order is Akaike's choice, shape (order + 1,)."""
    longest = min(_LONGEST_MEMORY, e.size // 10)
    covariance = _lagged_products(e, e, np.arange(longest + 1)) / e.size
    if covariance[0] == 0:
        return np.ones(1)
    # A touch of white noise keeps the equations regular where the residual is all but predictable.
    covariance[0] *= 1 + 1e-9
    best, lowest = np.ones(1), e.size * np.log(covariance[0])
    for order in range(1, longest + 1):
        taps = solve_toeplitz(covariance[:order], -covariance[1 : order + 1])
        variance = covariance[0] + taps @ covariance[1 : order + 1]
        criterion = e.size * np.log(max(variance, _TINY)) + 2 * order
        if criterion < lowest:
            best, lowest = np.concatenate([[1.0], taps]), criterion
    return best


def _explained_share(e: Array, u: Array) -> float:
    target = e[LAGS :: _stride(e.size)]
    return _adjusted_share(_basis(_shifted(u, range(LAGS + 1), LAGS, e.size)), target - target.mean())


def _stride(count: int) -> int:
    return -(-count // _MOST_ROWS)


def _feedback_share(e: Array, u: Array, memory: Array) -> float:
    """Ask by an F test whether surprises in 25 future inputs explain the residual's innovations beyond past inputs."""
    new = np.column_stack([surprises(channel) for channel in u.T])
    if not new.any():
        return 0.0
    past = min(_PAST, e.size // (4 * u.shape[1]) - LAGS)
    start, stop = max(past, LAGS) + memory.size, e.size - LAGS
    # Innovations are independent of one another: of a long recording every few of them do.
    target = np.convolve(e, memory)[start : stop : _stride(e.size)]
    target = target - target.mean()
    before = _shifted(new, range(LAGS + 1), start, stop)
    known = _basis(np.hstack([_shifted(u, range(past + 1), start, stop), before]))
    rest = target - known @ (known.T @ target)
    future = _shifted(new, range(-LAGS, 0), start, stop)
    added = _basis(future - known @ (known.T @ future), float(np.linalg.norm(future)))
    wanted, spare = added.shape[1], rest.size - known.shape[1] - added.shape[1] - 1
    if wanted == 0 or spare <= 0:
        return 0.0
    explained, total = np.sum((added.T @ rest) ** 2), max(float(rest @ rest), _TINY)
    ratio = (explained / wanted) / max((total - explained) / spare, _TINY)
    share = _adjusted_share(added, rest)
    by_chance = fdtrc(wanted, spare, ratio) >= 1 - CONFIDENCE
    return 0.0 if by_chance or share < _OVER_PAST * _adjusted_share(_basis(before), target) else share


def _adjusted_share(basis: Array, target: Array) -> float:
    """Return the share of a signal's power, shape (N,), that orthonormal columns explain, less what chance would."""
    explained, total = np.sum((basis.T @ target) ** 2), max(float(target @ target), _TINY)
    spare = target.size - basis.shape[1] - 1
    return float(max(0.0, 1 - (1 - explained / total) * (target.size - 1) / spare))


def _shifted(u: Array, lags: range, start: int, stop: int) -> Array:
    """Return u[t−τ] of each lag and input, means taken off, for the t that are regressed from start to stop.

    Shape (R, L m).
    """
    columns = np.hstack([u[start - lag : stop - lag : _stride(len(u))] for lag in lags])
    columns -= columns.mean(axis=0)
    return columns


def _basis(columns: Array, scale: float | None = None) -> Array:
    """Return orthonormal columns that span the given ones, less those that are small beside `scale` (their norm)."""
    scale = float(np.linalg.norm(columns)) if scale is None else scale
    values, vectors = np.linalg.eigh(columns.T @ columns)
    kept = values > 1e-10 * scale**2
    # Twice: the Gram matrix squares the spread of scales, and the second pass restores what rounding took.
    basis = columns @ (vectors[:, kept] / np.sqrt(values[kept]))
    root = np.linalg.cholesky(basis.T @ basis)
    return np.asarray(basis @ solve_triangular(root, np.eye(len(root)), lower=True).T)

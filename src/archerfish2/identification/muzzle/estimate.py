"""Means by weighted least squares, spreads by restricted maximum likelihood, in turns, and their intervals.

Where settings are repeated the spreads come from the scatter within the settings alone (pure error), so that a flight
that does not fit can't pass for dispersion; else from the residuals. With measured speeds one spread is left, and the
intervals are those of a plain sample (t, χ²); without, they come from a parametric bootstrap of the linearised model.
"""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from archerfish2.identification.muzzle.flight import RANGES, SHAPING, SPREADS, Response, flown, linearised, vertical
from archerfish2.identification.statistics import Array, sample_estimates, variance_components
from archerfish2.logs.shots import Shots
from archerfish2.reports.table import Estimate

Known: TypeAlias = Mapping[str, float]
"""Parameters that are given, in SI units."""
TYPICAL = np.array([0.5, 0.01]) ** 2
"""Variances of speed [(m/s)²] and elevation [rad²] that a search begins with; only their ratio matters."""
UNITS = {"speed": "m/s", "speed_sd": "m/s", "height": "m", "drag": "1/m", "length": "m"}
"""Of what is not an angle [rad]."""

_ROUNDS, _DRAWS = 15, 400
_LEAST = 1e-8
"""Of the typical variance: a smaller one keeps this value, so that densities exist."""


class MuzzleFit(NamedTuple):
    """Estimate from the vertical measurements of N shots, with q free parameters and c spreads."""

    values: dict[str, float]  # parameters that shape the mean, given or estimated, in SI units
    response: Response  # there
    design: Array  # derivatives by the free parameters, (N, q)
    within: Array  # columns that are no scatter: the settings' means, or the design, (N, p)
    residual: Array  # measured less expected [m], (N,)
    variances: Array  # of the spreads [(m/s)²], [rad²], (c,)
    rounding: Array  # variance by the steps of the measurements [m²], (N,)
    sd: Array  # standard deviation of the measurements [m], (N,)


def free_names(known: Known) -> list[str]:
    """Return the parameters that are estimated from the means of the vertical measurements."""
    return [name for name in SHAPING if name not in known]


def values_at(known: Known, point: Array) -> dict[str, float]:
    """Return all parameters for free ones of shape (q,)."""
    return {**known, **dict(zip(free_names(known), point.tolist(), strict=True))}


def rounding_step(values: Array) -> float:
    """Return the step of which measured values of shape (N,) are multiples, at least 1e-6; 0 where all are equal."""
    return 1e-6 * float(np.gcd.reduce(np.rint(1e6 * (values - values[0])).astype(np.int64)))


def fit_means(shots: Shots, known: Known, start: Array, sd: Array, shift: Any, loss: str) -> Array:
    """Fit the free parameters within their ranges by least squares, shape (q,).

    Args:
      shots: N of them.
      known: parameters that are given, in SI units.
      start: shape (q,).
      sd: standard deviation of each measurement [m], shape (N,).
      shift: added to the expected measurements [m], shape (N,) or ().
      loss: of SciPy's `least_squares`.
    """
    low, high = np.array([RANGES[name] for name in free_names(known)]).T
    measured, here = vertical(shots) - shift, np.zeros((1, 4))
    start = np.clip(start, low + 1e-9, high - 1e-9)

    def ratio(point: Array) -> Array:
        return np.asarray((measured - flown(shots, values_at(known, point), here)[0]) / sd)

    return np.asarray(least_squares(ratio, start, bounds=(low, high), loss=loss, x_scale=0.1 * (high - low)).x)


def fit_muzzle(shots: Shots, known: Known, start: Array) -> MuzzleFit:
    """Estimate the free parameters, from a start of shape (q,), and the spreads."""
    number, point, variances = shots.settings()[0], start, TYPICAL[shots.speed is not None :]
    groups = number[:, None] == np.arange(number.max() + 1)
    pure = len(shots) - groups.shape[1] >= max(4, (len(shots) - start.size) / 2)
    step, speed_step = rounding_step(vertical(shots)), 0.0 if shots.speed is None else rounding_step(shots.speed)
    there = linearised(shots, values_at(known, point))
    for _ in range(_ROUNDS):
        rounding = (step**2 + (speed_step * there.slopes[:, 0]) ** 2) / 12
        sd, shift = np.sqrt(there.scales @ variances + rounding), 0.5 * there.curvatures @ variances
        before, point = (point, variances), fit_means(shots, known, point, sd, shift, "linear")
        there = linearised(shots, values_at(known, point))
        design = there.slopes[:, [SHAPING.index(name) for name in free_names(known)]]
        within, residual = groups.astype(float) if pure else design, vertical(shots) - there.mean - shift
        found = variance_components(residual, within, there.scales, rounding).variances
        variances = np.maximum(found, _LEAST * TYPICAL[shots.speed is not None :])
        if np.allclose(point, before[0], rtol=1e-4, atol=1e-6) and np.allclose(variances, before[1], rtol=2e-3):
            break
    return MuzzleFit(values_at(known, point), there, design, within, residual, variances, rounding, sd)


def expected(shots: Shots, fit: MuzzleFit) -> tuple[Array, Array]:
    """Return expected measurements of shots and their standard deviations [m], shape (N,) each."""
    there = linearised(shots, fit.values)
    return there.mean + 0.5 * there.curvatures @ fit.variances, np.sqrt(there.scales @ fit.variances)


def vertical_estimates(
    known: Known, fit: MuzzleFit, misfit: float, rounded: float, rho: float, seed: int
) -> dict[str, Estimate]:
    """Return the free parameters and spreads with their intervals, which end where the parameters are sought.

    Args:
      known: parameters that were given.
      fit: the estimate.
      misfit: variance of the settings' means over what scatter explains, at least 1; it widens the means' intervals.
      rounded: common error of the measured speeds [m/s].
      rho: coefficient of the autoregression of successive shots.
      seed: of the bootstrap.
    """
    (count, width), scales, names = fit.within.shape, fit.response.scales, free_names(known)
    inverse = np.linalg.pinv(fit.design / fit.sd[:, None], rcond=1e-9)
    if scales.shape[1] == 1:
        pivots, rounding = student.ppf([[0.975], [0.025]], count - width), float(np.mean(fit.rounding / scales[:, 0]))
        squares = spread_ends(fit.variances[0], rounding, count - width, rho)[:, None]
    else:
        found = variance_components(fit.residual, fit.within, scales, fit.rounding)
        drawn = [_redrawn(fit, noise) for noise in np.random.default_rng(seed).standard_normal((_DRAWS, count))]
        pivots, tails = np.split(np.quantile(drawn, [0.975, 0.025], axis=0, method="weibull"), [len(names)], axis=1)
        squares = np.maximum(found.unconstrained - widening(rho)[1] * tails * found.errors, 0.0)
    error = rounded * np.abs(inverse @ (fit.response.slopes[:, 0] / fit.sd)) * [[-1.0], [1.0]]
    half = widening(rho)[0] * np.sqrt(misfit) * pivots * np.linalg.norm(inverse, axis=1) - error
    values = [*(fit.values[name] for name in names), *np.sqrt(fit.variances)]
    ends, names = np.hstack([values[: len(names)] - half, np.sqrt(squares)]), [*names, *SPREADS[-scales.shape[1] :]]
    ends = np.clip(ends, *np.array([RANGES[name] for name in names]).T).tolist()
    units = (UNITS.get(name, "rad") for name in names)
    return dict(zip(names, itertools.starmap(Estimate, zip(values, *ends, units, strict=True)), strict=True))


def sample_intervals(sample: Array, rho: float, unit: str) -> tuple[Estimate, Estimate]:
    """Return mean and standard deviation of a sample of shape (N,), without what its rounding adds, by t and χ².

    Where the step is above the scatter, rounding does not average out, and the scatter is open below.
    """
    (mean, low, high, _), error, count = sample_estimates(sample)[0], mean_error(sample), sample.size
    square, ratio = rounding_step(sample) ** 2 / 12, widening(rho)[0]
    variance = max(float(sample.var(ddof=1)) - square, 0.0)
    least, most = np.sqrt(spread_ends(variance, square, count - 1, rho) + square * bool(error))
    spread = Estimate(float(np.sqrt(variance)), 0.0 if error else float(least), float(most), unit)
    return Estimate(mean, mean + ratio * (low - mean) - error, mean + ratio * (high - mean) + error, unit), spread


def mean_error(sample: Array) -> float:
    """Return what the mean of rounded values, shape (N,), may be off by: half a step above their scatter, else 0."""
    step = rounding_step(sample)
    return step / 2 if step > sample.std() else 0.0


def spread_ends(variance: float, rounding: float, freedom: int, rho: float) -> Array:
    """Return the ends of the interval of a variance, less what rounding adds, shape (2,)."""
    tails = (freedom / chi2.ppf([0.975, 0.025], freedom)) ** widening(rho)[1]
    return np.asarray(np.maximum((variance + rounding) * tails - rounding, 0.0))


def widening(rho: float) -> tuple[float, float]:
    """Return how much longer the standard errors of mean and variance are of a first-order autoregression."""
    return float(np.sqrt((1 + rho) / (1 - rho))), float(np.sqrt((1 + rho**2) / (1 - rho**2)))


def _redrawn(fit: MuzzleFit, normals: Array) -> list[float]:
    """Return errors of the means and variances of drawn shots over the standard errors that these give, (q + c,)."""
    noise = fit.sd * normals
    drawn = variance_components(noise, fit.within, fit.response.scales, fit.rounding)
    inverse = np.linalg.pinv(fit.design / drawn.sd[:, None], rcond=1e-9)
    moved = inverse @ (noise / drawn.sd) / np.linalg.norm(inverse, axis=1)
    return [*moved, *((drawn.unconstrained - fit.variances) / drawn.errors)]

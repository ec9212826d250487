"""Means by weighted least squares, spreads by restricted maximum likelihood, intervals by parametric bootstrap.

Where settings are repeated the spreads come from the scatter within the settings alone (pure error), so that a flight
that does not fit can't pass for dispersion; else from the residuals. Means and spreads are found in turns.
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2
from scipy.stats import t as student

from archerfish2.identification.muzzle.flight import RANGES, SHAPING, MuzzleProblem, Response, flown, response, vertical
from archerfish2.identification.statistics import Array, variance_components
from archerfish2.reports.table import Estimate

TYPICAL = np.array([0.5, 0.01]) ** 2
"""Variances of speed [(m/s)²] and elevation [rad²] that a search begins with; only their ratio matters."""

UNITS = dict.fromkeys(RANGES, "rad") | {"speed": "m/s", "speed_sd": "m/s", "height": "m", "drag": "1/m", "length": "m"}

_ROUNDS, _DRAWS = 15, 400
_LEAST = 1e-9
"""Of the largest variance: a smaller one counts as zero, and keeps this value so that densities exist."""
_HERE = np.zeros((1, 4))


class MuzzleFit(NamedTuple):
    """Estimate from the vertical measurements of N shots, with q free parameters and c spreads."""

    values: dict[str, float]  # parameters that shape the mean, given or estimated, in SI units
    response: Response  # there
    design: Array  # derivatives by the free parameters, (N, q)
    within: Array  # columns that are no scatter: the settings' means, or the design, (N, p)
    residual: Array  # measured less expected [m], (N,)
    variances: Array  # of the spreads [(m/s)²], [rad²], (c,)
    rounding: Array  # variance of the measurements by their own step [m²], (N,)
    sd: Array  # standard deviation of the measurements [m], (N,)


def fit_means(
    problem: MuzzleProblem, start: Array, sd: Array, shift: Array | float, loss: Literal["linear", "soft_l1"] = "linear"
) -> Array:
    """Fit the free parameters within their ranges by least squares, shape (q,).

    Args:
      problem: N shots, and what is known.
      start: shape (q,).
      sd: standard deviation of each measurement [m], shape (N,).
      shift: added to the expected measurements [m], shape (N,).
      loss: of SciPy's `least_squares`.
    """
    if not problem.free:
        return start
    low, high = np.array([RANGES[name] for name in problem.free]).T
    measured = vertical(problem.shots) - shift

    def ratio(point: Array) -> Array:
        return np.asarray((measured - flown(problem.shots, problem.values(point), _HERE)[0]) / sd)

    start = np.clip(start, low + 1e-9, high - 1e-9)
    return np.asarray(least_squares(ratio, start, bounds=(low, high), loss=loss, x_scale=0.1 * (high - low)).x)


def rounding_step(values: Array) -> float:
    """Return the step of which measured values of shape (N,) are multiples, at least 1e-6; 0 where all are equal."""
    return 1e-6 * float(np.gcd.reduce(np.rint(1e6 * (values - values[0])).astype(np.int64)))


def fit_muzzle(problem: MuzzleProblem, start: Array) -> MuzzleFit:
    """Estimate free parameters and spreads from a start of shape (q,)."""
    shots, point, spreads = problem.shots, start, len(problem.spreads)
    most = _largest(problem)
    number = shots.settings()[0]
    repeated = number.size - (number.max() + 1)
    pure = repeated >= max(4, (number.size - start.size) / 2)
    steps = rounding_step(vertical(shots)), 0.0 if shots.speed is None else rounding_step(shots.speed)
    variances, there = TYPICAL[-spreads:], response(problem, problem.values(point))
    for _ in range(_ROUNDS):
        rounding = (steps[0] ** 2 + (steps[1] * there.slopes[:, 0]) ** 2) / 12
        sd, shift = np.sqrt(there.scales @ variances + rounding), 0.5 * there.curvatures @ variances
        before, point = np.append(point, np.sqrt(variances)), fit_means(problem, point, sd, shift)
        there = response(problem, problem.values(point))
        design = there.slopes[:, [SHAPING.index(name) for name in problem.free]]
        within = (number[:, None] == np.arange(number.max() + 1)).astype(float) if pure else design
        residual = vertical(shots) - there.mean - shift
        found = variance_components(residual, within, there.scales, rounding).variances
        variances = np.clip(found, _LEAST * most, most)  # not 0, so that densities exist
        if np.allclose(np.append(point, np.sqrt(variances)), before, rtol=1e-4, atol=1e-6):
            break
    return MuzzleFit(problem.values(point), there, design, within, residual, variances, rounding, sd)


def vertical_estimates(problem: MuzzleProblem, fit: MuzzleFit, misfit: float, seed: int) -> dict[str, Estimate]:
    """Return the free parameters and spreads with their intervals.

    Args:
      problem: the shots that were fitted.
      fit: the estimate.
      misfit: variance of the settings' means over what scatter explains, at least 1; it widens the means' intervals.
      seed: of the bootstrap.
    """
    scales, share = fit.response.scales, np.mean(fit.rounding[:, None] / fit.response.scales, axis=0)
    count, width = fit.within.shape
    tails = ((count - width) / chi2.ppf([0.975, 0.025], count - width))[:, None]
    if len(problem.spreads) == 1:
        pivots = student.ppf([0.975, 0.025], count - width)[:, None]
        squares = np.maximum((fit.variances + share) * tails - share, 0.0)
    else:
        # All of the scatter by one spread alone is the most that it can be.
        alone = [variance_components(fit.residual, fit.within, each[:, None]).variances for each in scales.T]
        draws = _drawn(fit, np.random.default_rng(seed))
        quantiles = np.quantile(draws, [0.975, 0.025], axis=0, method="weibull")
        pivots, ratios = np.split(quantiles, [fit.design.shape[1]], axis=1)
        squares = np.minimum(fit.variances / np.maximum(ratios, 1e-12), np.concatenate(alone) * tails[1])
    error = np.sqrt(misfit) * _errors(fit.design, fit.sd)
    point = np.array([fit.values[name] for name in problem.free])
    means, spreads = point - pivots * error, np.sqrt(squares)
    deviation = np.where(fit.variances > 1.1 * _LEAST * _largest(problem), np.sqrt(fit.variances), 0.0)
    names, values = (*problem.free, *problem.spreads), np.append(point, deviation)
    return {name: bounded(name, *each) for name, *each in zip(names, values, *np.hstack([means, spreads]), strict=True)}


def bounded(name: str, value: float, low: float, high: float) -> Estimate:
    """Return an estimate whose interval ends where its parameter is sought."""
    least, most = RANGES[name]
    return Estimate(float(value), float(np.clip(low, least, value)), float(np.clip(high, value, most)), UNITS[name])


def _drawn(fit: MuzzleFit, rng: np.random.Generator) -> Array:
    """Return drawn errors of the means over their standard errors, and drawn variances over true ones, (D, q + c)."""
    scales, draws = fit.response.scales, []
    for noise in fit.sd * rng.standard_normal((_DRAWS, fit.sd.size)):
        variances = variance_components(noise, fit.within, scales, fit.rounding).variances
        sd = np.sqrt(scales @ np.maximum(variances, _LEAST * fit.variances) + fit.rounding)
        moved = np.linalg.lstsq(fit.design / sd[:, None], noise / sd)[0]
        draws.append([*(moved / _errors(fit.design, sd)), *(variances / fit.variances)])
    return np.array(draws)


def _errors(design: Array, sd: Array) -> Array:
    """Standard errors of weighted least squares, shape (q,)."""
    return np.asarray(np.linalg.norm(np.linalg.pinv(design / sd[:, None], rcond=1e-9), axis=1))


def _largest(problem: MuzzleProblem) -> Array:
    """Largest variances of the spreads, shape (c,)."""
    return np.array([RANGES[name][1] for name in problem.spreads]) ** 2

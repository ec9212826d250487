"""Means by weighted least squares (Gauss–Newton), spreads by restricted maximum likelihood, in turns; their intervals.

Where settings are repeated the spreads come from the scatter within the settings alone (pure error), so that a flight
that does not fit can't pass for dispersion; else from the residuals. With measured speeds one spread is left, and the
intervals are those of a plain sample (t, χ²); without, those of the spreads come from a parametric bootstrap.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from archerfish2.identification.muzzle import flight
from archerfish2.identification.statistics import Array, VarianceComponents, variance_components
from archerfish2.logs.shots import Shots
from archerfish2.reports.table import Estimate

Parameters = Mapping[str, float]
"""Parameters by name, in SI units."""
_TYPICAL = np.array([0.5, 0.01]) ** 2
"""Variances of speed [(m/s)²] and elevation [rad²] that a search begins with; only their ratio matters."""
_UNITS = {"speed": "m/s", "speed_sd": "m/s", "height": "m", "drag": "1/m"}
"""Of what is not an angle [rad]."""

_START = {"speed": 18.0, "pitch_offset": 0.0, "height": 0.4, "drag": 0.02}
"""From where the free parameters are sought."""
_ROUNDS, _DRAWS = 5, 400
"""Alternations of means and spreads, of which three or four leave less than 1e-4, and draws of the bootstrap."""
_LEAST = 1e-8
"""Of the typical variance: a smaller one keeps this value, so that densities exist."""


class MuzzleFit(NamedTuple):
    """Estimate from the vertical measurements of N shots, with q free parameters and c spreads."""

    free: list[str]  # names of the parameters that shape the mean and are estimated
    values: Parameters  # parameters that shape the mean, given or estimated
    response: flight.Response  # there
    design: Array  # derivatives by the free parameters, (N, q)
    within: Array  # columns that are no scatter: the settings' means, or the design, (N, p)
    residual: Array  # measured less expected [m], (N,)
    spreads: VarianceComponents  # of the residual, in (m/s)² and rad²
    variances: Array  # those, none below the least one, (c,)
    rounding: Array  # variance by the steps of the measurements [m²], (N,)
    sd: Array  # standard deviation of the measurements [m], (N,)


def rounding_step(values: Array | None) -> float:
    """Return the step of which measured values of shape (N,) are multiples, at least 1e-6; 0 where all are equal."""
    return 0.0 if values is None else 1e-6 * float(np.gcd.reduce(np.rint(1e6 * (values - values[0])).astype(np.int64)))


def fit_means(
    shots: Shots, free: list[str], values: Parameters, sd: Array, shift: Array | float = 0.0, loss: str = "linear"
) -> Parameters:
    """Fit the free parameters within their ranges by least squares.

    Args:
      shots: N of them.
      free: names of the parameters.
      values: of all parameters, from which it begins.
      sd: standard deviation of each measurement [m], shape (N,).
      shift: added to the expected measurements [m], shape (N,).
      loss: of SciPy's `least_squares`.
    """
    (low, high), measured = np.array([flight.RANGES[name] for name in free]).T, flight.measured_vertical(shots) - shift

    def moved(point: Array) -> Parameters:
        return {**values, **dict(zip(free, point.tolist(), strict=True))}

    def ratio(point: Array) -> Array:
        return np.asarray((measured - flight.expected_vertical(shots, moved(point))) / sd)

    start = np.clip([values[name] for name in free], low + 1e-9, high - 1e-9)
    return moved(optimize.least_squares(ratio, start, bounds=(low, high), loss=loss, x_scale=0.1 * (high - low)).x)


def robust_fit(shots: Shots, free: list[str], known: Parameters) -> tuple[Parameters, Array]:
    """Fit the means by Cauchy's loss.

    Returns:
      All parameters, and the residuals in robust standard deviations, shape (N,).
    """
    measured, typical = flight.measured_vertical(shots), _TYPICAL[shots.speed is not None :]
    values: Parameters = {**_START, **known}
    for loss in ("soft_l1", "cauchy", "cauchy"):
        sd = np.sqrt(flight.linearised(shots, values).scales @ typical)
        values = fit_means(shots, free, values, sd, loss=loss)
    deviation = (measured - flight.expected_vertical(shots, values)) / sd
    scale = max(1.4826 * np.median(np.abs(deviation)), rounding_step(measured) / np.median(sd) / 3.5)
    return values, deviation / scale


def fit_muzzle(shots: Shots, free: list[str], values: Parameters) -> MuzzleFit:
    """Estimate the free parameters, from values nearby, and the spreads."""
    typical, measured = _TYPICAL[shots.speed is not None :], flight.measured_vertical(shots)
    number, _ = shots.settings()
    groups = (number[:, None] == np.arange(number.max() + 1)).astype(float)
    pure = len(shots) - groups.shape[1] >= max(4, (len(shots) - len(free)) / 2)
    step, speed_step, variances = rounding_step(measured), rounding_step(shots.speed), typical
    for _ in range(_ROUNDS):
        there = flight.linearised(shots, values)
        rounding = (step**2 + (speed_step * there.slopes[:, 0]) ** 2) / 12
        design = there.slopes[:, list(map(flight.SHAPING.index, free))]
        shift, within = 0.5 * there.curvatures @ variances, groups if pure else design
        residual = measured - there.mean - shift
        spreads = variance_components(residual, within, there.scales, rounding)
        variances = np.maximum(spreads.variances, _LEAST * typical)
        sd = np.sqrt(there.scales @ variances + rounding)
        values = fit_means(shots, free, values, sd, shift)
    return MuzzleFit(free, values, there, design, within, residual, spreads, variances, rounding, sd)


def vertical_estimates(
    fit: MuzzleFit, misfit: float, rounded: float, longer: tuple[float, float], seed: int
) -> dict[str, Estimate]:
    """Return the free parameters and spreads with their intervals, which end where the parameters are sought.

    Args:
      fit: the estimate.
      misfit: variance of the settings' means over what scatter explains, at least 1; it widens the means' intervals.
      rounded: common error of the measured speeds [m/s].
      longer: see `dependence`.
      seed: of the bootstrap.
    """
    freedom, scales = fit.within.shape[0] - fit.within.shape[1], fit.response.scales
    if scales.shape[1] == 1:
        rounding = np.mean(fit.rounding / scales[:, 0])
        squares = (fit.variances + rounding) * _variance_factors(freedom, longer[1])[:, None] - rounding
    else:
        noise = fit.sd * np.random.default_rng(seed).standard_normal((_DRAWS, fit.sd.size))
        drawn = [variance_components(each, fit.within, scales, fit.rounding) for each in noise]
        pivots = [(each.unconstrained - fit.variances) / each.errors for each in drawn]
        tails = np.quantile(pivots, [0.975, 0.025], axis=0, method="weibull")
        squares = fit.spreads.unconstrained - longer[1] * tails * fit.spreads.errors
    inverse = np.linalg.pinv(fit.design / fit.sd[:, None], rcond=1e-9)
    half = stats.t.ppf(0.975, freedom) * np.sqrt(misfit) * longer[0] * np.linalg.norm(inverse, axis=1)
    half += rounded * np.abs(inverse @ (fit.response.slopes[:, 0] / fit.sd))
    means, names = np.array([fit.values[name] for name in fit.free]), [*fit.free, *flight.SPREADS[-scales.shape[1] :]]
    ends = np.hstack([[means - half, means + half], np.sqrt(np.maximum(squares, 0.0))])
    found = np.vstack([[*means, *np.sqrt(fit.variances)], ends])
    found = np.clip(found, *np.array([flight.RANGES[name] for name in names]).T)
    rows = zip(names, *np.stack([found[0], found.min(axis=0), found.max(axis=0)]).tolist(), strict=True)
    return {name: Estimate(value, low, high, _UNITS.get(name, "rad")) for name, value, low, high in rows}


def sample_intervals(sample: Array, longer: tuple[float, float], unit: str) -> tuple[Estimate, Estimate]:
    """Return mean and standard deviation of a sample, without what its rounding adds, by t and χ².

    Where the step is above the scatter, rounding does not average out, and the scatter is open below.

    Args:
      sample: shape (N,).
      longer: see `dependence`.
      unit: of the sample.
    """
    error, square, freedom = mean_error(sample), rounding_step(sample) ** 2 / 12, sample.size - 1
    mean, total = float(sample.mean()), max(float(sample.var(ddof=1)), square)
    half = longer[0] * float(stats.t.ppf(0.975, freedom) * sample.std() / np.sqrt(freedom)) + error
    low, high = total * _variance_factors(freedom, longer[1]) - (0.0 if error else square)
    low, value, high = np.sqrt(np.maximum([0.0 if error else low, total - square, high], 0.0)).tolist()
    return Estimate(mean, mean - half, mean + half, unit), Estimate(value, low, high, unit)


def mean_error(sample: Array | None) -> float:
    """Return what the mean of rounded values, shape (N,), may be off by: half a step above their scatter, else 0."""
    step = rounding_step(sample)
    return step / 2 if sample is not None and step > sample.std() else 0.0


def dependence(series: Array) -> tuple[float, float]:
    """Return the standard errors of mean and variance of a series, shape (N,), over those of independent shots.

    Those of a first-order autoregression, whose coefficient is 1 − d/2 by Durbin and Watson's statistic d, less its
    bias −(1 + 3 ρ)/N; 1 where d is not significantly small (1 %, normal approximation).
    """
    deviation = (series - series.mean()) / (series.std() or 1.0)
    statistic = float(np.sum(np.diff(deviation) ** 2)) / series.size
    rho = 1 - statistic / 2
    if statistic == 0 or stats.norm.sf(rho * np.sqrt(series.size)) >= 0.01:
        return 1.0, 1.0
    rho = min(rho + (1 + 3 * rho) / series.size, 0.97)
    return float(np.sqrt((1 + rho) / (1 - rho))), float(np.sqrt((1 + rho**2) / (1 - rho**2)))


def _variance_factors(freedom: int, longer: float) -> Array:
    """Return the ends of a variance's interval over the variance, by χ², shape (2,)."""
    return np.asarray((freedom / stats.chi2.ppf([0.975, 0.025], freedom)) ** longer)

"""The muzzle's estimate: what shots are expected to show by eq (6) and the simulator's flight, and the fit to them.

With v ~ N(μ_v, σ_v²) and δ ~ N(μ_0, σ_0²) a landing distance, or the height of a hit, f(v, pitch + δ) has by the delta
method (second order in the mean, first in the variance)

    E = f + (f_vv σ_v² + f_δδ σ_0²)/2,    Var = f_v² σ_v² + f_δ² σ_0²,

with f and its derivatives at (μ_v, pitch + μ_0). Where the speed of a shot was measured, f is taken at that speed, and
the terms of σ_v vanish.

Means are estimated by weighted least squares (Gauss–Newton), spreads by restricted maximum likelihood, in turns. Where
settings are repeated the spreads come from the scatter within the settings alone (pure error), so that a flight that
does not fit can't pass for dispersion; else from the residuals. With measured speeds one spread is left, and the
intervals are those of a plain sample (t, χ²); without, those of the spreads come from a parametric bootstrap.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize, stats

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import GRAVITY, flat_fire_crossing, flat_fire_position
from archerfish.identification.statistics import Array, VarianceComponents, variance_components
from archerfish.logs.shots import Shots
from archerfish.reports.table import Estimate

Parameters = Mapping[str, float]
"""Parameters by name, in SI units."""
RANGES = {"speed": (1.0, 35.0), "pitch_offset": (-0.35, 0.35), "height": (0.01, 3.0), "drag": (0.0, 0.3)}
SHAPING, SPREAD_NAMES = tuple(RANGES), ("speed_sd", "pitch_sd")
"""Parameters of the expected measurements, and of their scatter."""
RANGES |= {"speed_sd": (0.0, 5.0), "pitch_sd": (0.0, 0.35), "length": (0.0, 2.0)}
RANGES |= {"yaw_offset": (-1.6, 1.6), "yaw_sd": (0.0, 1.6)}
"""Where each parameter is sought or may be given, in SI units; no referee system allows more than 30 m/s."""

_STEPS = np.array([2e-2, 1e-3, 1e-3, 1e-4])
"""Of the differences by the parameters in `SHAPING`, in SI units: large enough for second derivatives."""
_NEWTON_STEPS = 5
"""Leave less than 1e-6 m of height wherever parameters are sought."""
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


class Response(NamedTuple):
    """Expected measurements of N shots without dispersion, and their derivatives."""

    mean: Array  # f [m], (N,)
    slopes: Array  # by the parameters in `SHAPING`, (N, 4)
    scales: Array  # variance per unit variance of the c spreads, (N, c): f_v² and f_δ², or f_δ² alone
    curvatures: Array  # second derivatives, f_vv and f_δδ, or f_δδ alone, (N, c)


def linearised(shots: Shots, values: Mapping[str, float]) -> Response:
    """Return the expected measurements of N shots at given parameters, differentiated by central differences."""
    moves = np.vstack([0 * _STEPS, np.diag(_STEPS), np.diag(-_STEPS)])
    moved = {name: values[name] + moves[:, [column]] for column, name in enumerate(SHAPING)}
    mean, above, below = np.split(expected_vertical(shots, {**values, **moved}), [1, 5])
    slopes, curvatures = (above - below) / (2 * _STEPS[:, None]), (above - 2 * mean + below) / _STEPS[:, None] ** 2
    spreads = slice(shots.speed is not None, 2)
    scales = slopes[spreads].T ** 2
    # Where a measurement hardly depends on the angle (or the speed), the first order vanishes.
    return Response(mean[0], slopes.T, np.maximum(scales, 1e-6 * scales.mean(0) + 1e-12), curvatures[spreads].T)


def expected_vertical(shots: Shots, values: Mapping[str, Any]) -> Array:
    """Return the vertical measurements without dispersion [m], shape (N,), or (R, N).

    Args:
      shots: N settings, and measured speeds if there are any.
      values: parameters in SI units, those of `SHAPING` and the length, shape () or (R, 1); to measured speeds the
        value of "speed" is added.
    """
    speed = values["speed"] + (0.0 if shots.speed is None else shots.speed)
    angle = shots.pitch + values["pitch_offset"]
    if shots.hit_height is None:
        # A muzzle ahead of the pivot rises with the barrel: by 14 mm at 5° and 0.16 m, which would pass for an offset.
        return landing_distance(speed, angle, values["height"] + values["length"] * np.sin(shots.pitch), values["drag"])
    sideways = shots.yaw if shots.lateral is None else np.arctan2(shots.lateral, shots.distance)
    speed, angle, sideways = np.broadcast_arrays(speed, angle, sideways)
    velocity = speed[..., None] * direction(np.stack([angle, sideways], axis=-1))
    return np.asarray(flat_fire_crossing(0 * velocity, velocity, shots.distance, values["drag"]).height)


def landing_distance(speed: Array, angle: Array, height: Array, drag: Array) -> Array:
    """Horizontal distance from the muzzle to the landing point on level ground, by the flat-fire flight.

    The time of flight solves h + sin(angle) log1p(k v t)/k − drop(t) = 0, by Newton's method from that without drag,
    (v_z + √(v_z² + 2 g h))/g. Departs from eq (5), which has no drag in z. Against quadratic drag in three dimensions
    it is right to 1.3 mm or 0.04 % for slopes within 5°, to 0.7 % at 15° (k = 0.019 1/m, 10–30 m/s, up to 1 m high).

    Args:
      speed: muzzle speed [m/s], shape B.
      angle: elevation of departure [rad], shape B.
      height: of the muzzle above the ground [m], shape B.
      drag: k [1/m], shape B.

    Returns:
      Distance [m], shape B.
    """
    speed, angle, height, drag = np.broadcast_arrays(speed, angle, height, drag)
    velocity = speed[..., None] * direction(np.stack([angle, 0 * angle], axis=-1))
    rise = velocity[..., 2]
    time = (rise + np.sqrt(rise**2 + 2 * GRAVITY * height)) / GRAVITY
    for _ in range(_NEWTON_STEPS):
        slowing = 1 / (1 + drag * speed * time)
        # The derivative of flat_fire_drop is g t (1 + 1/(1 + k v t))/2.
        climb = rise * slowing - 0.5 * GRAVITY * time * (1 + slowing)
        time = time - (height + flat_fire_position(velocity, drag, time)[..., 2]) / climb
    return np.asarray(flat_fire_position(velocity, drag, time)[..., 0])


def measured_vertical(shots: Shots) -> Array:
    """Return what the elevation of departure decides: landing distance or height of the hit [m], shape (N,)."""
    return np.asarray(shots.distance if shots.hit_height is None else shots.hit_height)


def azimuth(shots: Shots) -> Array | None:
    """Return the azimuth of each departure against the barrel's [rad], shape (N,); None without lateral distances."""
    if shots.lateral is None or shots.hit_height is None:
        return None if shots.lateral is None else np.arcsin(np.clip(shots.lateral / shots.distance, -1.0, 1.0))
    return np.asarray(np.arctan2(shots.lateral, shots.distance) - shots.yaw)


class MuzzleFit(NamedTuple):
    """Estimate from the vertical measurements of N shots, with q free parameters and c spreads."""

    free: list[str]  # names of the parameters that shape the mean and are estimated
    values: Parameters  # parameters that shape the mean, given or estimated
    response: Response  # there
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
    (low, high), measured = np.array([RANGES[name] for name in free]).T, measured_vertical(shots) - shift

    def moved(point: Array) -> Parameters:
        return {**values, **dict(zip(free, point.tolist(), strict=True))}

    def ratio(point: Array) -> Array:
        return np.asarray((measured - expected_vertical(shots, moved(point))) / sd)

    start = np.clip([values[name] for name in free], low + 1e-9, high - 1e-9)
    return moved(optimize.least_squares(ratio, start, bounds=(low, high), loss=loss, x_scale=0.1 * (high - low)).x)


def robust_fit(shots: Shots, free: list[str], known: Parameters) -> tuple[Parameters, Array]:
    """Fit the means by Cauchy's loss.

    Returns:
      All parameters, and the residuals in robust standard deviations, shape (N,).
    """
    measured, typical = measured_vertical(shots), _TYPICAL[shots.speed is not None :]
    values: Parameters = {**_START, **known}
    for loss in ("soft_l1", "cauchy", "cauchy"):
        sd = np.sqrt(linearised(shots, values).scales @ typical)
        values = fit_means(shots, free, values, sd, loss=loss)
    deviation = (measured - expected_vertical(shots, values)) / sd
    scale = max(1.4826 * np.median(np.abs(deviation)), rounding_step(measured) / np.median(sd) / 3.5)
    return values, deviation / scale


def fit_muzzle(shots: Shots, free: list[str], values: Parameters) -> MuzzleFit:
    """Estimate the free parameters, from values nearby, and the spreads."""
    typical, measured = _TYPICAL[shots.speed is not None :], measured_vertical(shots)
    number, _ = shots.settings()
    groups = (number[:, None] == np.arange(number.max() + 1)).astype(float)
    pure = len(shots) - groups.shape[1] >= max(4, (len(shots) - len(free)) / 2)
    step, speed_step, variances = rounding_step(measured), rounding_step(shots.speed), typical
    for _ in range(_ROUNDS):
        there = linearised(shots, values)
        rounding = (step**2 + (speed_step * there.slopes[:, 0]) ** 2) / 12
        design = there.slopes[:, list(map(SHAPING.index, free))]
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
        pivots = list[Array]()
        for residual in noise:
            drawn = variance_components(residual, fit.within, scales, fit.rounding)
            pivots.append((drawn.unconstrained - fit.variances) / drawn.errors)
        tails = np.quantile(pivots, [0.975, 0.025], axis=0, method="weibull")
        squares = fit.spreads.unconstrained - longer[1] * tails * fit.spreads.errors
    inverse = np.linalg.pinv(fit.design / fit.sd[:, None], rcond=1e-9)
    half = stats.t.ppf(0.975, freedom) * np.sqrt(misfit) * longer[0] * np.linalg.norm(inverse, axis=1)
    half += rounded * np.abs(inverse @ (fit.response.slopes[:, 0] / fit.sd))
    means, names = np.array([fit.values[name] for name in fit.free]), [*fit.free, *SPREAD_NAMES[-scales.shape[1] :]]
    ends = np.hstack([[means - half, means + half], np.sqrt(np.maximum(squares, 0.0))])
    found = np.vstack([[*means, *np.sqrt(fit.variances)], ends])
    found = np.clip(found, *np.array([RANGES[name] for name in names]).T)
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

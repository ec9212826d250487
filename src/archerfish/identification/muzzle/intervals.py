"""95 % intervals of the muzzle's parameters: profiles of the likelihood, and exact ones of plain samples."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

from archerfish.identification.muzzle.fit import MuzzleFit, fit_means
from archerfish.identification.muzzle.model import RANGES, MuzzleProblem, decode, limits
from archerfish.identification.muzzle.profile_likelihood import interval_end, mean_threshold, spread_threshold
from archerfish.identification.muzzle.restricted_likelihood import profile_deviance, variance_information

Array = NDArray[np.float64]
Interval = tuple[float, float]

_SETTLED = 2e-2
"""Last step of a profile's parameters over their standard errors: its squares are right to 1e-3."""


def shaping_interval(problem: MuzzleProblem, fit: MuzzleFit, index: int, misfit: float = 1.0) -> Interval:
    """Profile interval of one free parameter; a side that the shots leave open ends where the search ends.

    Args:
      problem: the shots that were fitted.
      fit: the estimate.
      index: which free parameter.
      misfit: variance of the settings' means over what scatter explains; a larger one than 1 widens the interval.
    """
    name, best = problem.free[index], float(fit.point[index])
    others = np.arange(fit.point.size) != index
    low, high = (float(end[index]) for end in limits(problem.free))
    inverse = np.linalg.pinv(fit.design / fit.expected_sd[:, None], rcond=1e-9)
    covariance = inverse @ inverse.T
    allowed = max(misfit, 1.0) * mean_threshold(fit.residuals.freedom)
    reach = float(np.sqrt(allowed * covariance[index, index]))
    stride = float(np.clip(reach, 1e-4 * (high - low), 0.2 * (high - low)))
    # The ridge of the likelihood, along which the others follow, is nearly straight.
    ridge = covariance[others, index] / max(covariance[index, index], 1e-300)
    least = float(np.sum((fit.residuals.residual / fit.expected_sd) ** 2))

    def walk(end: float) -> float:
        place, start = best, fit.point[others]

        def rise(value: float) -> float:
            nonlocal place, start
            held = replace(problem, known={**problem.known, name: decode(name, value)})
            guess = np.clip(start + ridge * (value - place), *limits(held.free))
            found = fit_means(held, guess, fit.expected_sd, fit.shift, _SETTLED)
            place, start = value, found.point
            return found.squares - least

        return decode(name, interval_end(rise, allowed, best, stride, end))

    return walk(low), walk(high)


def spread_interval(problem: MuzzleProblem, fit: MuzzleFit, component: int) -> Interval:
    """Profile interval of a standard deviation; it begins at 0 where the shots don't exclude that."""
    residuals, best = fit.residuals, float(np.sqrt(fit.variances[component]))
    freedom = _effective_freedom(fit, component)
    allowed, least = spread_threshold(freedom), profile_deviance(residuals, component, best**2)
    # An estimate of zero has no standard error: all of the scatter is the scale then.
    most = float(np.sqrt(np.mean(residuals.residual**2 / residuals.scales[component])))
    stride = max(1.5 * best / np.sqrt(2 * freedom), 0.05 * most)

    def rise(sd: float) -> float:
        return profile_deviance(residuals, component, sd**2) - least

    highest = RANGES[problem.spreads[component]][1]
    low, high = (interval_end(rise, allowed, best, stride, end) for end in (0.0, highest))
    return low, high


def _effective_freedom(fit: MuzzleFit, component: int) -> float:
    """Degrees of freedom that a variance is known with (Satterthwaite): 1/(2 Var(log σ))."""
    variance = np.linalg.pinv(variance_information(fit.residuals, fit.variances))[component, component]
    return float(np.clip(0.5 / variance if variance > 0 else 0.0, 2.0, fit.residuals.freedom))


def sample_intervals(sample: Array) -> tuple[Interval, Interval]:
    """Exact normal-theory intervals of the mean and of the standard deviation of a sample, shape (N,)."""
    freedom, mean, sd = sample.size - 1, float(sample.mean()), float(sample.std(ddof=1))
    half = float(student.ppf(0.975, freedom)) * sd / np.sqrt(sample.size)
    low, high = (sd * float(np.sqrt(freedom / chi2.ppf(level, freedom))) for level in (0.975, 0.025))
    return (mean - half, mean + half), (low, high)

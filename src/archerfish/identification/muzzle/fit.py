"""The muzzle that shots are likeliest under: means by generalised least squares, spreads by restricted likelihood.

Where settings are repeated the spreads come from the scatter within the settings alone (pure error), so that a flight
model that does not fit can't pass for dispersion; else from the residuals. The two are found in turns.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.muzzle.model import (
    RANGES,
    TYPICAL,
    MuzzleProblem,
    Response,
    decode,
    encode,
    limits,
    response,
)
from archerfish.identification.muzzle.restricted_likelihood import Residuals, fit_variances
from archerfish.records.shots import settings, vertical_measurement

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ROUNDS = 15
"""Of means and spreads in turns; three or four are usual."""
_STEPS = 30
"""Of Gauss and Newton, for given spreads."""
_SETTLED = 1e-3
"""Last step of a parameter over its standard error."""
_HALVINGS = 8
_LEAST = 1e-9
"""Of the largest variance: a smaller one counts as zero, and keeps this value so that densities exist."""
_LONGEST_STEP = 0.7
"""Of an encoded parameter: radians, or a factor of 2 in the positive ones."""


class MeanFit(NamedTuple):
    """Means of N shots with q free parameters, for given standard deviations."""

    point: Array
    """Encoded free parameters, shape (q,)."""
    answer: Response
    """The model there."""
    residual: Array
    """Measured less expected [m], shape (N,)."""
    squares: float
    """Sum of the squares of residuals over standard deviations."""


class MuzzleFit(NamedTuple):
    """Estimate from the vertical measurements of N shots, with q free parameters and c spreads."""

    point: Array
    """Encoded free parameters, shape (q,)."""
    values: dict[str, float]
    """Parameters that shape the mean, given or estimated, and the spreads that were estimated, in SI units."""
    design: Array
    """Derivatives of the expected measurements by the encoded free parameters, shape (N, q)."""
    residuals: Residuals
    """What the spreads were estimated from."""
    variances: Array
    """Of the spreads [(m/s)²], [rad²], shape (c,)."""
    shift: Array
    """Part of the expected measurements that the spreads cause [m], shape (N,)."""
    expected: Array
    """Expected measurements [m], shape (N,)."""
    expected_sd: Array
    """Their standard deviations [m], shape (N,)."""


def fit_muzzle(problem: MuzzleProblem, start: Mapping[str, float]) -> MuzzleFit:
    """Maximise the likelihood from a start, a guess of the free parameters."""
    low, high = limits(problem.free)
    point = np.clip([encode(name, start[name]) for name in problem.free], low, high)
    answer, variances = response(problem, values_at(problem, point)), TYPICAL[-len(problem.spreads) :]
    most = np.array([RANGES[name][1] for name in problem.spreads]) ** 2
    for _ in range(_ROUNDS):
        sd, shift = answer.sd(variances), answer.shift(variances)
        means = fit_means(problem, point, sd, shift)
        moved = np.abs(means.point - point) > _SETTLED * _errors(means.answer.design, sd)
        point, answer = means.point, means.answer
        residuals = Residuals(means.residual, _nuisance(problem, answer), answer.scales)
        before, variances = variances, np.clip(fit_variances(residuals), _LEAST * most, most)
        if not moved.any() and np.allclose(before, variances, rtol=2e-3, atol=1e-6 * float(most.min())):
            break
    return _fit(problem, means, residuals, variances)


def fit_means(problem: MuzzleProblem, start: Array, sd: Array, shift: Array, settled: float = _SETTLED) -> MeanFit:
    """Find the means by Gauss and Newton within the ranges of the parameters.

    Args:
      problem: the shots and what is known.
      start: encoded free parameters, shape (q,).
      sd: standard deviation of each measurement [m], shape (N,).
      shift: added to the expected measurements [m], shape (N,).
      settled: last step of a parameter over its standard error.
    """
    low, high = limits(problem.free)
    here = _means_at(problem, start, sd, shift)
    for _ in range(_STEPS):
        step, error = _gauss_newton(here, sd, low, high)
        moving = step != 0
        room = np.where(step > 0, high - here.point, low - here.point)[moving] / step[moving]
        share = float(np.min(room, initial=1.0))
        for _ in range(_HALVINGS):
            after = _means_at(problem, np.clip(here.point + share * step, low, high), sd, shift)
            if after.squares <= here.squares * (1 + 1e-9):
                break
            share *= 0.4
        done = bool(np.all(np.abs(after.point - here.point) <= settled * error))
        here = after
        if done:
            break
    return here


def values_at(problem: MuzzleProblem, point: Array) -> dict[str, float]:
    """Return the parameters that shape the mean, for encoded free parameters of shape (q,)."""
    found = {name: decode(name, value) for name, value in zip(problem.free, point, strict=True)}
    return {**problem.known, **found}


def _means_at(problem: MuzzleProblem, point: Array, sd: Array, shift: Array) -> MeanFit:
    answer = response(problem, values_at(problem, point))
    residual = vertical_measurement(problem.shots) - answer.mean - shift
    return MeanFit(point, answer, residual, float(np.sum((residual / sd) ** 2)))


def _gauss_newton(here: MeanFit, sd: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Step of the free parameters and their standard errors, shape (q,) each; none out of a range that is reached."""
    movable, step, error = np.ones(here.point.size, bool), np.zeros(here.point.size), np.zeros(here.point.size)
    for _ in range(here.point.size + 1):
        inverse = np.linalg.pinv(here.answer.design[:, movable] / sd[:, None], rcond=1e-9)
        step[:], error[:] = 0.0, np.inf
        step[movable], error[movable] = inverse @ (here.residual / sd), np.linalg.norm(inverse, axis=1)
        pressed = ((here.point <= low) & (step < 0)) | ((here.point >= high) & (step > 0))
        if not pressed.any():
            break
        movable &= ~pressed
    return step * _LONGEST_STEP / np.max(np.abs(step), initial=_LONGEST_STEP), error


def _errors(design: Array, sd: Array) -> Array:
    return np.asarray(np.linalg.norm(np.linalg.pinv(design / sd[:, None], rcond=1e-9), axis=1))


def _nuisance(problem: MuzzleProblem, answer: Response) -> Array:
    """Columns that the spreads must not take for scatter: every setting's mean if there are enough repetitions."""
    number = settings(problem.shots)
    count, shaping = number.size, answer.design.shape[1]
    repeated = count - (number.max() + 1)
    if repeated < max(4.0, 0.5 * (count - shaping)):
        return answer.design
    return np.asarray(number[:, None] == np.arange(number.max() + 1), dtype=float)


def _fit(problem: MuzzleProblem, means: MeanFit, residuals: Residuals, variances: Array) -> MuzzleFit:
    least = _LEAST * np.array([RANGES[name][1] for name in problem.spreads]) ** 2
    spreads = np.where(variances > least, np.sqrt(variances), 0.0)
    return MuzzleFit(
        point=means.point,
        values=values_at(problem, means.point) | dict(zip(problem.spreads, spreads.tolist(), strict=True)),
        design=means.answer.design,
        residuals=residuals,
        variances=variances,
        shift=means.answer.shift(variances),
        expected=vertical_measurement(problem.shots) - means.residual,
        expected_sd=means.answer.sd(variances),
    )

"""Ricochets and flyers: shots that don't belong to the rest, found before the likelihood is maximised.

A robust fit (Tukey's biweight) suspects shots. The muzzle is then estimated without them, and a shot is left out that
lies further from that estimate than the furthest of as many good shots would in 1 % of all sets: beyond the quantile of
Student's t at 0.01/(2 N m), for N shots and m measurements of each. Suspects within it are taken back in; a shot that
is among the others of its setting counts as one of them. A clean set so keeps all its shots 99 times of 100.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from archerfish.identification.muzzle.fit import MuzzleFit, fit_means, fit_muzzle, values_at
from archerfish.identification.muzzle.model import TYPICAL, MuzzleProblem, encode, limits, response
from archerfish.records.shots import departure_azimuth, select_shots, settings, vertical_measurement

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FALSE_ALARM = 0.01
"""Share of clean sets that lose a shot."""
FEWEST = 10
"""Shots below which none is left out: too few to tell what belongs to the rest."""
MOST = 0.2
"""Largest share of shots that may be left out; beyond it the set has no clear majority."""

_SUSPECT = 3.5
"""Robust standard deviations from which a shot is suspect."""
_BIWEIGHT = 4.685
_REPEATED = 5
"""Shots from which the median of a setting tells where it is."""
_STARTS = 3
_WEIGHINGS = 6
_ROUNDS = 8


class Sorted(NamedTuple):
    """The shots that belong together, and their muzzle."""

    kept: Flags
    """Which shots they are, shape (N,)."""
    problem: MuzzleProblem
    """The same problem with those shots alone."""
    fit: MuzzleFit
    """Estimate from those shots."""
    too_many: int
    """Number of shots that seemed not to belong, where it was too large for leaving them out; else 0."""


class RobustFit(NamedTuple):
    """A fit that a minority of bad shots can't spoil."""

    values: dict[str, float]
    """Parameters that shape the mean, given or estimated, in SI units."""
    deviation: Array
    """Residuals over the robust standard deviation, shape (N,)."""
    scale: float
    """Robust standard deviation over the one of typical spreads."""


def sort_out(problem: MuzzleProblem) -> Sorted:
    """Estimate the muzzle without the shots that don't belong to the rest."""
    robust = robust_fit(problem)
    everything = np.ones(len(problem.shots), bool)
    kept = everything
    if kept.size >= FEWEST:
        samples = [_apart(problem, robust.deviation), *(_robust_deviation(sample) for sample in _samples(problem))]
        kept = np.all(np.array(samples) <= _SUSPECT, axis=0)
    for _ in range(_ROUNDS):
        if np.count_nonzero(~kept) > MOST * kept.size:
            break
        part = replace(problem, shots=select_shots(problem.shots, kept))
        fit = fit_muzzle(part, robust.values)
        belonging = _belonging(problem, fit, kept) if kept.size >= FEWEST else everything
        if np.array_equal(belonging, kept):
            return Sorted(kept, part, fit, 0)
        kept = belonging
    return Sorted(everything, problem, fit_muzzle(problem, robust.values), int(np.count_nonzero(~kept)))


def robust_fit(problem: MuzzleProblem) -> RobustFit:
    """Fit the means by Tukey's biweight, from several starts."""
    found = [_reweighted(problem, start) for start in _starts(problem)[:_STARTS]]
    return min(found, key=lambda fit: fit.scale)


def _reweighted(problem: MuzzleProblem, start: Mapping[str, float]) -> RobustFit:
    low, high = limits(problem.free)
    point = np.clip([encode(name, start[name]) for name in problem.free], low, high)
    none = np.zeros(len(problem.shots))
    weight = none + 1.0
    for _ in range(_WEIGHINGS):
        answer = response(problem, values_at(problem, point))
        shape = answer.sd(TYPICAL[-len(problem.spreads) :])
        ratio = (vertical_measurement(problem.shots) - answer.mean) / shape
        scale = max(1.4826 * float(np.median(np.abs(ratio))), 1e-9)
        weight = np.maximum(1.0 - (ratio / scale / _BIWEIGHT) ** 2, 1e-3)
        point = fit_means(problem, point, shape / weight, none, settled=0.1).point
    return RobustFit(values_at(problem, point), ratio / scale, scale)


def _starts(problem: MuzzleProblem) -> list[dict[str, float]]:
    """Spread starts over the speed and the pitch offset, which trade against each other; the best come first."""
    speeds = [8.0, 15.0, 25.0] if problem.shots.speed is None else [float(np.median(problem.shots.speed))]
    guesses = [
        {"speed": speed, "pitch_offset": offset, "height": 0.4, "drag": 0.02, **problem.known}
        for speed in speeds
        for offset in (-0.1, -0.03, 0.0, 0.03)
    ]

    def badness(guess: Mapping[str, float]) -> float:
        answer = response(problem, guess)
        ratio = (vertical_measurement(problem.shots) - answer.mean) / answer.sd(TYPICAL[-len(problem.spreads) :])
        return float(np.median(np.abs(ratio)))

    return sorted(guesses, key=badness)


def _samples(problem: MuzzleProblem) -> list[Array]:
    """Return the measurements of each shot beside the vertical one that there are: speed and azimuth, shape (N,)."""
    return [sample for sample in (problem.shots.speed, departure_azimuth(problem.shots)) if sample is not None]


def _robust_deviation(sample: Array) -> Array:
    distance = np.abs(sample - np.median(sample))
    return np.asarray(distance / max(1.4826 * float(np.median(distance)), 1e-12))


def _apart(problem: MuzzleProblem, deviation: Array) -> Array:
    """How far each shot is from the model or from its setting's median, whichever is less, shape (N,).

    A setting that is off as a whole is a lack of fit and none of its shots a ricochet.
    """
    number, apart = settings(problem.shots), np.abs(deviation)
    for group in np.flatnonzero(np.bincount(number) >= _REPEATED):
        shots = number == group
        apart[shots] = np.minimum(apart[shots], np.abs(deviation[shots] - np.median(deviation[shots])))
    return apart


def _belonging(problem: MuzzleProblem, fit: MuzzleFit, kept: Flags) -> Flags:
    """Which shots lie within the limit of the estimate from those that were kept, shape (N,)."""
    answer = response(problem, fit.values)
    residual = vertical_measurement(problem.shots) - answer.mean - answer.shift(fit.variances)
    deviations = [_apart(problem, residual / answer.sd(fit.variances))]
    for sample in _samples(problem):
        deviations.append(np.abs(sample - sample[kept].mean()) / sample[kept].std(ddof=1))
    level = 1 - FALSE_ALARM / (2 * kept.size * len(deviations))
    limit = float(student.ppf(level, max(fit.residuals.freedom, 1)))
    return np.asarray(np.all(np.array(deviations) <= limit, axis=0))

"""How well each structure explains the recordings under noise of any colour, by Bayes's information criterion.

Between the lines of a spectrum stationary noise is as good as uncorrelated, whatever its colour (Whittle 1953). With
the power S_k that the best fit leaves around each line, minus twice the log likelihood of a structure is
Σ_k |residual_k|² / S_k up to a constant, and differences between structures count in full where the noise is low: a
slow drift of the output hides nothing of a delay.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.delay_walk import rounding
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.out_of_band import scaled_penalty
from archerfish.identification.axis.pole_pursuit import pursue_poles
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_all, refine_poles
from archerfish.identification.axis.simulation_fit import LinearFit
from archerfish.identification.axis.spectra import Spectrum, row_count
from archerfish.identification.axis.structure_choice import Structure

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES = 1500
"""Lines that are looked at: those where the response is loudest over the noise."""
_BORROWED = 8
"""Lines that the next higher octave counts as."""
_CLEARLY_WORSE, _FURTHEST = 10.0, 12
"""Difference of the criterion, and of the delays, up to which neighbours are looked at."""
_EFFORT, _ROUGH = Effort(0.3, 8), Effort(1.0, 6)
_FEW_LINES = 300


class Evidence(NamedTuple):
    """What structures are compared on: the loudest lines, weighed by the noise that the best of them leaves."""

    weighted: Ground
    """Those lines."""
    noise: float
    """Mean power of the noise, in the unit of the outputs before they were weighed."""
    rows: int
    """Independent residuals of all lines, over which a parameter counts."""

    def criterion(self, structure: Structure) -> float:
        """Return the information criterion of a structure, its poles refined on these lines."""
        problem, fit = self.refined(structure)
        parameters = len(fit.numerators) + fit.numerators.size + problem.feedthrough * fit.feedthrough.size
        parameters += sum(each.rest is None for each in problem.experiments) * fit.numerators[:, 0].size
        return fit.misfit + parameters * float(np.log(self.rows))

    def refined(self, structure: Structure) -> tuple[Problem, LinearFit]:
        """Return a structure's problem on these lines, and its fit."""
        problem = self.problem(structure)
        return problem, refine_poles(structure.refinement.sections, problem, _EFFORT).fit

    def problem(self, structure: Structure) -> Problem:
        """Return a structure's problem on these lines."""
        # Without the prior, poles outside the excited band would fit what noise is there.
        penalty = structure.problem.penalty
        if penalty is not None:
            penalty = scaled_penalty(penalty, 1 / np.sqrt(max(self.noise, np.finfo(float).tiny)))
        return Problem(self.weighted.spectra(structure.delay), structure.problem.feedthrough, penalty)


def gather(structures: Sequence[Structure], ground: Ground) -> Evidence:
    """Make ready to compare structures.

    Args:
      structures: of one axis, of any orders and delays.
      ground: all lines of its recordings.
    """
    # Else a slow pole too many would win by following a drift with its transient.
    ground = ground.drifting()
    fits = [_fit(each, ground) for each in structures]
    best = int(np.argmin([each.misfit for each in fits]))
    experiments = ground.spectra(structures[best].delay)
    residuals = _residuals(fits[best], experiments)
    powers = [noise_power(np.mean(0.5 * np.abs(each) ** 2, axis=1)) for each in residuals]
    floor = max(rounding(experiments) / row_count(experiments), np.finfo(float).tiny)
    weights = [1 / np.sqrt(np.maximum(each, floor)) for each in powers]
    weighted = ground.weighted(weights)._replace(lines=_loudest(experiments, residuals, weights))
    count = experiments[0].outputs.shape[1] * row_count(experiments)
    return Evidence(weighted, float(np.mean(np.concatenate(powers))), count)


def neighbours(structure: Structure, evidence: Evidence, longest: int) -> list[tuple[Structure, float]]:
    """Return structures of the same order at the delays beside one, until they are clearly worse, with their criteria.

    Args:
      structure: to begin with.
      evidence: to compare on.
      longest: longest delay [samples].
    """
    found = []
    best = evidence.criterion(structure)
    for side in (-1, 1):
        here, value = structure, best
        while value < best + _CLEARLY_WORSE and abs(here.delay - structure.delay) < _FURTHEST:
            if not 0 <= here.delay + side <= longest:
                break
            here = here._replace(delay=here.delay + side)
            value = evidence.criterion(here)
            found.append((here, value))
    return found


def pursued(structure: Structure, order: int, delays: Sequence[int], evidence: Evidence) -> tuple[Structure, float]:
    """Build poles anew at some delays, on the lines as they are weighed here; return the best structure, its criterion.

    A delay too long takes the place of a lag, and a slow disturbance that of a pole: a search that is led astray by
    either sees from there only that every other delay is worse.

    Args:
      structure: of the same axis, for its prior.
      order: number of poles.
      delays: to build poles for [samples].
      evidence: to compare on.
    """
    few = evidence._replace(weighted=evidence.weighted.thinned(_FEW_LINES))
    found = []
    for delay in delays:
        problem = few.problem(structure._replace(delay=delay, problem=structure.problem._replace(feedthrough=True)))
        found.append((refine_all(pursue_poles(problem, order), problem, _ROUGH)[0], delay))
    refinement, delay = min(found, key=lambda each: each[0].cost)
    best = structure._replace(delay=delay, problem=structure.problem._replace(feedthrough=False), refinement=refinement)
    return best, evidence.criterion(best)


def _fit(structure: Structure, ground: Ground) -> LinearFit:
    problem = Problem(ground.spectra(structure.delay), structure.problem.feedthrough)
    return solve(structure.refinement.sections, lay_out(*problem)).fit


def _residuals(fit: LinearFit, experiments: Sequence[Spectrum]) -> list[ComplexArray]:
    """Return the residuals of each experiment, shape (F, p) each."""
    rows = fit.residuals.reshape(experiments[0].outputs.shape[1], -1)
    edges = np.cumsum([0, *(2 * each.lag.size for each in experiments)])
    halves = [np.split(rows[:, start:stop], 2, axis=1) for start, stop in pairwise(edges)]
    return [(real + 1j * imaginary).T for real, imaginary in halves]


def noise_power(squares: Array) -> Array:
    """Return the power of a residual at each line, shape (F,), from its squares: smooth over the octaves.

    An average over few lines would follow what the fit has left there by chance, and call every other fit wrong. So
    each octave has one mean, which counts the next higher one as some lines more, and the power is interpolated
    between them.
    """
    edges = [0, *(2**k - 1 for k in range(1, int(np.log2(squares.size + 1)) + 1)), squares.size]
    bands = [(first, last) for first, last in pairwise(dict.fromkeys(edges)) if last > first]
    centres, means = [], []
    above = float(squares[squares.size // 2 :].mean())
    for first, last in reversed(bands):
        above = (float(squares[first:last].sum()) + _BORROWED * above) / (last - first + _BORROWED)
        centres.append(np.log(0.5 * (first + last + 1)))
        means.append(above)
    powers = np.log(np.maximum(means[::-1], np.finfo(float).tiny))
    return np.asarray(np.exp(np.interp(np.log(np.arange(1, squares.size + 1)), centres[::-1], powers)))


def _loudest(
    experiments: Sequence[Spectrum], residuals: Sequence[ComplexArray], weights: Sequence[Array]
) -> list[NDArray[np.intp]]:
    """Return the indices of the lines where the response stands out most of the noise, per experiment.

    The response is that of the fit: lines that were chosen by the measured output would favour the fits whose residuals
    are small there by chance.
    """
    total = sum(each.lag.size for each in experiments)
    chosen = []
    for each, residual, weight in zip(experiments, residuals, weights, strict=True):
        loudness = np.mean(np.abs(each.outputs - residual) ** 2, axis=1) * weight**2
        lines = min(each.lag.size, max(100, _LINES * each.lag.size // total))
        chosen.append(np.sort(np.argsort(-loudness, kind="stable")[:lines]))
    return chosen

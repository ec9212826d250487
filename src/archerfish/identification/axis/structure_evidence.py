"""How well each structure explains the recordings under noise of any colour, by Bayes's information criterion.

Between the lines of a spectrum stationary noise is as good as uncorrelated, whatever its colour (Whittle 1953). With
the power S_k that the best fit leaves around each line, minus twice the log likelihood of a structure is
Σ_k |residual_k|² / S_k up to a constant, and differences between structures count in full where the noise is low: a
slow drift of the output hides nothing of a delay.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.delay_walk import rounding
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_poles
from archerfish.identification.axis.simulation_fit import LinearFit
from archerfish.identification.axis.spectra import Spectrum, row_count
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.axis.uncertainty import power_around

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES = 1500
"""Lines that are looked at: those where the response is loudest over the noise."""
_EFFORT = Effort(0.3, 8)


def structure_criteria(structures: Sequence[Structure], ground: Ground) -> Array:
    """Return the information criterion of each structure, shape (k,); the same lines and the same noise for all.

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
    powers = [power_around(np.mean(0.5 * np.abs(each) ** 2, axis=1)) for each in residuals]
    floor = rounding(experiments) / row_count(experiments)
    weights = [1 / np.sqrt(np.maximum(each, max(floor, np.finfo(float).tiny))) for each in powers]
    loudest = _loudest(experiments, residuals, weights)
    weighted = ground.weighted(weights)._replace(lines=loudest)
    count = len(experiments[0].outputs[0]) * row_count(experiments)
    return np.array([_criterion(each, weighted, count) for each in structures])


def _fit(structure: Structure, ground: Ground) -> LinearFit:
    problem = Problem(ground.spectra(structure.delay), structure.problem.feedthrough)
    return solve(structure.refinement.sections, lay_out(*problem)).fit


def _residuals(fit: LinearFit, experiments: Sequence[Spectrum]) -> list[ComplexArray]:
    """Return the residuals of each experiment, shape (F, p) each."""
    rows = fit.residuals.reshape(experiments[0].outputs.shape[1], -1)
    edges = np.cumsum([0, *(2 * each.lag.size for each in experiments)])
    halves = [np.split(rows[:, start:stop], 2, axis=1) for start, stop in pairwise(edges)]
    return [(real + 1j * imaginary).T for real, imaginary in halves]


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


def _criterion(structure: Structure, ground: Ground, count: int) -> float:
    problem = Problem(ground.spectra(structure.delay), structure.problem.feedthrough)
    fit = refine_poles(structure.refinement.sections, problem, _EFFORT).fit
    parameters = len(fit.numerators) + fit.numerators.size + problem.feedthrough * fit.feedthrough.size
    parameters += sum(each.rest is None for each in problem.experiments) * fit.numerators[:, 0].size
    return fit.misfit + parameters * float(np.log(count))

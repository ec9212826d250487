"""Which lines of spectra a fit needs to look at, and which few do for a search."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from archerfish.identification.axis.pole_refinement import Problem, Refinement
from archerfish.identification.axis.simulation_fit import linear_parameters, transfer_columns
from archerfish.identification.axis.spectra import Spectrum, picked

Array = NDArray[np.float64]

_SILENT = 0.1
"""Response to the input over the noise, in power, below which a line tells nothing."""
_FEWEST = 0.02
"""Share of the lines of an experiment that is kept at least, so that its transient stays determined."""


def telling_lines(problem: Problem, refinement: Refinement) -> list[NDArray[np.intp]]:
    """Find the lines where the response to the input is not drowned by the noise.

    The response is that of a fit or, if it is larger, that of the fit's mean gain: where the fit is silent by mistake a
    line may tell so.

    Args:
      problem: all lines of all experiments.
      refinement: a fit to all or some of them.

    Returns:
      Per experiment the indices of its telling lines.
    """
    noise = 2 * refinement.fit.misfit / refinement.fit.residuals.size
    gain = mean_squared_gain(problem, refinement)
    chosen = []
    for each, response in zip(problem.experiments, _squared_gains(problem, refinement), strict=True):
        loudness = np.sum(np.abs(each.inputs) ** 2 * np.maximum(response, gain), axis=1)
        fewest = min(each.lag.size, max(10 * len(refinement.fit.numerators), round(_FEWEST * each.lag.size)))
        threshold = min(_SILENT * noise, float(np.partition(loudness, -fewest)[-fewest]))
        chosen.append(np.flatnonzero(loudness >= threshold))
    return chosen


def mean_squared_gain(problem: Problem, refinement: Refinement) -> Array:
    """Power of the response over that of each input, averaged over the outputs, shape (m,)."""
    energies = [np.abs(each.inputs) ** 2 for each in problem.experiments]
    gains = _squared_gains(problem, refinement)
    response = sum(np.sum(energy * gain, axis=0) for energy, gain in zip(energies, gains, strict=True))
    return np.asarray(response / np.maximum(sum(energy.sum(axis=0) for energy in energies), np.finfo(float).tiny))


def _squared_gains(problem: Problem, refinement: Refinement) -> list[Array]:
    """Squared gain from each input at each line, averaged over the outputs, shape (F, m) per experiment."""
    inputs = problem.experiments[0].inputs.shape[1]
    parameters = linear_parameters(refinement.fit, problem.feedthrough)
    gains = []
    for each in problem.experiments:
        columns = transfer_columns(refinement.sections, each.lag, inputs, problem.feedthrough)
        gains.append(np.stack([np.mean(np.abs(c @ parameters) ** 2, axis=1) for c in columns], axis=1))
    return gains


def heard_band(problem: Problem, refinement: Refinement) -> tuple[float, float] | None:
    """Find the lowest and highest frequency at which the fitted response to the inputs is louder than the residual.

    Both are averaged over neighbouring lines, so that the coherence there is above a half.

    Args:
      problem: what was fitted.
      refinement: its fit.

    Returns:
      Radians a sample; None if nothing is heard.
    """
    parameters = linear_parameters(refinement.fit, problem.feedthrough)
    inputs = problem.experiments[0].inputs.shape[1]
    found = []
    for each in problem.experiments:
        columns = transfer_columns(refinement.sections, each.lag, inputs, problem.feedthrough)
        driven = [c @ parameters * u[:, None] for c, u in zip(columns, each.inputs.T, strict=True)]
        response = np.sum(driven, axis=0)
        width = 2 * max(2, round(np.sqrt(each.lag.size) / 2)) + 1
        loud, noise = (
            uniform_filter1d(np.abs(signal) ** 2, width, axis=0, mode="nearest")
            for signal in (response, each.outputs - response)
        )
        heard = np.any(loud > noise, axis=1)
        if heard.any():
            # Around the loudest line without a gap: far away from it the fit may have followed the noise.
            top = int(np.argmax(np.where(heard, loud.sum(axis=1), 0.0)))
            silent = np.flatnonzero(~heard)
            first = silent[silent < top].max(initial=-1) + 1
            last = silent[silent > top].min(initial=heard.size) - 1
            found.append(np.abs(np.angle(each.lag[[first, last]])))
    return (float(np.min(found)), float(np.max(found))) if found else None


def thinned(experiments: Sequence[Spectrum], lines: int) -> list[Spectrum]:
    """Keep at most about so many lines of all experiments together, for a search.

    Half of them are those where the input is strongest, which carry most of what there is to know of a sweep or a step;
    the others are spread evenly over the rest.

    Args:
      experiments: of one axis.
      lines: how many to keep; experiments with fewer are returned whole.
    """
    return [picked(each, kept) for each, kept in zip(experiments, thinning(experiments, lines), strict=True)]


def thinning(experiments: Sequence[Spectrum], lines: int) -> list[NDArray[np.intp]]:
    """Return the indices of the lines that `thinned` keeps of each experiment."""
    total = sum(each.lag.size for each in experiments)
    if total <= lines:
        return [np.arange(each.lag.size) for each in experiments]
    return [_kept(each, max(50, lines * each.lag.size // total)) for each in experiments]


def _kept(experiment: Spectrum, lines: int) -> NDArray[np.intp]:
    if experiment.lag.size <= lines:
        return np.arange(experiment.lag.size)
    energy = np.abs(experiment.inputs) ** 2
    share = np.sum(energy / np.maximum(energy.mean(axis=0), np.finfo(float).tiny), axis=1)
    order = np.argsort(-share, kind="stable")
    rest = np.sort(order[lines // 2 :])
    spread = rest[:: -(-rest.size // (lines - lines // 2))]
    return np.sort(np.concatenate([order[: lines // 2], spread]))

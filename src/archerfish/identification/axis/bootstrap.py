"""Parametric bootstrap: plants that other noise of the same spectrum would have given (Efron and Tibshirani 1993).

Each structure of the chosen order is drawn as often as it is likely, and refitted to its own response plus noise, which
is drawn for the samples that were measured. A steady gain that is known is drawn from its normal distribution.
"""

from dataclasses import replace

import numpy as np
from numpy.fft import irfft, rfft
from scipy.special import ndtri

from archerfish.identification.axis.constraints import steady_gain
from archerfish.identification.axis.fit import AxisFit
from archerfish.identification.axis.output_error import leverage, plant_of, refine, residuals_by_log, solve
from archerfish.identification.axis.sections import Structure
from archerfish.identification.axis.spectrum import Experiment, Indices, Lines, local_power, strongest
from archerfish.identification.simulation import TINY, Array, Complex
from archerfish.records.plant import PlantRecord

_LINES, _STEPS = 1500, 3  # lines of a draw; steps of its refinement
_LIKELY, _STRUCTURES = 0.02, 7  # weight from which a structure is drawn; how many at most
_FAR = 6.0  # robust standard deviations of a gain beyond which a draw has found another optimum


def draw_plants(found: AxisFit, draws: int, seed: int) -> list[PlantRecord]:
    """Draw plants, in random order; about as many as asked for, less those that are far from the others.

    Args:
      found: the fit.
      draws: how many.
      seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    likely = _likely_structures(found)
    counts = [round(draws * weight / sum(likely.values())) for weight in likely.values()]
    # Evenly spread probabilities, so that the draws of a gain that is known have its spread.
    order = np.random.default_rng([seed, 1]).permutation(sum(counts))
    probabilities = iter((1 + order) / (1 + sum(counts)))
    drawn: list[PlantRecord] = []
    for structure, count in zip(likely, counts, strict=True):
        drawn += _draws_of(found, structure, [next(probabilities) for _ in range(count)], rng)
    near = _near(np.array([plant.dc_gain.ravel() for plant in drawn]))
    return [drawn[place] for place in rng.permutation(np.flatnonzero(near))]


def _likely_structures(found: AxisFit) -> dict[Structure, float]:
    """Return the structures of the chosen order that are drawn, and their weights; the chosen one comes first."""
    chosen, weights = found.structure, found.selection.weights
    others = [s for s, weight in weights.items() if s.order == chosen.order and weight > _LIKELY and s != chosen]
    return {chosen: max(weights[chosen], _LIKELY), **{s: weights[s] for s in others[: _STRUCTURES - 1]}}


def _draws_of(
    found: AxisFit, structure: Structure, probabilities: list[float], rng: np.random.Generator
) -> list[PlantRecord]:
    """Draw plants of one structure, one for each probability of the steady gain."""
    logs = [replace(log, skip=min(log.skip, structure.delay)) for log in found.experiments]
    data = [log.at(structure.delay, structure.feedthrough) for log in logs]
    soft = [lines._replace(feedthrough=structure.feedthrough) for lines in found.constraints]
    known, fit = _known_gain(found, data, 0.5), found.fit
    if structure != found.structure:
        fit = refine(found.selection.found[structure][1].sections, data + soft + known, 10, 1e-6, found.ridge)
    every = solve(fit.sections, data + soft + known)
    residuals = residuals_by_log(every, data + soft + known)[: len(data)]
    responses = [lines.outputs - residual for lines, residual in zip(data, residuals, strict=True)]
    taken = leverage(every, data + soft + known)
    spectra = [_spectrum(*log) for log in zip(logs, residuals, taken, strict=True)]
    picks = strongest([np.mean(np.abs(response) ** 2, axis=0) for response in responses], _LINES)
    lines = [d._replace(outputs=y).pick(k) for d, y, k in zip(data, responses, picks, strict=True)]
    drawn: list[PlantRecord] = []
    for probability in probabilities:
        noise = [_noise(log, power, k, rng) for log, power, k in zip(logs, spectra, picks, strict=True)]
        noisy = [clean._replace(outputs=clean.outputs + e) for clean, e in zip(lines, noise, strict=True)]
        known = _known_gain(found, data, probability)
        again = refine(fit.sections, noisy + soft + known, _STEPS, 1e-4, found.ridge)
        drawn.append(plant_of(again, structure, found.scale, found.plant.sample_period_s))
    return drawn


def _known_gain(found: AxisFit, data: list[Lines], probability: float) -> list[Lines]:
    """Return the constraint of a steady gain that is known, at a quantile of its normal distribution."""
    if found.known_gain is None:
        return []
    gain = found.known_gain.gain + found.known_gain.error * ndtri(probability)
    return [steady_gain(gain / found.scale[:, None], data)]


def interval(values: Array) -> Array:
    """Return the 95 % interval of draws (their first axis) by Weibull's plotting positions, shape (2, …)."""
    return np.asarray(np.quantile(values, [0.025, 0.975], axis=0, method="weibull"))


def _near(values: Array) -> Array:
    """Which rows are within some robust standard deviations of the median."""
    middle = np.median(values, axis=0)
    sd = 1.4826 * np.median(np.abs(values - middle), axis=0) + TINY
    return np.asarray(np.all(np.abs(values - middle) <= _FAR * sd, axis=1))


def _spectrum(log: Experiment, residual: Complex, taken: Array) -> Array:
    """Power of the noise at the lines of the measured samples, corrected for what the fit has taken, shape (p, F)."""
    padded = np.concatenate([np.zeros((len(residual), 1)), residual / log.size], axis=1) * np.sqrt(log.length / 2)
    samples = irfft(padded, log.length)[:, log.pad :]
    squares = np.abs(rfft(samples - samples.mean(1, keepdims=True))[:, 1:]) ** 2 / log.measured
    share = log.length / log.measured
    places = share * np.arange(1, 1 + squares.shape[1]) - 1
    left = [1 - share * np.interp(places, np.arange(len(shares)), shares) for shares in taken]
    return np.array([local_power(*channel) for channel in zip(squares, left, strict=True)])


def _noise(log: Experiment, power: Array, lines: Indices, rng: np.random.Generator) -> Complex:
    """Draw noise for the measured samples; its transform at some lines of the log, shape (p, k)."""
    if not log.pad:  # the transform of such noise is independent from line to line
        power = power[:, lines]
    real, imaginary = rng.standard_normal((2, *power.shape))
    noise = np.sqrt(power / 2) * (real + 1j * imaginary)
    if not log.pad:
        return np.asarray(noise * np.sqrt(2) * log.size[lines])
    spectrum = np.concatenate([np.zeros((len(power), 1)), np.sqrt(log.measured) * noise], axis=1)
    samples = irfft(spectrum, log.measured)
    return log.transform(np.concatenate([np.zeros((len(power), log.pad)), samples], axis=1).T)[:, lines]

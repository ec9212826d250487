"""Parametric bootstrap: plants that other noise of the same spectrum would have given (Efron and Tibshirani 1993).

Each structure of the chosen order is drawn as often as it is likely, and refitted to its own response plus noise, which
is drawn for the samples that were measured.
"""

from dataclasses import replace

import numpy as np
from numpy.fft import irfft, rfft

from archerfish2.identification.axis.fit import AxisFit, plant_of
from archerfish2.identification.axis.output_error import leverage, refine, residuals_by_log, solve
from archerfish2.identification.axis.spectrum import Experiment, Indices, local_power, strongest
from archerfish2.identification.simulation import Array, Complex
from archerfish2.records.plant import PlantRecord

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
    rng, chosen, weights = np.random.default_rng(seed), found.structure, found.selection.weights
    same = {s: w for s, w in weights.items() if s.order == chosen.order and w > _LIKELY and s != chosen}
    likely = {chosen: max(weights[chosen], _LIKELY), **dict([*same.items()][: _STRUCTURES - 1])}
    drawn: list[PlantRecord] = []
    for structure, weight in likely.items():
        logs = [replace(e, skip=min(e.skip, structure.delay)) for e in found.experiments]
        data = [e.at(structure.delay, structure.feedthrough) for e in logs]
        fit, soft = found.fit, [c._replace(feedthrough=structure.feedthrough) for c in found.constraints]
        if structure != chosen:
            fit = refine(found.selection.found[structure][1].sections, data + soft, 10, 1e-6, found.ridge)
        every = solve(fit.sections, data + soft)
        residuals = residuals_by_log(every, data + soft)[: len(data)]
        responses = [lines.outputs - each for lines, each in zip(data, residuals, strict=True)]
        spectra = [_spectrum(*each) for each in zip(logs, residuals, leverage(every, data + soft), strict=True)]
        picks = strongest([np.mean(np.abs(each) ** 2, axis=0) for each in responses], _LINES)
        lines = [d._replace(outputs=y).pick(k) for d, y, k in zip(data, responses, picks, strict=True)]
        for _ in range(round(draws * weight / sum(likely.values()))):
            noise = [_noise(e, power, k, rng) for e, power, k in zip(logs, spectra, picks, strict=True)]
            noisy = [each._replace(outputs=each.outputs + e) for each, e in zip(lines, noise, strict=True)]
            again = refine(fit.sections, noisy + soft, _STEPS, 1e-4, found.ridge)
            drawn.append(plant_of(again, structure, found.scale, found.plant.sample_period_s))
    near = _near(np.array([plant.dc_gain.ravel() for plant in drawn]))
    return [drawn[each] for each in rng.permutation(np.flatnonzero(near))]


def interval(values: Array) -> Array:
    """Return the 95 % interval of draws (their first axis) by Weibull's plotting positions, shape (2, …)."""
    return np.asarray(np.quantile(values, [0.025, 0.975], axis=0, method="weibull"))


def _near(values: Array) -> Array:
    """Which rows are within some robust standard deviations of the median."""
    middle = np.median(values, axis=0)
    sd = 1.4826 * np.median(np.abs(values - middle), axis=0) + 1e-300
    return np.asarray(np.all(np.abs(values - middle) <= _FAR * sd, axis=1))


def _spectrum(log: Experiment, residual: Complex, taken: Array) -> Array:
    """Power of the noise at the lines of the measured samples, corrected for what the fit has taken, shape (p, F)."""
    padded = np.concatenate([np.zeros((len(residual), 1)), residual / log.size], axis=1) * np.sqrt(log.length / 2)
    samples = irfft(padded, log.length)[:, log.pad :]
    squares = np.abs(rfft(samples - samples.mean(1, keepdims=True))[:, 1:]) ** 2 / log.measured
    share = log.length / log.measured
    places = share * np.arange(1, 1 + squares.shape[1]) - 1
    left = [1 - share * np.interp(places, np.arange(len(each)), each) for each in taken]
    return np.array([local_power(*each) for each in zip(squares, left, strict=True)])


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

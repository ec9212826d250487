"""Constraints as pseudo-observations: no gain above the band that inputs excite, continuity below it, a known gain.

They are further lines of the least squares, weighted by how much they count, and have no transients.
"""

from collections.abc import Sequence

import numpy as np

from archerfish.identification.axis.output_error import LinearFit
from archerfish.identification.axis.sections import response
from archerfish.identification.axis.spectrum import Lines
from archerfish.identification.simulation import TINY, Array

_BINS, _POINTS = 48, 8  # frequencies up to half the sampling rate, where no gain is wanted; those below the band
_LEAST_NOISE = 1e-32  # power of a line
_EXACT = 1e4  # weight of a steady gain that is known, over the size of the outputs
_WEIGHT = 500.0  # rows of noise that the constraints of an input count as
_RADIUS = float(np.exp(-0.5 * np.pi / _BINS))  # of a circle inside the unit circle: no pole hides between its points


def out_of_band(fit: LinearFit, data: Sequence[Lines], delay: int) -> tuple[list[Lines], float]:
    """Return the constraints that a fit suggests, and the ridge of the unconstrained parameters that goes with them.

    Args:
      fit: of the data.
      data: lines of all logs at the delay.
      delay: of the inputs [samples].
    """
    inputs, outputs = len(data[0].inputs), len(fit.residual)
    noise = max(2 * fit.cost / fit.residual.size, _LEAST_NOISE)
    edges = np.linspace(0, np.pi, _BINS + 1)
    frequencies = np.concatenate([np.abs(np.angle(lines.z)) for lines in data])
    count = np.maximum(np.histogram(frequencies, edges)[0], 1)
    gains = [np.abs(response(fit.sections, fit.numerators, inputs, lines.z)) ** 2 for lines in data]
    constraints: list[Lines] = []
    for channel, one_input in enumerate(np.eye(inputs)[:, :, None]):
        power = np.concatenate([np.abs(lines.inputs[channel]) ** 2 for lines in data])
        gain = np.concatenate([squares.mean(axis=1)[channel] for squares in gains])
        # Signal to noise of the outputs per power of this input, with the mean gain of the excited lines.
        ratio = float((gain * power).sum() / max(power.sum() * noise, TINY))
        if not ratio > 0:
            continue
        excited = ratio * np.histogram(frequencies, edges, weights=power)[0] / count
        weight = 1 / (1 + excited)
        weight[: np.flatnonzero(excited >= min(1, excited.max()))[0] + 1] = 0
        z = _RADIUS * np.exp(-0.5j * (edges[1:] + edges[:-1]))
        size = np.sqrt(_WEIGHT / ratio / _BINS * weight) * _RADIUS**delay
        constraints.append(_constraint(data[0], z, one_input * size, np.zeros((outputs, _BINS))))
        lowest = _lowest(data, [ratio * np.abs(lines.inputs[channel]) ** 2 for lines in data])
        if lowest > 2.5 * min(-np.angle(lines.z[0]) for lines in data):
            below, level = np.linspace(0, lowest, _POINTS, endpoint=False), np.sqrt(_WEIGHT / ratio / _POINTS)
            there = response(fit.sections, fit.numerators, inputs, np.exp([-1j * lowest]))[channel]
            goal = level * (there.real + 1j * there.imag * below / lowest)
            constraints.append(_constraint(data[0], np.exp(-1j * below), level * one_input.repeat(_POINTS, 1), goal))
    return constraints, 1.5 * noise


def steady_gain(gain: Array, data: Sequence[Lines]) -> Lines:
    """Return the constraint that a plant has a steady gain, whatever the logs say of it.

    Args:
      gain: shape (p, m).
      data: lines of all logs.
    """
    outputs = np.sqrt(sum(float(np.sum(np.abs(lines.outputs) ** 2)) for lines in data))
    inputs = np.sqrt(sum(float(np.sum(np.abs(lines.inputs) ** 2)) for lines in data))
    weight = _EXACT * outputs / max(np.abs(gain).max(), outputs / max(inputs, TINY))
    return _constraint(data[0], np.ones(gain.shape[1]), weight * np.eye(gain.shape[1]), weight * gain)


def _constraint(like: Lines, z: Array, inputs: Array, outputs: Array) -> Lines:
    """Return lines without transients, with the feedthrough of others."""
    at, u, y = (values.astype(complex) for values in (z, inputs, outputs))
    return Lines(at, u, y, at[:0], y[:0], like.feedthrough)


def _lowest(data: Sequence[Lines], excited: Sequence[Array]) -> float:
    """Return the lowest frequency that is excited well, by the mean of five lines [rad/sample]."""
    smooth = [np.convolve(np.pad(values, 2, mode="edge"), np.full(5, 0.2), "valid") for values in excited]
    least = min(30.0, 0.1 * max(values.max() for values in smooth))
    found = [np.abs(np.angle(lines.z))[values >= least] for lines, values in zip(data, smooth, strict=True)]
    return float(min(values.min() for values in found if values.size))

"""Soft constraints where the inputs excite nothing, as lines more: no gain above their band, continuity below it."""

from collections.abc import Sequence

import numpy as np

from archerfish2.identification.axis.output_error import LinearFit
from archerfish2.identification.axis.sections import response
from archerfish2.identification.axis.spectrum import Lines
from archerfish2.identification.simulation import Array

_BINS, _POINTS = 48, 8  # of the frequencies up to half the sampling rate; of those below the band
_LEAST_NOISE = 1e-32  # power of a line
_FIRM = 1e4  # weight of a steady gain that is given, over the size of the outputs
_WEIGHT = 500.0  # rows of noise that the constraints of an input count as


def out_of_band(fit: LinearFit, data: Sequence[Lines], delay: int) -> tuple[list[Lines], float]:
    """Return the constraints that a fit suggests, and the ridge of the free numbers that goes with them.

    Args:
      fit: of the data.
      data: lines of all logs at the delay.
      delay: of the inputs [samples].
    """
    inputs, outputs = len(data[0].inputs), len(fit.residual)
    noise, edges = max(2 * fit.cost / fit.residual.size, _LEAST_NOISE), np.linspace(0, np.pi, _BINS + 1)
    w = np.concatenate([np.abs(np.angle(lines.z)) for lines in data])
    count, constraints = np.maximum(np.histogram(w, edges)[0], 1), []
    gains = [np.mean(np.abs(response(fit.sections, fit.numerators, inputs, e.z)) ** 2, axis=1) for e in data]
    for j, unit in enumerate(np.eye(inputs)[:, :, None]):
        power = np.concatenate([np.abs(lines.inputs[j]) ** 2 for lines in data])
        gain = np.concatenate([each[j] for each in gains])
        # Signal to noise of the outputs per power of this input, with the mean gain of the excited lines.
        ratio = float((gain * power).sum() / max(power.sum() * noise, 1e-300))
        if not ratio > 0:
            continue
        excited = ratio * np.histogram(w, edges, weights=power)[0] / count
        firm = 1 / (1 + excited)
        firm[: np.flatnonzero(excited >= min(1, excited.max()))[0] + 1] = 0
        blur = np.exp(-0.5 * np.pi / _BINS)  # a circle inside the unit circle, so that no pole hides between two bins
        z = blur * np.exp(-0.5j * (edges[1:] + edges[:-1]))
        size = np.sqrt(_WEIGHT / ratio / _BINS * firm) * blur**delay
        constraints.append(_soft(data[0], z, unit * size, np.zeros((outputs, _BINS))))
        lowest = _lowest(data, [ratio * np.abs(lines.inputs[j]) ** 2 for lines in data])
        if lowest > 2.5 * min(-np.angle(lines.z[0]) for lines in data):
            below, level = np.linspace(0, lowest, _POINTS, endpoint=False), np.sqrt(_WEIGHT / ratio / _POINTS)
            there = response(fit.sections, fit.numerators, inputs, np.exp([-1j * lowest]))[j]
            goal = level * (there.real + 1j * there.imag * below / lowest)
            constraints.append(_soft(data[0], np.exp(-1j * below), level * unit.repeat(_POINTS, 1), goal))
    return constraints, 1.5 * noise


def steady_gain(gain: Array, data: Sequence[Lines]) -> Lines:
    """Return the constraint that a plant has a steady gain, however firmly the logs contradict it.

    Args:
      gain: shape (p, m).
      data: lines of all logs.
    """
    size = np.sqrt(sum(float(np.sum(np.abs(lines.outputs) ** 2)) for lines in data))
    driven = np.sqrt(sum(float(np.sum(np.abs(lines.inputs) ** 2)) for lines in data))
    firm = _FIRM * size / max(np.abs(gain).max(), size / max(driven, 1e-300))
    unit = firm * np.eye(gain.shape[1])
    return _soft(data[0], np.ones(gain.shape[1]), unit, firm * gain)


def _soft(like: Lines, z: Array, inputs: Array, outputs: Array) -> Lines:
    at, u, y = (each.astype(complex) for each in (z, inputs, outputs))
    return Lines(at, u, y, at[:0], y[:0], like.feedthrough)


def _lowest(data: Sequence[Lines], excited: Sequence[Array]) -> float:
    """Lowest frequency that is excited well, by the mean of five lines [rad/sample]."""
    excited = [np.convolve(np.pad(each, 2, mode="edge"), np.full(5, 0.2), "valid") for each in excited]
    least = min(30.0, 0.1 * max(each.max() for each in excited))
    found = [np.abs(np.angle(e.z))[x >= least] for e, x in zip(data, excited, strict=True)]
    return float(min(each.min() for each in found if each.size))

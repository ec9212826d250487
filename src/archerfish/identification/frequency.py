"""Frequency responses of a plant and as measured, and the band in which logs determine it."""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from archerfish.identification.simulation import TINY, Array, Complex, matrices
from archerfish.logs.recording import Recording, Values
from archerfish.records.plant import PlantRecord

_SEGMENT = 16, 1024  # samples of Welch's segments, at least and at most
_SHARE = 1e-2  # of the largest density of an input, from which a frequency counts as excited
_FALSE_ALARM, _TAPERS = 0.01, 5


class MeasuredResponse(NamedTuple):
    """Frequency response estimated from logs; F is 0 where they are too short to average."""

    hz: Array  # frequencies that an input excites [Hz], (F,)
    response: Complex  # output per input, zero where that input excites nothing, (F, p, m)
    coherence: Array  # partial, squared: share of the power that an input alone explains, 0…1, (F, p, m)
    significant: float  # coherence that noise exceeds at some frequency in 1 % of logs


def frequency_response(plant: PlantRecord, hz: Array, *, draws: bool = False) -> Complex:
    """Return (C (zI − A)⁻¹ B + D) z^−delay at z = e^{2πi f T}, shape (F, p, m), or (k, F, p, m) of the draws.

    Args:
      plant: the plant.
      hz: frequencies [Hz], shape (F,).
      draws: whether to return those of the k draws instead.
    """
    A, B, C, D, delays = (matrix[:, None] for matrix in matrices(plant, draws=draws))
    z = np.exp(2j * np.pi * hz * plant.sample_period_s)[:, None, None]
    found = (C @ np.linalg.solve(z * np.eye(len(plant.A)) - A, B.astype(complex)) + D) * z ** -delays[..., None, None]
    return np.asarray(found if draws else found[0])


def measured_response(recordings: Sequence[Recording]) -> MeasuredResponse:
    """Estimate the response by H1, the inverse of the inputs' spectra times their cross spectra, averaged as Welch did.

    It is right where inputs are measured without noise and are not made from the output.

    Args:
      recordings: of the same p outputs and m inputs; those of less than two segments are left out.
    """
    inputs = recordings[0].inputs.shape[1]
    signals = [np.hstack([log.inputs, log.outputs]) for log in recordings]
    segment = int(np.clip(2 ** int(np.log2(max(map(len, recordings)) / 4 + 1)), *_SEGMENT))
    hz, none = np.fft.rfftfreq(segment, recordings[0].period_s), np.zeros((0, signals[0].shape[1], segment))
    # Each segment overlaps the next by half.
    segments = [sliding_window_view(x, segment, 0)[:: segment // 2] for x in signals if len(x) >= 2 * segment]
    joined = np.concatenate([none, *segments])
    lines = np.fft.rfft((joined - joined.mean(2, keepdims=True)) * np.hanning(segment + 1)[:-1]).T
    spectra = lines.conj() @ lines.swapaxes(1, 2)
    power = np.diagonal(spectra, axis1=1, axis2=2).real
    # A segment's mean is taken off, so that its lowest lines are empty.
    excited = (power[:, :inputs] > _SHARE * power[:, :inputs].max(0)) & (hz > 1.5 * hz[1])[:, None]
    size = np.sqrt(power[:, :inputs].max(0)) + 1e-150
    among = np.linalg.inv(spectra[:, :inputs, :inputs] / np.outer(size, size) + 1e-9 * np.eye(inputs))
    cross = spectra[:, :inputs, inputs:] / size[:, None]
    found = among @ cross
    rest = np.maximum(power[:, inputs:] - np.sum(found.conj() * cross, 1).real, 0)[:, None]
    own = np.abs(found) ** 2 / np.diagonal(among, axis1=1, axis2=2).real[..., None]
    both = found / size[:, None], own / np.maximum(own + rest, TINY)
    response, coherence = (np.where(excited[..., None], x, 0)[excited.any(1)].swapaxes(1, 2) for x in both)
    significant = 1 - (_FALSE_ALARM / max(response.size, 1)) ** (1 / max(len(joined) - inputs, 1))
    return MeasuredResponse(hz[excited.any(1)], response, coherence, significant)


def excited_band(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Return the lowest and highest frequency [Hz] where inputs have power and, under moving inputs, outputs respond.

    An input has power where its density is a hundredth of its largest, without what the ends of a log leak. Of a log
    whose inputs are mostly held, few of Welch's segments have a response; there the power alone counts.
    """
    found = [np.zeros(0)]
    for log, channel in product(recordings, range(recordings[0].inputs.shape[1])):
        u = log.inputs[:, channel]
        if np.ptp(u) == 0:
            continue
        held = bool(np.mean(np.diff(u) != 0) < 0.5)
        density = _density(u, held)
        hz = (1 + np.flatnonzero(density >= _SHARE * density.max())) / (len(log) * log.period_s)
        at, _, coherence, significant = measured_response([log])
        inside = (at >= hz[0]) & (at <= hz[-1])
        at, coherent = at[inside], coherence[inside, :, channel].max(1, initial=0.0) > significant
        if coherent.any() and not held:
            hz = hz.clip(0 if coherent[0] else at[coherent][0], None if coherent[-1] else at[coherent][-1])
        found.append(hz)
    every = np.concatenate(found)
    return float(np.min(every, initial=np.inf)), float(np.max(every, initial=0))


def _density(u: Values, held: bool) -> Array:
    """Return the power without the mean at each line, by sine tapers, which leak little (Riedel and Sidorenko 1995).

    The content of a signal that is mostly held are its jumps, and a taper would lose those near an end.
    """
    phase = np.pi * np.arange(1, len(u) + 1) / (len(u) + 1)
    tapers = np.ones((1, len(u))) if held else np.sqrt(2) * np.sin(np.arange(1, _TAPERS + 1)[:, None] * phase)
    density = np.mean(np.abs(np.fft.rfft(tapers * (u - u.mean()))) ** 2, axis=0)[1:]
    if not held:  # the tapers widen the gap of the mean, which gets the density beside it
        density[:4] = density[:4][-1]
    return np.asarray(density)

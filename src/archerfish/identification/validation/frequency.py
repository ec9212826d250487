"""Frequency responses for the Bode plot: of a plant, and measured from recordings; and the band that inputs excite."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SEGMENT = 1024
_EXCITED_SHARE = 1e-2
_FAINT = 1e-5
_TAPERS = 5


class MeasuredResponse(NamedTuple):
    """Frequency response estimated from recordings."""

    frequency_hz: Array
    """Frequencies [Hz], shape (F,)."""
    response: ComplexArray
    """Output per input, shape (F,)."""
    coherence: Array
    """Squared coherence, 0…1: the share of the output's power that the input explains linearly, shape (F,)."""


def plant_response(plant: PlantRecord, frequency_hz: Array) -> ComplexArray:
    """Return (C (zI − A)⁻¹ B + D) z^−delay at z = exp(i 2π f Ts), shape (F, p, m).

    Args:
      plant: the plant.
      frequency_hz: frequencies [Hz], shape (F,).
    """
    z = np.exp(2j * np.pi * frequency_hz * plant.sample_period_s)[:, None, None]
    resolvent = np.linalg.solve(z * np.eye(len(plant.A)) - plant.A, plant.B.astype(np.complex128))
    return np.asarray((plant.C @ resolvent + plant.D) * z**-plant.delay_samples)


def measured_response(recordings: Sequence[Recording], channel: int = 0) -> MeasuredResponse | None:
    """Estimate output per input by the H1 estimator: Welch's averages of cross power over input power.

    Right where the inputs are measured without noise and are not made from the output (no feedback).

    Args:
      recordings: recordings of one plant with one output; each should hold two segments of 1024 samples, shorter
        ones get shorter segments.
      channel: which input; others must be uncorrelated with it.

    Returns:
      The response at the frequencies that the input excites, or None if the recordings are too short to average.
    """
    segment = min(_SEGMENT, 2 ** int(np.log2(max(len(each) for each in recordings) / 4)))
    usable = [each for each in recordings if len(each) >= 2 * segment]
    if segment < 16 or not usable:
        return None
    power = cross = output_power = np.zeros(segment // 2 + 1)
    for each in usable:
        # All terms of a line have one factor, which no ratio of them shows; that of the sampling rate too.
        inputs, outputs = (
            _windowed_spectra(signal, segment) for signal in (each.inputs[:, channel], each.outputs[:, 0])
        )
        power = power + len(each) * np.mean(np.abs(inputs) ** 2, axis=0)
        output_power = output_power + len(each) * np.mean(np.abs(outputs) ** 2, axis=0)
        cross = cross + len(each) * np.mean(np.conj(inputs) * outputs, axis=0)
    frequency = np.fft.rfftfreq(segment, usable[-1].sample_period_s)
    # The mean is taken off each segment, so that the lowest lines hold nothing.
    excited = (power > _EXCITED_SHARE * power.max()) & (frequency > 1.5 * frequency[1])
    coherence = np.abs(cross[excited]) ** 2 / (power[excited] * output_power[excited])
    return MeasuredResponse(frequency[excited], cross[excited] / power[excited], coherence)


def _windowed_spectra(signal: Array, length: int) -> ComplexArray:
    """Return the spectra of half overlapping pieces, means taken off, under Hann's window, shape (pieces, lines).

    Squares of their sizes are one-sided densities, up to a factor: all lines but the first and the last stand for their
    mirror images too.
    """
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    pieces = sliding_window_view(signal, length)[:: length // 2]
    spectra = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)
    spectra[:, [0, -1]] *= np.sqrt(0.5)
    return np.asarray(spectra)


def natural_frequency_hz(pole: complex, sample_period_s: float) -> float:
    """Return |ln z| / 2π Ts, the natural frequency [Hz] of a pole of the z plane; infinite for a pole at 0, a delay."""
    return float(abs(np.log(complex(pole))) / (2 * np.pi * sample_period_s)) if pole != 0 else float("inf")


def _energy_density(recording: Recording, channel: int) -> tuple[Array, Array]:
    signal = recording.inputs[:, channel]
    density = np.abs(np.fft.rfft(signal - signal.mean()) * recording.sample_period_s) ** 2
    frequency: Array = np.fft.rfftfreq(len(signal), recording.sample_period_s).astype(np.float64)
    return frequency, np.asarray(density)


def driven_band_hz(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Return the lowest and highest frequency [Hz] at which some input was meant to have energy.

    That is where its energy density is a hundredth of the largest, without what the abrupt ends of a signal leak: a
    sweep from 2 Hz has a few percent of its energy density at 0.1 Hz, from which a plant of the right structure
    extrapolates, and which shows nothing of what is really there. Each log is held against its own largest density,
    unless it is faint beside another: a small step was made on purpose too.
    """
    lowest, highest = np.inf, 0.0
    for channel in range(recordings[0].inputs.shape[1]):
        spectra = [_intended_density(recording, channel) for recording in recordings]
        faint = _FAINT * max(density.max() for _, density in spectra)
        for frequency, density in spectra:
            if density.max() >= faint:
                lines = frequency[density >= _EXCITED_SHARE * density.max()]
                lowest, highest = min(lowest, lines.min()), max(highest, lines.max())
    return float(lowest), float(highest)


def _intended_density(recording: Recording, channel: int) -> tuple[Array, Array]:
    """Return the energy density as Riedel and Sidorenko's sine tapers see it: they leak little, and see the ends too.

    Of a signal that rests most of the time the jumps are the content; a taper would lose one near an end.
    """
    signal = recording.inputs[:, channel]
    if np.mean(np.diff(signal) != 0) < 0.5:
        frequency, density = _energy_density(recording, channel)
        return frequency[1:], density[1:]
    phase = np.pi * np.arange(1, signal.size + 1) / (signal.size + 1)
    tapers = np.sqrt(2) * np.sin(np.arange(1, _TAPERS + 1)[:, None] * phase)
    spectra = np.fft.rfft(tapers * (signal - signal.mean()), axis=1) * recording.sample_period_s
    density = np.mean(np.abs(spectra) ** 2, axis=0)
    # Lines nearer to zero than the tapers resolve hold the mean that was taken off: they get their neighbour's density.
    resolved = min(_TAPERS // 2 + 1, density.size - 1)
    density[:resolved] = density[resolved]
    frequency = np.fft.rfftfreq(signal.size, recording.sample_period_s).astype(np.float64)
    return frequency[1:], np.asarray(density[1:])

"""The log doctor on single signals: what they look like tells what went wrong when they were logged."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from archerfish.records.findings import Finding
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_SATURATED_SHARE = 0.05
_QUANTISATION_SHARE = 0.02
_FROZEN_SHARE = 0.1
_SPIKE = 30.0
_SINE_REST = 0.02
_MANY_VALUES = 20  # a signal of fewer is a sequence of steps

_TURNS = (2 * np.pi, 360.0)


def unwrapped(signal: Array) -> tuple[Array, int]:
    """Undo the jumps of an angle that was logged within one turn.

    Certain only where the signal moves smoothly, stays within a turn, and jumps by a whole one.

    Args:
      signal: values, shape (N,).

    Returns:
      The signal without jumps, shape (N,), and how many there were.
    """
    steps = np.diff(signal)
    moving = np.mean(steps != 0) if steps.size else 0.0
    for turn in _TURNS:
        jump = np.abs(steps) > 0.75 * turn
        smooth = np.abs(steps[~jump]).max(initial=0.0)
        if not jump.any() or np.ptp(signal) > 1.02 * turn or moving < 0.2 or smooth > 0.25 * turn:
            continue
        if np.all(np.abs(np.abs(steps[jump]) - turn) <= max(2 * smooth, 0.02 * turn)):
            return np.asarray(np.unwrap(signal, period=turn)), int(jump.sum())
    return signal, 0


def signal_findings(recording: Recording) -> list[Finding]:
    """Return what the signals of a recording show by themselves; all are warnings."""
    found = [*saturation(recording)]
    for name, signal in zip(recording.input_names, recording.inputs.T, strict=True):
        found += [*_above_nyquist(recording, name, signal)]
    for name, signal in zip(recording.output_names, recording.outputs.T, strict=True):
        found += [*_quantisation(recording, name, signal), *_spikes(recording, name, signal)]
        found += [*_frozen(recording, name, signal), *_drift(recording, name, signal)]
    return found


def saturation(recording: Recording) -> list[Finding]:
    """Return a warning for signals of many different values that often sit at their extreme; a step has few values."""
    found = []
    for name, signal in zip(
        (*recording.input_names, *recording.output_names), [*recording.inputs.T, *recording.outputs.T], strict=True
    ):
        share = max(_share_at(signal, signal.max()), _share_at(signal, signal.min()))
        if share > _SATURATED_SHARE and np.unique(signal).size > _MANY_VALUES:
            message = f'"{name}" sits at its extreme for {share:.0%} of the samples'
            remedy = "if it was cut off there, a linear plant can't follow: record with a smaller command"
            found.append(_warning("saturation", recording, message, remedy))
    return found


def _share_at(signal: Array, value: float) -> float:
    """Return the share of samples at a value, the rest before and after the motion left out; 0 for steps."""
    other = np.flatnonzero(signal != value)
    if not other.size:
        return 1.0
    motion = signal[other[0] : other[-1] + 1]
    elsewhere = np.diff(motion[motion != value])
    is_steps = elsewhere.size == 0 or np.mean(elsewhere == 0) > 0.5
    return 0.0 if is_steps else float(np.mean(motion == value))


def single_sine_hz(signal: Array, sample_period_s: float) -> float | None:
    """Return the frequency [Hz] of a signal that is one sine and nothing else, shape (N,); None if it is more."""
    centred = signal - signal.mean()
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(len(centred))))
    peak = int(spectrum.argmax())
    if not 0 < peak < len(spectrum) - 1:
        return None
    # A parabola through the logarithms of a Hann window's main lobe places its peak to a hundredth of a line.
    left, top, right = np.log(np.maximum(spectrum[peak - 1 : peak + 2], 1e-300))
    line = peak + 0.5 * (left - right) / (left - 2 * top + right)
    least, best = np.inf, 0.0
    for frequency in np.linspace(line - 0.05, line + 0.05, 11) / len(centred):
        phase = 2 * np.pi * frequency * np.arange(len(centred))
        basis = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
        rest = centred - basis @ np.linalg.lstsq(basis, centred, rcond=None)[0]
        least, best = min((least, best), (float(rest @ rest), float(frequency)))
    return best / sample_period_s if least < _SINE_REST * (centred @ centred) else None


def _above_nyquist(recording: Recording, name: str, signal: Array) -> list[Finding]:
    """Warn of a sweep whose line climbs to half the sampling rate, where it folds back."""
    width = 64
    if len(signal) < 8 * width:
        return []
    centred = np.pad(signal - signal.mean(), (width // 2, width))
    pieces = sliding_window_view(centred, width)[: len(signal) + width // 2 - 1 : width // 2]
    power = np.abs(np.fft.rfft(pieces * np.hanning(width), axis=1).T) ** 2
    power = power[:, power.sum(axis=0) > 1e-3 * power.sum(axis=0).max()]
    peak = power.argmax(axis=0)
    near = np.abs(np.arange(len(power))[:, None] - peak) <= 3
    is_line = (power * near).sum(axis=0) > 0.9 * power.sum(axis=0)
    travelled = np.abs(np.diff(peak))
    if is_line.mean() < 0.8 or np.median(travelled) > 3 or peak.max() < 0.94 * (len(power) - 1) or np.ptp(peak) < 8:
        return []
    nyquist = 0.5 / recording.sample_period_s
    message = f'the sweep in "{name}" reaches half the sampling rate ({nyquist:.4g} Hz) and folds back'
    return [_warning("sweep-above-nyquist", recording, message, "sample faster, or end the sweep below it")]


def _quantisation(recording: Recording, name: str, signal: Array) -> list[Finding]:
    values = np.unique(signal)
    if values.size < 2 or values.size > len(signal) / 4 or not signal.std():
        return []
    steps = np.diff(values)
    quantum = steps[steps > 1e-9 * np.ptp(signal)].min()
    noise = quantum / np.sqrt(12) / signal.std()
    if noise < _QUANTISATION_SHARE:
        return []
    message = f'"{name}" moves in steps of {quantum:.4g}, which is a noise of {noise:.1%} of its standard deviation'
    return [_warning("quantisation", recording, message, "log more digits, or record larger motions")]


def _spikes(recording: Recording, name: str, signal: Array) -> list[Finding]:
    """Warn of single samples that leap out and back: a lost bit, not a motion."""
    steps = np.diff(signal)
    typical = np.quantile(np.abs(steps), 0.9)
    if not typical:
        return []
    out, back = steps[:-1], steps[1:]
    leaps = (np.minimum(np.abs(out), np.abs(back)) > _SPIKE * typical) & (np.abs(out + back) < 0.2 * np.abs(out - back))
    if not leaps.any():
        return []
    at = recording.time[int(np.argmax(leaps)) + 1]
    message = f'"{name}" leaps out and back within a sample {int(leaps.sum())} times, first at {at:.4g} s'
    return [_warning("spike", recording, message, "remove those lines, the log is then cut there")]


def _frozen(recording: Recording, name: str, signal: Array) -> list[Finding]:
    """Warn of an output that stands still to the last digit while an input moves."""
    if np.unique(signal).size <= _MANY_VALUES:
        return []
    changes = np.flatnonzero(np.diff(signal) != 0)
    ends = np.concatenate([[-1], changes, [len(signal) - 1]])
    longest = int(np.argmax(np.diff(ends)))
    start, stop = int(ends[longest]) + 1, int(ends[longest + 1]) + 1
    if stop - start < max(20, _FROZEN_SHARE * len(signal)) or not _moves_meanwhile(recording.inputs, start, stop):
        return []
    message = (
        f'"{name}" stands still from {recording.time[start]:.4g} s for {stop - start} samples while the input moves'
    )
    return [_warning("frozen", recording, message, "check the sensor's link; cut that part out")]


def _moves_meanwhile(inputs: Array, start: int, stop: int) -> bool:
    """Return whether an input moves, beyond noise, in the middle half of a stretch, inputs of shape (N, m).

    An output may rest while an input is held at a level, and for its delay after the step that ends the rest.
    """
    margin = (stop - start) // 4
    middle = inputs[start + margin : stop - margin]
    return bool(np.any(np.ptp(middle, axis=0) > 0.1 * np.ptp(inputs, axis=0)))


def _drift(recording: Recording, name: str, signal: Array) -> list[Finding]:
    inputs = max(_trend_share(each) for each in recording.inputs.T)
    share = _trend_share(signal)
    if share < 0.5 or inputs > 0.1:
        return []
    message = f'a straight line is {share:.0%} of the variance of "{name}", and the input has none'
    return [
        _warning("drift", recording, message, "a stable plant can't follow: log the joint's angle, not the world's")
    ]


def _trend_share(signal: Array) -> float:
    time = np.linspace(-1, 1, len(signal))
    centred = signal - signal.mean()
    power = float(centred @ centred)
    return float((time @ centred) ** 2 / (time @ time) / power) if power else 0.0


def _warning(code: str, recording: Recording, message: str, remedy: str) -> Finding:
    return Finding(code, "warning", recording.source, message, remedy)

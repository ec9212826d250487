"""Recordings as spectra: the same least squares as in the time domain, line by line.

Over a whole recording the states of x[t+1] = A x[t] + B u[t] have, at the lines z = exp(2πi k/N), the transform

    X = (z I − A)⁻¹ (B U + z (x[0] − x[N])),

without approximation. The difference of the end states takes the place of the initial state, as free as that (unless
the recording begins at rest, see `rest_start`), and a constant in the output shows at k = 0 alone. So, line 0 left out,
the sum of squared simulation errors over the lines is that over the samples with initial state and offset fitted
(Parseval), and what is unlike in noise or excitation between frequencies can be told apart.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from archerfish.identification.axis.rest_start import RestStart
from archerfish.records.recording import Recording

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_USUAL = 2.0
"""What the inputs move at the beginning over their mean, up to which it is as good a part of the recording as any."""


class Spectrum(NamedTuple):
    """One experiment; the squared real and imaginary parts of a signal sum to that of its samples less their mean."""

    lag: ComplexArray
    """z⁻¹ of each line, shape (F,)."""
    inputs: ComplexArray
    """Delayed inputs, shape (F, m)."""
    outputs: ComplexArray
    """Outputs, shape (F, p)."""
    impulse: Array
    """An impulse at the first sample, up to a factor that all lines share, shape (F,)."""
    rest: RestStart | None = None
    """What the inputs did from rest on; None where the initial state is free."""
    drift: ComplexArray | None = None
    """Slow motions of the outputs that no input makes, each with a free size, shape (F, q)."""


def delayed(inputs: Array, delay: int) -> Array:
    """Shift inputs, shape (N, m), by `delay` samples; before a recording its first input is taken to have been held."""
    return inputs if delay == 0 else np.vstack([np.repeat(inputs[:1], delay, axis=0), inputs[:-delay]])


def unsettled(inputs: Array, longest: int) -> int:
    """Return how many samples at the beginning of a recording answer to inputs from before it.

    None where the inputs move more there than later on: a step soon after the beginning is what such a recording is
    about, and the inputs before it can only be taken to have been held.

    Args:
      inputs: shape (N, m).
      longest: longest delay that is tried [samples].
    """
    moves = np.diff(inputs, axis=0) ** 2
    share = moves[:longest].sum(axis=0) / np.maximum(moves.sum(axis=0), np.finfo(float).tiny)
    return longest if share.max() <= _USUAL * longest / len(moves) else 0


def spectrum(
    recording: Recording, delay: int, scale: Array | float = 1.0, skip: int = 0, *, from_rest: bool = False
) -> Spectrum:
    """Transform a recording.

    Args:
      recording: m inputs, p outputs.
      delay: by which the inputs are delayed first [samples].
      scale: outputs are divided by it, shape (p,).
      skip: samples that are left out at the beginning [samples]; delayed inputs reach back into them.
      from_rest: whether the recording begins at rest; then nothing is left out.
    """
    count = len(recording) - skip
    lines = np.arange(1, count // 2 + 1)
    # A line stands for itself and its mirror image; half the sampling rate has none.
    impulse = np.where(2 * lines == count, np.sqrt(0.5), 1.0)
    inputs, outputs = (
        _transformed(signal[skip:], impulse) for signal in (delayed(recording.inputs, delay), recording.outputs / scale)
    )
    whole = Spectrum(np.exp(-2j * np.pi * lines / count), inputs, outputs, impulse)
    return whole._replace(rest=_rest(recording, delay)) if from_rest else whole


def _rest(recording: Recording, delay: int) -> RestStart:
    moved = recording.inputs[: len(recording) - delay] - recording.inputs[0]
    return RestStart(moved, float(np.sqrt(2 / len(recording))))


def slow_drift(experiment: Spectrum, degree: int) -> ComplexArray:
    """Return the transforms of the powers of time up to a degree, each of unit size, shape (F, degree).

    Args:
      experiment: all lines of a recording.
      degree: highest power.
    """
    count = 2 * experiment.lag.size + bool(experiment.impulse[-1] == 1.0)
    time = np.linspace(-1, 1, count)
    columns = _transformed(time[:, None] ** np.arange(1, degree + 1), experiment.impulse)
    return np.asarray(columns / np.linalg.norm(columns, axis=0))


def with_delay(undelayed: Spectrum, recording: Recording, delay: int, skip: int = 0) -> Spectrum:
    """Return a spectrum with its inputs delayed, from that of delay 0 and without transforming anew.

    One sample later a spectrum is turned by z⁻¹, a sample has entered at the beginning and one has left at the end.

    Args:
      undelayed: all lines of the recording, or some.
      recording: what it was made of.
      delay: by which the inputs are delayed [samples].
      skip: samples that were left out at the beginning [samples].
    """
    inputs, samples = undelayed.inputs, recording.inputs
    unit = np.sqrt(2 / (len(samples) - skip)) * undelayed.impulse[:, None]
    for later in range(1, delay + 1):
        change = samples[max(skip - later, 0)] - samples[len(samples) - later]
        inputs = inputs * undelayed.lag[:, None] + unit * change
    rest = undelayed.rest
    if rest is not None:
        rest = rest._replace(inputs=rest.inputs[: len(samples) - delay])
    return undelayed._replace(inputs=inputs, rest=rest)


def _transformed(signal: Array, impulse: Array) -> ComplexArray:
    return np.asarray(np.sqrt(2 / len(signal)) * impulse[:, None] * np.asarray(rfft(signal, axis=0))[1:])


def line_frequency_hz(experiment: Spectrum, sample_period_s: float) -> Array:
    """Return the frequency of each line [Hz], shape (F,)."""
    return np.asarray(-np.angle(experiment.lag) / (2 * np.pi * sample_period_s)) % (1 / sample_period_s)


def real_rows(signal: ComplexArray) -> Array:
    """Stack real parts over imaginary parts: shape (F, …) → (2 F, …)."""
    return np.concatenate([signal.real, signal.imag])


def row_count(experiments: Sequence[Spectrum]) -> int:
    """Return the number of real rows of all experiments, the count of independent residuals of one output."""
    return 2 * sum(each.lag.size for each in experiments)


def picked(experiment: Spectrum, lines: NDArray[Any]) -> Spectrum:
    """Return an experiment with some of its lines alone.

    Args:
      experiment: F lines.
      lines: indices, shape (G,), or a mask, shape (F,).
    """
    drift = None if experiment.drift is None else experiment.drift[lines]
    return experiment._replace(
        lag=experiment.lag[lines],
        inputs=experiment.inputs[lines],
        outputs=experiment.outputs[lines],
        impulse=experiment.impulse[lines],
        drift=drift,
    )

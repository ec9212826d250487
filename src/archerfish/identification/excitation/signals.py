"""Input signals for identification logs: the paper's 2–50 Hz sweep and its step, multisine, PRBS and staircase."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import max_len_seq

from archerfish.records.errors import InputError

Array = NDArray[np.float64]


def linear_sweep(
    duration_s: float, sample_period_s: float, *, low_hz: float = 2.0, high_hz: float = 50.0, amplitude: float = 1.0
) -> Array:
    """Sine whose frequency rises linearly with time.

        u(t) = amplitude · sin 2π (low t + (high − low) t² / (2 duration))

    Args:
      duration_s: length of the signal [s].
      sample_period_s: sampling period [s].
      low_hz: frequency at the start [Hz].
      high_hz: frequency at the end [Hz].
      amplitude: peak value, in units of the input.

    Returns:
      Signal, shape (N,).

    Raises:
      InputError: if a frequency is negative or not below half the sampling rate, or the duration is not a sample long.
    """
    time = _times(duration_s, sample_period_s)
    nyquist = 0.5 / sample_period_s
    for name, frequency in (("low_hz", low_hz), ("high_hz", high_hz)):
        if not 0 <= frequency < nyquist:
            raise InputError(
                f"{name} must be from 0 to below {nyquist:g} Hz (half the sampling rate), got {frequency:g}"
            )
    return amplitude * np.sin(2 * np.pi * (low_hz * time + (high_hz - low_hz) * time**2 / (2 * duration_s)))


def step(duration_s: float, sample_period_s: float, *, start_s: float = 0.05, amplitude: float = 1.0) -> Array:
    """Zero, and from `start_s` on `amplitude`.

    Args:
      duration_s: length of the signal [s].
      sample_period_s: sampling period [s].
      start_s: time of the step [s].
      amplitude: value after the step, in units of the input.

    Returns:
      Signal, shape (N,).

    Raises:
      InputError: if the step lies outside the signal.
    """
    time = _times(duration_s, sample_period_s)
    if not 0 <= start_s < duration_s:
        raise InputError(f"start_s must be from 0 to below {duration_s:g} s (the duration), got {start_s:g}")
    # Half a period of slack: the time of a sample is rounded.
    return np.where(time >= start_s - 0.5 * sample_period_s, amplitude, 0.0)


def staircase(levels: Sequence[float], hold_s: float, sample_period_s: float) -> Array:
    """Hold each level in turn: the least that settles a steady gain, and both ways of it.

    Args:
      levels: values in units of the input.
      hold_s: how long each is held [s].
      sample_period_s: sampling period [s].

    Returns:
      Signal, shape (levels × hold,).

    Raises:
      InputError: if a level is held for less than a sample.
    """
    return np.repeat(np.asarray(levels, dtype=np.float64), len(_times(hold_s, sample_period_s)))


def multisine_lines(period_s: float, low_hz: float, high_hz: float) -> Array:
    """Return the multiples of 1/period within a band [Hz], shape (L,): the lines that a multisine of that period has.

    Raises:
      InputError: if no multiple lies in the band.
    """
    numbers = np.arange(max(1, np.ceil(low_hz * period_s - 1e-9)), np.floor(high_hz * period_s + 1e-9) + 1)
    if numbers.size == 0:
        raise InputError(
            f"a multisine with a period of {period_s:g} s has no line from {low_hz:g} to {high_hz:g} Hz; "
            "lengthen the period or widen the band"
        )
    return np.asarray(numbers / period_s)


def multisine(frequency_hz: Array, amplitude: Array, phase: Array, period_s: float, sample_period_s: float) -> Array:
    """Return one period of a sum of sines.

        u(t) = Σ amplitude cos(2π frequency t + phase)

    Args:
      frequency_hz: multiples of 1/period below half the sampling rate [Hz], shape (L,).
      amplitude: in units of the input, shape (L,).
      phase: [rad], shape (L,).
      period_s: a whole number of sampling periods [s].
      sample_period_s: sampling period [s].

    Returns:
      Signal, shape (N,).

    Raises:
      InputError: if the period is no whole number of samples, or a frequency is not below half the sampling rate.
    """
    count = _whole("the multisine's period", period_s, sample_period_s)
    numbers = np.rint(frequency_hz * period_s).astype(int)
    if numbers[-1] >= count / 2:
        raise InputError(
            f"the highest line, {frequency_hz[-1]:g} Hz, must be below {0.5 / sample_period_s:g} Hz (half the sampling "
            "rate); lower it"
        )
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    spectrum[numbers] = 0.5 * count * amplitude * np.exp(1j * phase)
    return np.asarray(np.fft.irfft(spectrum, count))


def low_crest_phases(amplitude: Array, first_line: int, seed: int, *, rounds: int = 200) -> Array:
    """Find phases that give a multisine a low peak, by clipping it again and again (Van der Ouderaa et al. 1988).

    Each round clips the sum at a share of its peak and keeps only the phases of what results. Schroeder's phases, which
    suit a flat spectrum, and one random start are tried; the lower peak wins.

    Args:
      amplitude: amplitudes of adjacent lines, shape (L,).
      first_line: number of the first line.
      seed: of the random start.
      rounds: rounds of clipping.

    Returns:
      Phases [rad], shape (L,).
    """
    lines = slice(first_line, first_line + len(amplitude))
    count = 8 * lines.stop
    power = np.cumsum(amplitude**2) / np.sum(amplitude**2)
    schroeder = -2 * np.pi * np.cumsum(power)
    starts = (schroeder, np.random.default_rng(seed).uniform(0, 2 * np.pi, len(amplitude)))
    best, best_phase = np.inf, schroeder
    for phase in starts:
        for level in np.linspace(0.75, 0.98, rounds):
            spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
            spectrum[lines] = amplitude * np.exp(1j * phase)
            signal = np.fft.irfft(spectrum, count)
            peak = np.abs(signal).max()
            if peak < best:
                best, best_phase = peak, phase
            phase = np.angle(np.fft.rfft(np.clip(signal, -level * peak, level * peak))[lines])
    return best_phase


def prbs(duration_s: float, clock_period_s: float, sample_period_s: float, *, bits: int, seed: int = 0) -> Array:
    """Pseudo-random binary sequence of the levels −1 and 1 (maximum length, 2^bits − 1 clock periods).

    Its spectrum is flat from 1/((2^bits − 1) clock period) to half its power at 0.44/clock period.

    Args:
      duration_s: length of the signal [s]; the sequence repeats.
      clock_period_s: shortest time at one level [s], a whole number of sampling periods.
      sample_period_s: sampling period [s].
      bits: length of the shift register, 2…32.
      seed: picks where in the sequence it begins.

    Returns:
      Signal, shape (N,).

    Raises:
      InputError: if the register's length is out of range or the clock period is no whole number of samples.
    """
    if not 2 <= bits <= 32:
        raise InputError(f"a PRBS takes 2 to 32 bits, got {bits}; choose another period or clock")
    count = len(_times(duration_s, sample_period_s))
    held = _whole("the PRBS' clock period", clock_period_s, sample_period_s)
    state = np.random.default_rng(seed).integers(0, 2, bits)
    state[0] = 1  # an all-zero register stays there
    sequence = max_len_seq(bits, state=state, length=-(-count // held))[0]
    return np.asarray(np.repeat(2.0 * sequence - 1.0, held)[:count])


def _whole(name: str, span_s: float, sample_period_s: float) -> int:
    count = round(span_s / sample_period_s)
    if count < 1 or abs(span_s / sample_period_s - count) > 1e-6 * count:
        raise InputError(
            f"{name}, {span_s:g} s, must be a whole number of sampling periods of {sample_period_s:g} s; round it"
        )
    return count


def _times(duration_s: float, sample_period_s: float) -> Array:
    if not 0 < sample_period_s <= duration_s:
        raise InputError(
            f"a signal needs 0 < sample_period_s ≤ duration_s, got {sample_period_s:g} s and {duration_s:g} s"
        )
    return np.arange(round(duration_s / sample_period_s), dtype=np.float64) * sample_period_s

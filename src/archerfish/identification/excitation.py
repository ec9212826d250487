"""Input signals for identification logs: the paper's 2–50 Hz sweep and its step."""

import numpy as np
from numpy.typing import NDArray

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


def _times(duration_s: float, sample_period_s: float) -> Array:
    if not 0 < sample_period_s <= duration_s:
        raise InputError(
            f"a signal needs 0 < sample_period_s ≤ duration_s, got {sample_period_s:g} s and {duration_s:g} s"
        )
    return np.arange(round(duration_s / sample_period_s), dtype=np.float64) * sample_period_s

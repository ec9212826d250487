"""Signals that excite an axis, about zero and with a peak of about one: sweep, multisine, PRBS."""

from typing import Literal

import numpy as np
from scipy.signal import chirp, max_len_seq

from archerfish2.identification.simulation import Array

SweepMethod = Literal["linear", "logarithmic"]


def sweep(count: int, period_s: float, low_hz: float, high_hz: float, method: SweepMethod) -> tuple[Array, Array]:
    """Return a sine whose frequency rises from one to another, and that frequency at each sample [Hz].

    Args:
      count: samples N.
      period_s: sampling period [s].
      low_hz: frequency at the start, > 0 for a logarithmic sweep [Hz].
      high_hz: frequency at the end [Hz].
      method: how the frequency rises with time.

    Returns:
      Two arrays of shape (N,).
    """
    time, share = period_s * np.arange(count), np.arange(count) / count
    frequency = low_hz + (high_hz - low_hz) * share if method == "linear" else low_hz * (high_hz / low_hz) ** share
    return np.asarray(chirp(time, low_hz, count * period_s, high_hz, method, phi=-90)), frequency


def multisine(count: int, first: int, amplitude: Array, flattened: Array) -> Array:
    """Return one period of Σ amplitude cos(2π n t + φ), n = first, first + 1, …, t in periods.

    Schroeder's phases (1970, eq 10), φₙ = −2π Σ (n − l) pₗ over l < n, give a sum of sines whose shares of the power
    are p a low peak: that of the signal itself, or of its derivatives.

    Args:
      count: samples N of the period.
      first: number of the lowest harmonic; the highest is below N / 2.
      amplitude: of each harmonic, shape (L,).
      flattened: amplitudes of the sum that has the low peak, shape (L,).

    Returns:
      Shape (N,).
    """
    share = np.cumsum(flattened**2) / np.sum(flattened**2)
    spectrum = np.zeros(count // 2 + 1, np.complex128)
    spectrum[first : first + len(share)] = 0.5 * count * amplitude * np.exp(-2j * np.pi * (np.cumsum(share) - share))
    return np.fft.irfft(spectrum, count)


def prbs(count: int, clock: int, bits: int) -> Array:
    """Return a pseudo-random binary sequence of the levels −1 and 1, of maximum length: 2^bits − 1 clock periods.

    Its spectrum is flat from 1 / ((2^bits − 1) clock period) to half its power at 0.44 / clock period.

    Args:
      count: samples N; the sequence repeats.
      clock: shortest time at one level [samples].
      bits: length of the shift register, 2…32.

    Returns:
      Shape (N,).
    """
    levels = max_len_seq(bits, length=-(-count // clock))[0]
    return np.repeat(2.0 * levels - 1.0, clock)[:count]

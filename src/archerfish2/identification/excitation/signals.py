"""Signals that excite an axis, about zero and with a peak of about one: sweep, multisine, PRBS."""

from typing import Literal

import numpy as np
from scipy.signal import chirp, max_len_seq

from archerfish2.identification.simulation import Array

SweepMethod = Literal["linear", "logarithmic"]


def sweep(
    count: int, period_s: float, low_hz: float, high_hz: float, method: SweepMethod = "linear"
) -> tuple[Array, Array]:
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


def schroeder_phases(amplitude: Array) -> Array:
    """Return phases that give a sum of sines a low peak: φₙ = −2π Σ (n − l) pₗ over l < n (Schroeder 1970, eq 10).

    Args:
      amplitude: of adjacent harmonics, whose shares of the power are p, shape (L,).

    Returns:
      [rad], shape (L,).
    """
    share = np.cumsum(amplitude**2) / np.sum(amplitude**2)
    return np.asarray(-2 * np.pi * (np.cumsum(share) - share))


def multisine(count: int, first: int, amplitude: Array, phase: Array) -> Array:
    """Return one period of Σ amplitude cos(2π n t + phase), n = first, first + 1, …, t in periods.

    Args:
      count: samples N of the period.
      first: number of the lowest harmonic; the highest is below N / 2.
      amplitude: of each harmonic, shape (L,).
      phase: of each harmonic [rad], shape (L,).

    Returns:
      Shape (N,).
    """
    spectrum = np.zeros(count // 2 + 1, np.complex128)
    spectrum[first : first + len(amplitude)] = 0.5 * count * amplitude * np.exp(1j * phase)
    return np.fft.irfft(spectrum, count)


def prbs(count: int, clock: int, bits: int, seed: int) -> Array:
    """Return a pseudo-random binary sequence of the levels −1 and 1, of maximum length: 2^bits − 1 clock periods.

    Its spectrum is flat from 1 / ((2^bits − 1) clock period) to half its power at 0.44 / clock period.

    Args:
      count: samples N; the sequence repeats.
      clock: shortest time at one level [samples].
      bits: length of the shift register, 2…32.
      seed: determines where in the sequence it begins.

    Returns:
      Shape (N,).
    """
    state = np.random.default_rng(seed).integers(0, 2, bits)
    state[0] = 1  # an all-zero register stays so
    levels = max_len_seq(bits, state=state, length=-(-count // clock))[0]
    return np.repeat(2.0 * levels - 1.0, clock)[:count]

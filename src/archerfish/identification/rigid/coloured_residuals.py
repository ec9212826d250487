"""Covariance of a least-squares estimate whose residuals are not white (the sandwich with a spectral middle).

Residuals of real logs are coloured: friction, cogging and the cables leave their mark over many samples. The estimate
(GᵀG)⁻¹Gᵀe has the covariance (GᵀG)⁻¹ (Gᵀ Γ G) (GᵀG)⁻¹, where Γ holds the residuals' autocovariances: those of a first
order model, and of what it leaves, weighted by Bartlett's window, whose width follows its own memory (Andrews and
Monahan 1992). All of it stays positive.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LONGEST_MEMORY = 0.97
"""Largest coefficient of the first-order model; nearer to 1 a few samples would decide about the covariance."""


def coloured_covariance(
    slopes: Sequence[Array], residuals: Sequence[Array], stretches: Sequence[int], parameters: int
) -> Array:
    """Return the covariance of the estimated parameters.

    Args:
      slopes: per recording, slopes of the simulated outputs in the shared parameters, less what nuisance parameters
        explain; shape (N, p outputs, k).
      residuals: per recording, shape (N, p); recordings are independent of one another.
      stretches: per recording, number of equal stretches with an initial angle and rate of their own.
      parameters: number of all estimated parameters, nuisance ones too.

    Returns:
      Shape (k, k).
    """
    count = slopes[0].shape[-1]
    samples = sum(each.size for each in residuals)
    inner, middle = np.zeros((count, count)), np.zeros((count, count))
    for slope, residual, parts in zip(slopes, residuals, stretches, strict=True):
        inner += np.einsum("npk,npl->kl", slope, slope)
        middle += _middle(slope, residual, _memory(residual, len(residual) / parts))
    bread = np.linalg.inv(inner)
    return np.asarray(bread @ middle @ bread * samples / max(samples - parameters, 1))


def _middle(slopes: Array, residuals: Array, memory: Array) -> Array:
    """Return Gᵀ Γ G of one recording, by the spectra of its slopes and its residuals."""
    count = len(residuals)
    padded = 2 * count
    white = residuals[1:] - memory * residuals[:-1]
    spectrum = np.fft.rfft(white, padded, axis=0)
    cross = np.fft.irfft(np.conj(spectrum)[:, :, None] * spectrum[:, None, :], padded, axis=0) / len(white)
    lag = np.minimum(np.arange(padded), padded - np.arange(padded))
    window = np.maximum(1 - lag / (_bandwidth(white) + 1), 0.0)
    density = np.fft.rfft(cross * window[:, None, None], axis=0)
    colour = 1 / (1 - memory * np.exp(-2j * np.pi * np.fft.rfftfreq(padded))[:, None])
    density = density * np.conj(colour)[:, :, None] * colour[:, None, :]
    lines = np.fft.rfft(slopes, padded, axis=0)
    # A one-sided spectrum stands for both sides, but for its first and last line.
    weight = np.full(len(lines), 2.0)
    weight[[0, -1]] = 1.0
    return np.asarray(np.einsum("f,fpk,fpq,fql->kl", weight, lines, density, np.conj(lines)).real / padded)


def _memory(residuals: Array, stretch: float) -> Array:
    """Return the first-order coefficient of each output, shape (p,).

    A level and a trend fitted to n samples bias it by −(2 + 4 ρ)/n (Kendall 1954), which is taken off again.
    """
    rho = (first_lag(residuals) + 2 / stretch) / (1 - 4 / stretch)
    return np.clip(rho, -_LONGEST_MEMORY, _LONGEST_MEMORY)


def first_lag(signal: Array) -> Array:
    """Return the correlation of each column with itself a sample later, shape (N, p) → (p,)."""
    power = np.sum(signal**2, axis=0)
    return np.asarray(np.sum(signal[1:] * signal[:-1], axis=0) / np.maximum(power, np.finfo(float).tiny))


def _bandwidth(signal: Array) -> float:
    """Width of Bartlett's window [samples] that suits a first-order signal with the same first lag (Andrews 1991)."""
    rho = np.clip(first_lag(signal), -_LONGEST_MEMORY, _LONGEST_MEMORY)
    alpha = float(np.max(4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2)))
    return float(min(1.1447 * (alpha * len(signal)) ** (1 / 3), len(signal) / 4))

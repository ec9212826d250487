"""Spectrum of the noise: the power of a residual at each line, smooth enough for weights and draws."""

from itertools import pairwise

import numpy as np

from archerfish2.identification.simulation import Array

_EDGES = (3, 6, 12, 24, 48, 96)  # lines between which the power law of a slow wander is fitted
_STEEP, _STEEPEST = -0.7, -2.0  # slope of the law from which it is taken, and at most
_LEAST_LEFT = 0.2  # share of the noise in a residual


def noise_power(squares: Array) -> Array:
    """Return a residual's power at each line, smooth over octaves: each counts the next higher one as eight lines more.

    Args:
      squares: of the residual, shape (F,).
    """
    n = len(squares)
    edges = list(dict.fromkeys([0, *(2**k - 1 for k in range(1, int(np.log2(n + 1)) + 1)), n]))
    above, means = squares[n // 2 :].mean(), []
    for low, high in zip(edges[-2::-1], edges[:0:-1], strict=True):
        above = (squares[low:high].sum() + 8 * above) / (high - low + 8)
        means.append(np.log(max(above, 1e-300)))
    centres = [np.log(0.5 * (low + high + 1)) for low, high in pairwise(edges)]
    return np.asarray(np.exp(np.interp(np.log(np.arange(1, n + 1)), centres, means[::-1])))


def slow_wander(squares: Array, most: int) -> Array:
    """Return the power law of a slow wander, continued to the lowest lines, from which a fit removes it; 0 without one.

    Args:
      squares: of the residual, shape (F,).
      most: lines to which the law is fitted at most.
    """
    law, edges = np.zeros(len(squares)), [each for each in _EDGES if each <= min(len(squares), most)]
    means = np.array([squares[low - 1 : high - 1].mean() for low, high in pairwise(edges)])
    if len(means) < 2 or not np.all(means > 0):
        return law
    centres = [0.5 * np.log(low * high) for low, high in pairwise(edges)]
    slope, level = np.polyfit(centres, np.log(means), 1, w=np.sqrt(np.diff(edges)))
    if slope < _STEEP:
        law[: edges[-1] - 1] = np.exp(level + max(slope, _STEEPEST) * np.log(np.arange(1, edges[-1])))
    return law


def local_power(squares: Array, left: Array) -> Array:
    """Return the power of the noise around each line, for draws, shape (F,).

    Args:
      squares: of a residual, shape (F,).
      left: share of the noise that is in it, shape (F,).
    """
    width = 2 * max(2, round(np.sqrt(len(squares)) / 2)) + 1
    padded = np.pad([squares, left], ((0, 0), (width // 2, width // 2)), mode="symmetric")
    power, share = (np.convolve(each, np.full(width, 1 / width), mode="valid") for each in padded)
    return np.asarray(np.maximum(power / np.maximum(share, _LEAST_LEFT), slow_wander(squares, width)))

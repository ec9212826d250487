"""A memory of the last second in a dozen numbers: the coefficients of a signal's history in Legendre polynomials.

Voelker, Kajić and Eliasmith, "Legendre Memory Units" (NeurIPS 2019): the linear system

    θ dm/dt = A m + B u,   A_ij = (2 i + 1) (−1 if i < j else (−1)^(i−j+1)),   B_i = (2 i + 1) (−1)^i

keeps in m the history u(t − s), 0 ≤ s ≤ θ, as Σ_i m_i P_i(2 s/θ − 1).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from archerfish.dynamics.array_namespace import Array, lift, namespace

Matrix = NDArray[np.float64]


def legendre_matrices(order: int, window_s: float, period_s: float) -> tuple[Matrix, Matrix]:
    """Return what takes the coefficients, shape (d, d), and a sample, shape (d,), to the next coefficients.

    Args:
      order: number of coefficients d.
      window_s: length θ of the history [s].
      period_s: between samples, each held until the next [s].
    """
    i = np.arange(order)
    sign = np.where(i[:, None] < i, -1.0, (-1.0) ** (i[:, None] - i + 1))
    drift, push = (2 * i + 1)[:, None] * sign, (2 * i + 1) * (-1.0) ** i
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[:order, -1] = drift, push
    step = expm(whole * period_s / window_s)
    return step[:order, :order], step[:order, -1]


def constant_history(sample: Array, like: Array) -> Array:
    """Return the coefficients of a signal that has always been the same, shape B → B + (d,).

    Args:
      sample: the signal, shape B.
      like: anything of shape (d,).
    """
    xp = namespace(sample, like)
    first = xp.asarray(np.arange(like.shape[0]) == 0, dtype=sample.dtype)
    return sample[..., None] * lift(first, sample[..., None])


def with_sample(transition: Array, push: Array, memory: Array, sample: Array) -> Array:
    """Take in a sample, shape B, and return the next coefficients, shape B + (d,)."""
    return memory @ namespace(memory).matrix_transpose(transition) + sample[..., None] * lift(push, memory)

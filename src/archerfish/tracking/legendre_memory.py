"""A memory of a signal's recent history in a dozen numbers: its coefficients in Legendre polynomials.

Voelker, Kajić and Eliasmith, "Legendre Memory Units" (NeurIPS 2019): the linear system

    θ dm/dt = A m + B u,   A_ij = (2 i + 1) (−1 if i < j else (−1)^(i−j+1)),   B_i = (2 i + 1) (−1)^i

keeps in m the history u(t − s), 0 ≤ s ≤ θ, as Σ_i m_i P_i(2 s/θ − 1).
"""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace


class Window(NamedTuple):
    """What takes the coefficients of a history of fixed length to those a period later."""

    transition: Array  # of the coefficients, (d, d)
    input: Array  # of a sample, (d,)


def legendre_window(order: int, length_s: float, period_s: float) -> Window:
    """Return the window of a history of a given length.

    Args:
      order: number of coefficients d.
      length_s: θ [s].
      period_s: between samples, each held until the next [s].
    """
    i = np.arange(order)
    sign = np.where(i[:, None] < i, -1.0, (-1.0) ** (i[:, None] - i + 1))
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[:order, -1] = (2 * i + 1)[:, None] * sign, (2 * i + 1) * (-1.0) ** i
    # The matrix exponential by scaling and squaring: without SciPy, which a policy on a robot does not need.
    halvings = max(0, int(np.ceil(np.log2(np.abs(whole).sum(axis=1).max() * period_s / length_s))) + 4)
    small = whole * period_s / length_s / 2**halvings
    term = step = np.eye(order + 1)
    for power in range(1, 14):
        term = term @ small / power
        step = step + term
    for _ in range(halvings):
        step = step @ step
    return Window(step[:order, :order], step[:order, -1])


def constant_history(window: Window, sample: Array) -> Array:
    """Return the coefficients of a signal that has always been the same, shape B → B + (d,)."""
    xp = namespace(sample, window.input)
    first = xp.asarray(np.arange(window.input.shape[0]) == 0, dtype=sample.dtype)
    return sample[..., None] * lift(first, sample[..., None])


def with_sample(window: Window, coefficients: Array, sample: Array) -> Array:
    """Return the coefficients, shape B + (d,), a period and a sample later, shape B."""
    moved = coefficients @ namespace(coefficients).matrix_transpose(window.transition)
    return moved + sample[..., None] * lift(window.input, coefficients)

"""A stable plant as parallel sections of first and second order, and the free numbers that stand for its poles.

A section has the denominator 1 + a₁ z⁻¹ + a₂ z⁻² (or 1 + a₁ z⁻¹), so that a pair of poles may turn from real to complex
without a kink. Its coefficients are made from free numbers θ,

    a₂ = tanh θ₂,   a₁ = (1 + a₂) tanh θ₁        (first order: a₁ = tanh θ₁),

which reaches every stable section and no other: a search over θ needs no constraint.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Poles = NDArray[np.complex128]
Sections = tuple[Array, ...]
"""Per section its denominator after the leading 1: (a₁, a₂) or (a₁,)."""

_LARGEST = 8.5
"""Bound of |θ|: (1 − tanh 8.5)² is 7e-15, so that the poles stay off the unit circle in float64 too."""


def sections_from_poles(poles: Poles) -> Sections:
    """Sort poles into sections: conjugate pairs together, real poles in pairs (slowest with fastest).

    Args:
      poles: closed under conjugation, shape (n,).
    """
    pairs = [(-2 * pole.real, abs(pole) ** 2) for pole in poles if pole.imag > 0]
    real = sorted(float(pole.real) for pole in poles if pole.imag == 0)
    while len(real) > 1:
        slow, fast = real.pop(), real.pop(0)
        pairs.append((-(slow + fast), slow * fast))
    return tuple(np.array(pair) for pair in [*pairs, *[(-pole,) for pole in real]])


def section_poles(sections: Sections) -> Poles:
    """Return the poles of all sections, shape (n,)."""
    return np.array([root for section in sections for root in _roots(*section.tolist())], np.complex128)


def _roots(first: float, second: float | None = None) -> tuple[complex, ...]:
    """Return the roots of z² + first z + second, or of z + first."""
    if second is None:
        return (complex(-first),)
    centre = -first / 2
    square = centre**2 - second
    if square < 0:
        return complex(centre, np.sqrt(-square)), complex(centre, -np.sqrt(-square))
    # The larger root first and the other one from their product: a difference of like numbers would be inexact.
    large = centre + np.copysign(np.sqrt(square), centre)
    return complex(large), complex(second / large if large else 0.0)


def stabilised(poles: Poles, largest: float = 0.9995) -> Poles:
    """Mirror poles from outside the unit circle to inside, and hold all within the radius `largest`."""
    outside = np.maximum(np.abs(poles), 1.0)
    inside = poles / outside / outside
    return inside * np.minimum(1.0, largest / np.maximum(np.abs(inside), np.finfo(float).tiny))


def free_numbers(sections: Sections) -> Array:
    """Return θ of stable sections, shape (n,)."""
    parts = [_section_numbers(section) for section in sections]
    return np.clip(np.concatenate(parts), -_LARGEST, _LARGEST)


def _section_numbers(section: Array) -> Array:
    if section.size == 1:
        return np.array(np.arctanh(section))
    # A double real pole at the edge of the triangle can leave the open interval by rounding.
    ratio = np.clip(section[0] / (1 + section[1]), -1 + 1e-12, 1 - 1e-12)
    return np.array(np.arctanh([ratio, section[1]]))


def sections_from_numbers(theta: Array) -> Sections:
    """Return the sections of θ, shape (n,), held within bounds: pairs first, a single one last."""
    tanh = np.tanh(np.clip(theta, -_LARGEST, _LARGEST))
    pairs = [np.array([tanh[i] * (1 + tanh[i + 1]), tanh[i + 1]]) for i in range(0, theta.size - 1, 2)]
    return (*pairs, tanh[-1:]) if theta.size % 2 else tuple(pairs)


def coefficient_slopes(theta: Array) -> Array:
    """Return ∂(a of all sections in order)/∂θ, shape (n, n)."""
    tanh = np.tanh(np.clip(theta, -_LARGEST, _LARGEST))
    slopes = np.diag(1 - tanh**2)
    for i in range(0, theta.size - 1, 2):
        slopes[i, i] *= 1 + tanh[i + 1]
        slopes[i, i + 1] = tanh[i] * (1 - tanh[i + 1] ** 2)
    return slopes


def section_offsets(sections: Sections) -> Iterator[tuple[int, Array]]:
    """Yield each section with the index of its first coefficient among those of all sections."""
    start = 0
    for section in sections:
        yield start, section
        start += section.size


def state_matrices(sections: Sections, numerators: Array) -> tuple[Array, Array, Array]:
    """Return A, shape (n, n), B, shape (n, m), and C, shape (p, n), of a plant with one output or one input.

    Observer form for one output, per section A = [[−a₁, 1], [−a₂, 0]], C = [1, 0], B the numerators; its transpose for
    one input, where each output has numerators of its own.

    Args:
      sections: the poles.
      numerators: b of all sections in order, shape (n, m, p).
    """
    order = sum(section.size for section in sections)
    A, ones = np.zeros((order, order)), np.zeros((order, 1))
    for start, section in section_offsets(sections):
        stop = start + section.size
        A[start:stop, start] = -section
        A[start : stop - 1, start + 1 : stop] = np.eye(section.size - 1)
        ones[start] = 1.0
    if numerators.shape[2] == 1:
        return A, numerators[:, :, 0], ones.T
    if numerators.shape[1] != 1:
        raise ValueError(f"a plant needs one input or one output, got numerators of shape {numerators.shape}")
    return A.T, ones, numerators[:, 0, :].T

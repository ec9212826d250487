"""Parallel second-order sections: the structure in which an axis is identified.

    G(z) = Σ (b₁ z + b₂ z²) / (1 + a₁ z + a₂ z²) + D,    z = e^{−iω}, the delay of one sample

A section is the array [a₁, a₂], or [a₁] for a single real pole; single ones come last in a list. The numerators b are
linear parameters; unconstrained parameters θ, one a pole, are what an optimiser moves: every θ gives stable poles.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from archerfish.identification.simulation import TINY, Array, Complex

Sections = Sequence[Array]

_NEAREST = 1 - 8e-8  # largest |tanh θ| of unconstrained parameters
_LARGEST_POLE = 0.9995  # of a start; nearer to the unit circle a pole can't be distinguished from a transient


class Structure(NamedTuple):
    """Structure of a plant and of its logs."""

    order: int  # number of poles
    delay: int  # of the inputs [samples]
    feedthrough: bool  # whether inputs act, after the delay, within their own sample
    drift: bool = False  # of the outputs, by a polynomial of third degree

    @property
    def dead_time(self) -> int:
        """See `PlantRecord.dead_time_samples`."""
        return max(self.delay - self.feedthrough, 0)


def sections_of(theta: Array) -> Sections:
    """Return the sections of unconstrained parameters: a₁ = t₁ (1 + t₂), a₂ = t₂, t = tanh θ, which are stable.

    Args:
      theta: shape (n,), two by two; a last single one is a real pole.
    """
    t = np.tanh(theta)
    pairs = [np.array([t[i] * (1 + t[i + 1]), t[i + 1]]) for i in range(0, len(t) - 1, 2)]
    return [*pairs, t[-1:]] if len(t) % 2 else pairs


def free_numbers(sections: Sections) -> Array:
    """Return the unconstrained parameters of sections, shape (n,)."""
    t = np.concatenate([[s[0] / (1 + s[1]), s[1]] if len(s) == 2 else s for s in sections])
    return np.asarray(np.arctanh(np.clip(t, -_NEAREST, _NEAREST)))


def theta_slopes(theta: Array) -> Array:
    """Return the derivatives of the coefficients a (columns) by the unconstrained parameters (rows), shape (n, n)."""
    t, turn = np.tanh(theta), np.eye(len(theta))
    for i in range(0, len(t) - 1, 2):
        turn[i, i], turn[i + 1, i] = 1 + t[i + 1], t[i]
    return np.asarray((1 - t**2)[:, None] * turn)


def sections_from_poles(poles: Complex) -> Sections:
    """Pair poles; those outside the unit circle are mirrored, real ones are paired largest with smallest.

    Args:
      poles: in the z plane, shape (n,), complex ones with their conjugates.
    """
    size = np.maximum(np.abs(poles), TINY)
    poles = poles / size * np.minimum(np.where(size > 1, 1 / size, size), _LARGEST_POLE)
    pairs = [np.array([-2 * p.real, abs(p) ** 2]) for p in poles if p.imag > 0]
    real = sorted(p.real for p in poles if p.imag == 0)
    while len(real) > 1:
        high, low = real.pop(), real.pop(0)
        pairs.append(np.array([-(high + low), high * low]))
    return pairs + [np.array([-p]) for p in real]


def order_of(sections: Sections) -> int:
    """Return the number of poles."""
    return sum(map(len, sections))


def poles_of(sections: Sections) -> Complex:
    """Return the poles in the z plane, shape (n,)."""
    return np.concatenate([np.roots(np.append(1.0, s)).astype(complex) for s in sections])


def section_states(sections: Sections, z: Complex) -> tuple[Complex, list[Complex]]:
    """Return the transforms of the states of all sections under an impulse, and 1 / (1 + a₁ z + a₂ z²) of each.

    Args:
      sections: of n poles.
      z: delay of one sample at each of F frequencies, shape (F,).

    Returns:
      Shapes (n, F) and (F,) each.
    """
    inverses = [1 / (1 + z * (s[0] if len(s) == 1 else s[0] + s[1] * z)) for s in sections]
    states = list[Complex]()
    for section, inverse in zip(sections, inverses, strict=True):
        states += (inverse, inverse * z)[: len(section)]
    return np.array(states), inverses


def response(sections: Sections, numerators: Array, inputs: int, z: Complex) -> Complex:
    """Return the frequency response without the input delay, shape (m, p, F).

    Args:
      sections: of n poles.
      numerators: state by state, of these input by input; then the feedthrough, if any: shape (n m or n m + m, p).
      inputs: m.
      z: delay of one sample at each frequency, shape (F,).
    """
    states, _ = section_states(sections, z)
    rows, outputs = len(states) * inputs, numerators.shape[1]
    b = numerators[:rows].reshape(len(states), inputs, outputs)
    strictly_proper = np.einsum("nmp,nf->mpf", b, states * z)
    direct = numerators[rows:].reshape(-1, outputs, 1) if len(numerators) > rows else 0.0
    return np.asarray(strictly_proper + direct)


def state_matrices(sections: Sections, numerators: Array, inputs: int) -> tuple[Array, Array, Array, Array]:
    """Return A, B, C, D: controller form of one input, observer form of several inputs and one output.

    Arguments as of `response`.
    """
    order, outputs = order_of(sections), numerators.shape[1]
    A = block_diag(*(np.vstack([-s, np.eye(len(s) - 1, len(s))]) for s in sections))
    first = np.concatenate([np.eye(len(s), 1) for s in sections])
    b, direct = numerators[: order * inputs], numerators[order * inputs :]
    D = direct.T if len(direct) else np.zeros((outputs, inputs))
    return (A, first, b.T, D) if inputs == 1 else (A.T, b.reshape(order, inputs), first.T, D)

"""Draws of the parameters of an axis, for the simulator to train on and for bands.

Poles that nothing determines stay where they were estimated: a normal distribution says nothing about them, and the
rest must not scatter as if they moved. The numerators follow the poles drawn not by the tangent alone, since the
response in the band is far surer than either of them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.informative_lines import thinned
from archerfish.identification.axis.modal_form import sections_from_numbers
from archerfish.identification.axis.pole_refinement import Problem
from archerfish.identification.axis.uncertainty import Posterior, gram_inverse, transfer

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES = 60
"""Lines at which the response of a draw is held to that of the estimate."""
_STEP = 1e-6
_RIDGE = 1e-13


def draw_parameters(
    known: Posterior, held: Array, problem: Problem, count: int, generator: np.random.Generator
) -> list[Posterior]:
    """Draw from the distribution of the parameters.

    Args:
      known: the parameters.
      held: directions of the free numbers that don't move, shape (k, n).
      problem: what was fitted.
      count: number of draws.
      generator: of the draws.
    """
    order = known.order
    moves = _moves(known, held, count, generator)
    turned = known.free + moves[:, :order]
    sides = [known.free + sign * _STEP * np.eye(order) for sign in (1.0, -1.0)]
    followed = _following(known, problem, np.concatenate([turned, *sides, known.free[None]]))
    up, down, here = followed[count : count + order], followed[count + order : -1], followed[-1]
    tangent = np.tensordot(moves[:, :order], (up - down) / (2 * _STEP), 1)
    straight = moves[:, order:].reshape(count, *known.linear.T.shape).swapaxes(1, 2)
    linear = known.linear + straight + (followed[:count] - here - tangent)
    return [known._replace(free=free, linear=each) for free, each in zip(turned, linear, strict=True)]


def _moves(known: Posterior, held: Array, count: int, generator: np.random.Generator) -> Array:
    """Return normal deviations of all parameters, none along the held directions, shape (count, n + c p)."""
    scale = np.sqrt(np.maximum(np.diag(known.covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(known.covariance / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    moves = generator.standard_normal((count, root.shape[1])) @ root.T
    fixed = np.hstack([held, np.zeros((len(held), known.linear.size))])
    with_fixed = fixed @ known.covariance
    return np.asarray(moves - moves @ fixed.T @ gram_inverse(with_fixed @ fixed.T) @ with_fixed)


class _Rows(NamedTuple):
    """A batch of least-squares problems, one for each set of poles."""

    design: Array
    """Shape (k, R, c + transients)."""
    target: Array
    """Shape (R, p)."""


def _following(known: Posterior, problem: Problem, frees: Array) -> Array:
    """Return the linear parameters that keep the response nearest to the estimate's, for many poles at once.

    Args:
      known: the estimate.
      problem: what was fitted.
      frees: free numbers, shape (k, n).

    Returns:
      Shape (k, c, p).
    """
    denominators = [sections_from_numbers(free) for free in frees]
    sections = [np.stack([each[index] for each in denominators]) for index in range(len(denominators[0]))]
    experiments = thinned(problem.experiments, _LINES)
    shared = known.linear.shape[0]
    blocks = []
    for index, each in enumerate(experiments):
        own, driven = _columns(sections, each.lag, each.inputs, known.feedthrough)
        # Every experiment has a transient of its own.
        transients = np.zeros((*own.shape[:2], len(experiments) * known.order), np.complex128)
        transients[..., index * known.order : (index + 1) * known.order] = own * each.impulse[:, None]
        response = np.einsum("kpm,km->kp", transfer(known, each.lag), each.inputs)
        blocks.append(_Rows(_real(np.concatenate([driven, transients], axis=-1)), _real(response)))
    if problem.penalty is not None:
        units = np.eye(known.inputs, dtype=np.complex128)
        for unit, rows, target in zip(units, problem.penalty.rows, problem.penalty.targets, strict=True):
            inputs = np.tile(unit, (problem.penalty.lag.size, 1))
            driven = _columns(sections, problem.penalty.lag, inputs, known.feedthrough)[1]
            padding = np.zeros((len(frees), len(rows), len(experiments) * known.order))
            blocks.append(_Rows(np.concatenate([rows @ _real(driven), padding], axis=-1), target))
    design = np.concatenate([each.design for each in blocks], axis=1)
    target = np.concatenate([each.target for each in blocks])
    scale = np.sqrt(np.sum(design**2, axis=1, keepdims=True))
    scale[scale == 0] = 1.0
    scaled = design / scale
    gram, moment = scaled.swapaxes(1, 2) @ scaled, scaled.swapaxes(1, 2) @ target
    # What little is added settles directions that nothing determines, and moves no other by more than rounding does.
    found = np.linalg.solve(gram + _RIDGE * np.eye(gram.shape[1]), moment) / scale.swapaxes(1, 2)
    return np.asarray(found[:, :shared])


def _columns(
    sections: Sequence[Array], lag: ComplexArray, inputs: ComplexArray, feedthrough: bool
) -> tuple[ComplexArray, ComplexArray]:
    """Return the columns of `simulation_fit` for k sets of poles at once.

    Transients, shape (k, F, n), and responses through numerators and feedthrough, shape (k, F, c).
    """
    inverse = [1 / (1 + lag * np.sum(s[:, :, None] * lag ** np.arange(s.shape[1])[:, None], axis=1)) for s in sections]
    entries = [r * lag**power for s, r in zip(sections, inverse, strict=True) for power in range(s.shape[1])]
    own = np.stack(entries, axis=-1)
    driven = ((own * lag[:, None])[..., None] * inputs[:, None, :]).reshape(*own.shape[:2], -1)
    through = np.broadcast_to(inputs, (len(own), *inputs.shape))
    return own, np.concatenate([driven, through], axis=-1) if feedthrough else driven


def _real(signal: ComplexArray) -> Array:
    """Stack real parts over imaginary parts along the lines, the last dimension but one."""
    return np.concatenate([signal.real, signal.imag], axis=-2)

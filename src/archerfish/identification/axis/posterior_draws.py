"""Draws of the parameters of an axis, for the simulator to train on and for bands.

Poles that nothing determines stay where they were estimated: a normal distribution says nothing about them, and the
rest must not scatter as if they moved. The response in the band is far surer than poles and numerators, of which it is
a curved function: so it is the response that moves normally, and the numerators follow from it and from the poles.
"""

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.informative_lines import thinned
from archerfish.identification.axis.modal_form import sections_from_numbers
from archerfish.identification.axis.normal_equations import Part, lay_out
from archerfish.identification.axis.pole_refinement import Problem
from archerfish.identification.axis.uncertainty import Posterior

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES = 60
"""Lines at which the response of a draw is looked at."""
_STEP = 1e-6
_NOTHING = 3e-7
"""Share of what the numerators do at most, up to which a direction of theirs does nothing."""
_SAME = 1e-6
"""Size of what a held direction has beside the others, up to which it is one of them."""


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
    moves = _moves(known, held, count, generator)
    free = known.free + moves[:, : known.order]
    linear = known.linear + _by_output(moves, known)
    linear = linear + _mended(known, problem, moves, free, linear)
    return [known._replace(free=poles, linear=each) for poles, each in zip(free, linear, strict=True)]


def _by_output(moves: Array, known: Posterior) -> Array:
    """Return the moves of the linear parameters, shape (count, c, p)."""
    return moves[:, known.order :].reshape(len(moves), *known.linear.T.shape).swapaxes(1, 2)


def _moves(known: Posterior, held: Array, count: int, generator: np.random.Generator) -> Array:
    """Return normal deviations of all parameters, none along the held directions, shape (count, n + c p)."""
    normals = generator.standard_normal((count, known.root.shape[1]))
    fixed = held @ known.root[: known.order]
    scale = np.linalg.norm(fixed, axis=1, keepdims=True)
    _, values, right = np.linalg.svd(fixed / np.where(scale > 0, scale, 1.0), full_matrices=False)
    # The two of a pair move along the same directions, up to the rounding of their slopes.
    fixed = right[values > _SAME]
    return np.asarray((normals - normals @ fixed.T @ fixed) @ known.root.T)


def _mended(known: Posterior, problem: Problem, moves: Array, free: Array, linear: Array) -> Array:
    """Return what must be added to drawn linear parameters for the response to move as straight as the parameters.

    Args:
      known: the estimate.
      problem: what was fitted.
      moves: of all parameters, shape (k, n + c p).
      free: free numbers drawn, shape (k, n).
      linear: linear parameters drawn, shape (k, c, p).

    Returns:
      Shape (k, c, p).
    """
    rows, missing = [], []
    for part in lay_out(thinned(problem.experiments, _LINES), known.feedthrough, problem.penalty).parts:
        columns = _columns(free, part, known.feedthrough)
        lacking = _straight(known, part, moves) - linear.swapaxes(1, 2) @ columns
        rows.append(_seen(columns, part))
        missing.append(_seen(lacking, part))
    design = np.concatenate(rows, axis=2)
    scale = np.linalg.norm(design, axis=2, keepdims=True)
    scale[scale == 0] = 1.0
    # Directions that change no response stay where they were drawn.
    added = np.concatenate(missing, axis=2) @ np.linalg.pinv(design / scale, rcond=_NOTHING)
    return np.asarray(added.swapaxes(1, 2) / scale)


def _straight(known: Posterior, part: Part, moves: Array) -> ComplexArray:
    """Return the response to the inputs of a part, to first order in the moves, shape (k, p, F)."""
    order = known.order
    sides = [known.free + sign * _STEP * np.eye(order) for sign in (1.0, -1.0)]
    columns = _columns(np.concatenate([*sides, known.free[None]]), part, known.feedthrough)
    responses = known.linear.T @ columns
    slopes = (responses[:order] - responses[order:-1]) / (2 * _STEP)
    turned = np.tensordot(moves[:, :order], slopes, 1)
    return np.asarray(responses[-1] + turned + _by_output(moves, known).swapaxes(1, 2) @ columns[-1])


def _seen(values: ComplexArray, part: Part) -> Array:
    """Return values at the lines of a part, shape (k, …, F), as the least squares see them, shape (k, …, R)."""
    rows = np.ascontiguousarray(values).view(np.float64)
    return rows if part.weights is None else np.asarray(rows @ part.weights)


def _columns(frees: Array, part: Part, feedthrough: bool) -> ComplexArray:
    """Return responses through numerators and feedthrough for k sets of free numbers, shape (k, c, F)."""
    denominators = [sections_from_numbers(free) for free in frees]
    lag, entries = part.lag, []
    for index in range(len(denominators[0])):
        section = np.stack([each[index] for each in denominators])
        polynomial = lag * section[:, :1] if section.shape[1] == 1 else lag * (section[:, :1] + section[:, 1:] * lag)
        inverse = 1 / (1 + polynomial)
        entries += [inverse, inverse * lag][: section.shape[1]]
    driven = (np.stack(entries, axis=1)[:, :, None] * part.driving).reshape(len(frees), -1, lag.size)
    through = [np.broadcast_to(part.inputs, (len(frees), *part.inputs.shape))] if feedthrough else []
    return np.concatenate([driven, *through], axis=1)

"""Draws of the parameters of an axis, for the simulator to train on and for bands.

Poles that nothing determines stay where they were estimated: a normal distribution says nothing about them, and the
rest must not scatter as if they moved. The numerators follow the poles drawn not by the tangent alone, since the
response in the band is far surer than either of them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.informative_lines import thinned
from archerfish.identification.axis.modal_form import sections_from_numbers
from archerfish.identification.axis.normal_equations import Part, lay_out
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
    bench = lay_out(thinned(problem.experiments, _LINES), known.feedthrough, problem.penalty)
    shared, outputs = known.linear.shape
    # Every experiment has a transient of its own.
    size = shared + known.order * len(bench.experiments)
    gram, moment = np.zeros((len(frees), size, size)), np.zeros((len(frees), size, outputs))
    for index, part in enumerate(bench.parts):
        columns = _columns(sections, part, known.feedthrough).view(np.float64)
        rows = columns if part.weights is None else columns @ part.weights
        target = _response(known, part) if part.weights is None else part.targets
        own = shared + index * known.order
        places = np.concatenate([np.arange(shared), np.arange(own, own + rows.shape[1] - shared)])
        gram[:, places[:, None], places] += rows @ rows.swapaxes(1, 2)
        moment[:, places] += rows @ target.T
    scale = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))[:, :, None]
    scale[scale == 0] = 1.0
    scaled = gram / scale / scale.swapaxes(1, 2)
    # What little is added settles directions that nothing determines, and moves no other by more than rounding does.
    found = np.linalg.solve(scaled + _RIDGE * np.eye(size), moment / scale) / scale
    return np.asarray(found[:, :shared])


def _response(known: Posterior, part: Part) -> Array:
    """Return the response of the estimate to the inputs of an experiment, shape (p, 2 F)."""
    response = np.einsum("fpm,mf->pf", transfer(known, part.lag), part.inputs)
    return np.ascontiguousarray(response).view(np.float64)


def _columns(sections: Sequence[Array], part: Part, feedthrough: bool) -> ComplexArray:
    """Return responses through numerators and feedthrough, then transients, for k sets of poles; shape (k, …, F)."""
    lag = part.lag
    entries = []
    for section in sections:
        polynomial = lag * section[:, :1] if section.shape[1] == 1 else lag * (section[:, :1] + section[:, 1:] * lag)
        inverse = 1 / (1 + polynomial)
        entries += [inverse, inverse * lag][: section.shape[1]]
    own = np.stack(entries, axis=1)
    driven = (own[:, :, None] * part.driving).reshape(len(own), -1, lag.size)
    through = [np.broadcast_to(part.inputs, (len(own), *part.inputs.shape))] if feedthrough else []
    transients = [] if part.impulse is None else [own * part.impulse]
    return np.concatenate([driven, *through, *transients], axis=1)

"""Poles by variable projection: Levenberg–Marquardt over the poles alone, all linear parameters solved at every step.

Golub and Pereyra (1973) with Kaufman's simplified derivative; the free numbers of `modal_form` keep the plant stable.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.modal_form import (
    Sections,
    coefficient_slopes,
    free_numbers,
    sections_from_numbers,
)
from archerfish.identification.axis.simulation_fit import LinearFit, Penalty, fit_linear_parameters
from archerfish.identification.axis.spectra import Spectrum

Array = NDArray[np.float64]

_MOST_DAMPING = 1e8
_TRUE, _HALF_TRUE = 0.75, 0.4
_BOLDER, _WARIER, _RETREAT = 0.2, 3.0, 8.0
_MOST_STEPS = 40


class Refinement(NamedTuple):
    """A local optimum of the simulation error."""

    sections: Sections
    """The poles, as stable sections."""
    fit: LinearFit
    """The linear parameters that belong to them."""
    cost: float
    """Sum of squared simulation errors, and all of the penalty."""


class Problem(NamedTuple):
    """What the poles are to explain."""

    experiments: Sequence[Spectrum]
    """Of one axis."""
    feedthrough: bool
    """Whether D is estimated."""
    penalty: Penalty | None = None
    """Added to the squared errors."""


class Effort(NamedTuple):
    """When a search over the poles ends."""

    smallest_gain: float = 0.01
    """With a step that lowers the cost by less than so many noise variances."""
    most_steps: int = _MOST_STEPS
    """After so many steps at the latest."""


def refine_poles(sections: Sections, problem: Problem, effort: Effort | None = None) -> Refinement:
    """Move the poles to the nearest minimum of the squared simulation error.

    Args:
      sections: poles to start from.
      problem: experiments, feedthrough and penalty.
      effort: when to end.
    """
    effort = effort or Effort()
    theta = free_numbers(sections)
    best = _at(theta, problem)
    damping = 1e-3
    for _ in range(effort.most_steps):
        before = best.cost
        theta, best, damping = _step(theta, best, damping, problem)
        if before - best.cost <= effort.smallest_gain * before / best.fit.residuals.size:
            break
    return best


def refine_all(starts: Iterable[Sections], problem: Problem, effort: Effort | None = None) -> list[Refinement]:
    """Refine from several starts and return their optima, best first."""
    return sorted((refine_poles(each, problem, effort) for each in starts), key=lambda each: each.cost)


def _at(theta: Array, problem: Problem) -> Refinement:
    sections = sections_from_numbers(theta)
    fit = fit_linear_parameters(sections, *problem)
    return Refinement(sections, fit, fit.cost + _pull(problem) * float(theta @ theta))


def _pull(problem: Problem) -> float:
    return 0.0 if problem.penalty is None else problem.penalty.pull


def _step(theta: Array, best: Refinement, damping: float, problem: Problem) -> tuple[Array, Refinement, float]:
    """Take the first step that lowers the cost, raising the damping until one does; none if none does."""
    slopes = best.fit.slopes @ coefficient_slopes(theta)
    pull = _pull(problem)
    curvature = slopes.T @ slopes + pull * np.eye(theta.size)
    gradient = slopes.T @ best.fit.residuals - pull * theta
    # A free number without influence has no curvature of its own to be damped by.
    weights = np.diag(curvature) + 1e-12 * np.trace(curvature) + np.finfo(float).tiny
    while damping < _MOST_DAMPING:
        move = np.linalg.solve(curvature + damping * np.diag(weights), gradient)
        tried = _at(theta + move, problem)
        if tried.cost < best.cost:
            # How much of the gain that the linear model promised has come true decides how far to trust it next.
            promised = float(move @ gradient + damping * move @ (weights * move))
            kept = (best.cost - tried.cost) / promised
            factor = _BOLDER if kept > _TRUE else _WARIER if kept < _HALF_TRUE else 1.0
            return theta + move, tried, max(factor * damping, 1e-10)
        damping *= _RETREAT
    return theta, best, damping

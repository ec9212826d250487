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
from archerfish.identification.axis.normal_equations import Bench, Solution, lay_out, solve, tangent
from archerfish.identification.axis.simulation_fit import LinearFit, Penalty
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
    bench = lay_out(*problem)
    here, damping = _at(free_numbers(sections), bench), 1e-3
    for _ in range(effort.most_steps):
        enough = effort.smallest_gain * here.cost / here.solution.fit.residuals.size
        before = here.cost
        here, damping = _step(here, damping, bench, enough)
        if before - here.cost <= enough:
            break
    return Refinement(here.solution.sections, here.solution.fit, here.cost)


def refine_all(starts: Iterable[Sections], problem: Problem, effort: Effort | None = None) -> list[Refinement]:
    """Refine from several starts and return their optima, best first."""
    return sorted((refine_poles(each, problem, effort) for each in starts), key=lambda each: each.cost)


class _Point(NamedTuple):
    theta: Array
    solution: Solution
    cost: float


def _at(theta: Array, bench: Bench) -> _Point:
    solution = solve(sections_from_numbers(theta), bench)
    return _Point(theta, solution, solution.fit.cost + _pull(bench) * float(theta @ theta))


def _pull(bench: Bench) -> float:
    return 0.0 if bench.penalty is None else bench.penalty.pull


def _step(here: _Point, damping: float, bench: Bench, enough: float) -> tuple[_Point, float]:
    """Take the first step that lowers the cost, raising the damping until one does or none promises enough."""
    slopes, pull = coefficient_slopes(here.theta), _pull(bench)
    curvature, gradient = tangent(here.solution, bench)
    curvature = slopes.T @ curvature @ slopes + pull * np.eye(here.theta.size)
    gradient = slopes.T @ gradient - pull * here.theta
    # A free number without influence has no curvature of its own to be damped by.
    weights = curvature.diagonal() + 1e-12 * curvature.trace() + np.finfo(float).tiny
    while damping < _MOST_DAMPING:
        move = np.linalg.solve(curvature + damping * np.diag(weights), gradient)
        promised = float(move @ gradient + damping * move @ (weights * move))
        if promised <= enough:
            break
        tried = _at(here.theta + move, bench)
        if tried.cost < here.cost:
            # How much of the gain that the linear model promised has come true decides how far to trust it next.
            kept = (here.cost - tried.cost) / promised
            factor = _BOLDER if kept > _TRUE else _WARIER if kept < _HALF_TRUE else 1.0
            return tried, max(factor * damping, 1e-10)
        damping *= _RETREAT
    return here, damping

"""Poles by variable projection: Levenberg–Marquardt over the poles alone, all linear parameters solved at every step.

Golub and Pereyra (1973) with Kaufman's simplified derivative; the free numbers of `modal_form` keep the plant stable.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.modal_form import (
    Sections,
    coefficient_slopes,
    free_numbers,
    sections_from_numbers,
)
from archerfish.identification.simulation_fit import LinearFit, Structure, fit_linear_parameters
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_MOST_DAMPING = 1e8
_MOST_STEPS = 40


class Refinement(NamedTuple):
    """A local optimum of the simulation error."""

    sections: Sections
    """The poles, as stable sections."""
    fit: LinearFit
    """The linear parameters that belong to them."""


def refine_poles(
    sections: Sections, recordings: Sequence[Recording], structure: Structure, *, smallest_gain: float = 1e-7
) -> Refinement:
    """Move the poles to the nearest minimum of the squared simulation error.

    Args:
      sections: poles to start from.
      recordings: m inputs and one output each.
      structure: delay and feedthrough.
      smallest_gain: the search ends with a step that lowers the cost by less than this share of it.
    """
    theta = free_numbers(sections)
    best = _at(theta, recordings, structure)
    damping = 1e-3
    for _ in range(_MOST_STEPS):
        before = best.fit.cost
        theta, best, damping = _step(theta, best, damping, recordings, structure)
        if before - best.fit.cost <= smallest_gain * before:
            break
    return best


def _at(theta: Array, recordings: Sequence[Recording], structure: Structure) -> Refinement:
    sections = sections_from_numbers(theta)
    return Refinement(sections, fit_linear_parameters(sections, recordings, structure))


def _step(
    theta: Array, best: Refinement, damping: float, recordings: Sequence[Recording], structure: Structure
) -> tuple[Array, Refinement, float]:
    """Take the first step that lowers the cost, raising the damping until one does; none if none does."""
    slopes = best.fit.slopes @ coefficient_slopes(theta)
    curvature, gradient = slopes.T @ slopes, slopes.T @ best.fit.residuals
    # A free number without influence has no curvature of its own to be damped by.
    weights = np.diag(curvature) + 1e-12 * np.trace(curvature) + np.finfo(float).tiny
    while damping < _MOST_DAMPING:
        candidate = theta + np.linalg.solve(curvature + damping * np.diag(weights), gradient)
        tried = _at(candidate, recordings, structure)
        if tried.fit.cost < best.fit.cost:
            return candidate, tried, max(damping / 5, 1e-10)
        damping *= 5
    return theta, best, damping

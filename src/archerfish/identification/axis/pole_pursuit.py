"""First guesses of the poles, one section after another: whatever section explains most of what is left.

Where a subspace fit is led astray (weak resonances beside strong ones, feedback, distortion), a search over a grid of
single sections is not: it looks at the simulation error itself.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.axis.normal_equations import Bench, lay_out, solve
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_poles

_FREQUENCIES = 7
_DAMPINGS = (0.05, 0.3)
_HIGHEST = 3.0
"""Highest natural frequency of the grid in radians a sample, just below half the sampling rate."""
_KEPT = 2
_SKETCH = Effort(1.0, 6)


class _Candidate(NamedTuple):
    cost: float
    sections: Sections


def pursue_poles(problem: Problem, order: int) -> Iterator[Sections]:
    """Yield guesses of all poles, built by adding a section at a time and refining in between.

    Args:
      problem: what the poles are to explain.
      order: number of poles.
    """
    grown: list[Sections] = [()]
    bench = lay_out(*problem)
    for size in [2] * (order // 2) + [1] * (order % 2):
        refined = [refine_poles(each, problem, _SKETCH).sections if each else each for each in grown]
        grid = list(_grid(problem, size))
        grown = [
            candidate.sections
            for sections in refined
            for candidate in sorted(_extended(sections, grid, bench), key=lambda each: each.cost)[:_KEPT]
        ]
    yield from grown


def _extended(sections: Sections, grid: Sequence[np.ndarray], bench: Bench) -> Iterator[_Candidate]:
    for added in grid:
        longer = (*sections, added)
        yield _Candidate(solve(longer, bench).fit.cost, longer)


def _grid(problem: Problem, size: int) -> Iterator[np.ndarray]:
    """Sections over all frequencies that the experiments resolve: oscillating ones, and pairs of real poles."""
    lowest = min(float(-np.angle(each.lag[0])) for each in problem.experiments)
    for frequency in np.geomspace(min(2 * lowest, 0.1), _HIGHEST, _FREQUENCIES):
        if size == 1:
            yield np.array([-np.exp(-frequency)])
            continue
        for damping in _DAMPINGS:
            pole = np.exp(frequency * (-damping + 1j * np.sqrt(1 - damping**2)))
            yield np.array([-2 * pole.real, abs(pole) ** 2])
        slow, fast = np.exp(-frequency), np.exp(-3 * frequency)
        yield np.array([-(slow + fast), slow * fast])

"""The search for a plant: input delay, feedthrough and poles, each candidate judged by its simulation error.

All but the last steps use a part of the lines.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from archerfish.identification.axis.delay_walk import Walk, walk_delays
from archerfish.identification.axis.informative_lines import telling_lines
from archerfish.identification.axis.late_response import later_delay
from archerfish.identification.axis.log_ground import Ground, prepare_ground
from archerfish.identification.axis.pole_pursuit import pursue_poles
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_all, refine_poles
from archerfish.identification.axis.starting_points import distinct, first_guesses, unlike
from archerfish.identification.axis.structure_choice import (
    Structure,
    checked_structure,
    fitted_structure,
    ranked_structures,
)
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_LINES, _FEW_LINES = 1000, 400
_STARTS = 6
_QUIETER = 0.5
_ROUGH, _SEARCH = Effort(1.0, 4), Effort(0.1, 15)
_RIVALS = 2
_DISPROOF = 1e-6
"""Chance that noise makes a recording from rest look like one in motion."""


class Found(NamedTuple):
    """What a search found."""

    best: Structure
    """The likeliest structure and its fit, of outputs in units of `scale`."""
    others: tuple[Structure, ...]
    """Other structures that the recordings leave open."""
    delays: tuple[int, int]
    """Shortest and longest delay that the recordings don't reject at 95 % [samples]."""
    later: int | None
    """A delay beyond the longest allowed that explains the recordings clearly better, if there is one [samples]."""
    ground: Ground
    """All lines of the recordings, for the same samples whatever the order."""
    criteria: tuple[float, ...] = ()
    """Information criterion of the best structure and the others, where they were held against other orders."""
    delay_weights: Mapping[int, float] = MappingProxyType({})
    """How likely each delay is, likewise."""


def search_plant(
    recordings: Sequence[Recording],
    order: int,
    max_delay: int,
    scale: Array,
    feedthrough: bool = True,
    *,
    drift: bool = False,
) -> Found:
    """Find the structure that explains the recordings best for its number of parameters (BIC), and its fit.

    Args:
      recordings: m inputs and p outputs each (m or p is 1).
      order: number of poles.
      max_delay: longest delay that is tried [samples].
      scale: what the squared errors of each output are measured in, shape (p,).
      feedthrough: whether the outputs may answer at once, once the delay is over.
      drift: whether the outputs drift, whatever the inputs.
    """
    ground = prepare_ground(recordings, max_delay, scale)
    ground = ground.drifting() if drift else ground
    walk, rivals = _walk(ground, order, max_delay)
    moving = _moving_at_once(walk, ground)
    if any(moving):
        ground = ground.freed(moving, max_delay)
        walk, rivals = _walk(ground, order, max_delay)
    sketches = ranked_structures(walk, feedthrough)
    longest = max(each.delay for each in sketches)
    if max(ground.skips) > longest:
        walk = _with_all_samples(walk, ground.reaching_back(longest))
    strength, best = checked_structure(sketches[0], rivals, walk)
    structures = [best, *(fitted_structure(each, strength, walk) for each in sketches[1:])]
    colour = walk.colour()
    structures.sort(key=lambda each: each.criterion(colour))
    range_95 = walk.undecided(0.95)
    delays = min(range_95[0], structures[0].delay), max(range_95[-1], structures[0].delay)
    guesses = [structures[0].refinement.sections, *(each.sections for each in rivals)]
    later = later_delay(walk, ground, guesses, max_delay)
    return Found(structures[0], tuple(structures[1:]), delays, later, ground)


def _moving_at_once(walk: Walk, ground: Ground) -> list[bool]:
    """Tell of each recording that seemed to begin at rest whether a free initial state explains it clearly better.

    A held input and a noisy output can look like rest for some samples.
    """
    problem, sketch = walk.problem(walk.delay), walk.sketches[walk.delay]
    moving = []
    for index, at_rest in enumerate(ground.from_rest):
        if not at_rest:
            moving.append(False)
            continue
        experiments = list(problem.experiments)
        experiments[index] = experiments[index]._replace(rest=None)
        freed = refine_poles(sketch.sections, problem._replace(experiments=experiments), _SEARCH)
        rows = sketch.fit.residuals.size / max(1.0, walk.colour())
        gained = rows * float(np.log(max(sketch.cost, walk.rounding()) / max(freed.cost, walk.rounding())))
        moving.append(gained > float(chdtri(sketch.fit.numerators[:, 0].size, _DISPROOF)))
    return moving


def _with_all_samples(walk: Walk, ground: Ground) -> Walk:
    """Let the last fits see what of the recordings only longer delays would have needed as a past."""
    lines = telling_lines(Problem(ground.spectra(walk.delay), True), walk.sketches[walk.delay])
    return walk._replace(whole=cache(ground._replace(lines=lines).spectra))


def _walk(ground: Ground, order: int, max_delay: int) -> tuple[Walk, Sequence[Refinement]]:
    """Walk over the delays, from better beginnings until none is left; return the optima there without prior, too."""
    few = ground.thinned(_FEW_LINES)
    starts = first_guesses(few, order, max_delay)
    delay = min(starts, key=lambda each: each.cost).delay
    rough = Problem(few.spectra(delay), True)
    sketched = refine_all([*distinct(starts, delay, _STARTS), *pursue_poles(rough, order)], rough, _ROUGH)
    near = unlike(sketched, _RIVALS)
    while True:
        rivals = refine_all(near, Problem(ground.thinned(_LINES).spectra(delay), True), _SEARCH)
        walk = walk_delays(ground, starts, rivals, delay, max_delay)
        if walk.delay == delay or walk.sketches[walk.delay].fit.misfit > _QUIETER * walk.misfit:
            return walk, rivals
        # What was taken for noise came of the wrong delay, and made the prior too strong: again, from the better one.
        delay, near = walk.delay, [walk.sketches[walk.delay].sections, *(each.sections for each in rivals)]

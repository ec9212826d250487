"""The choice of delay and feedthrough, by Bayes's information criterion, and the structures that it leaves open."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.delay_walk import NEAR, Walk, rounding
from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.out_of_band import after_delay, scaled_penalty
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_all, refine_poles
from archerfish.identification.axis.prior_strength import WEAKER, largest_misfit, strongest_accepted
from archerfish.identification.axis.spectra import row_count
from archerfish.identification.axis.starting_points import unlike

_SKETCH, _FIT, _SEARCH, _FINISH = Effort(1.0, 6), Effort(0.3, 8), Effort(0.1, 15), Effort(0.01, 40)
_RIVALS = 2
_MOST_OPEN = 8
"""Structures that are fitted to all lines at most."""
_UNLIKELY = 2 * np.log(300.0)
"""Difference of the criterion from which a structure is not looked at any further."""


class Structure(NamedTuple):
    """A delay, with or without feedthrough, and its fit."""

    delay: int
    """Input delay [samples]."""
    problem: Problem
    """What was fitted: lines, whether D was estimated, and the prior."""
    refinement: Refinement
    """Poles and linear parameters."""

    def criterion(self, inflation: float = 1.0) -> float:
        """Return Bayes's information criterion.

        Args:
          inflation: variance of the parameters over what it were with white residuals; so many rows count as one.
        """
        experiments, fit = self.problem.experiments, self.refinement.fit
        rows = row_count(experiments) * experiments[0].outputs.shape[1] / max(1.0, inflation)
        # Without noise, all structures that hold the plant fit to rounding, which must not choose among them.
        deviance: float = rows * float(np.log(max(self.refinement.cost, rounding(experiments))))
        return deviance + float(self.problem.feedthrough * fit.feedthrough.size * np.log(rows))


def ranked_structures(walk: Walk, feedthrough: bool = True) -> list[Structure]:
    """Return the structures between which a part of the lines can't decide, the likeliest first, at least one.

    Args:
      walk: sketches at the delays.
      feedthrough: whether structures with feedthrough are among them.
    """
    sketched = [each for each in _sketched(walk) if feedthrough or not each.problem.feedthrough]
    colour = walk.colour()
    least = min(each.criterion(colour) for each in sketched)
    # Of structures that are equally good the one of the shorter delay: sorting keeps their order.
    ranked = sorted(sketched, key=lambda each: round(each.criterion(colour) - least, 6))
    return [each for each in ranked if each.criterion(colour) - least <= _UNLIKELY][:_MOST_OPEN]


def _sketched(walk: Walk) -> Iterator[Structure]:
    for delay in walk.undecided():
        sketch = walk.sketches[delay]
        without = walk.problem(delay, feedthrough=False)
        yield Structure(delay, without, refine_poles(sketch.sections, without, _SKETCH))
        yield Structure(delay, walk.problem(delay), sketch)


def checked_structure(sketch: Structure, rivals: Sequence[Refinement], walk: Walk) -> tuple[float, Structure]:
    """Fit a structure to all lines, hold it against other optima there, and weaken the prior until they accept it.

    Args:
      sketch: the structure, fitted to a part of the lines.
      rivals: optima without prior on a part of the lines, where the order of merit may be another.
      walk: the prior, and the strength that the sketch was found with.

    Returns:
      Strength of the prior, and the fit.
    """
    prior, strength = after_delay(walk.prior, sketch.delay), walk.strength
    problem = Problem(walk.whole(sketch.delay), sketch.problem.feedthrough)
    begun = refine_poles(sketch.refinement.sections, problem._replace(penalty=sketch.problem.penalty), _SKETCH)
    free = refine_all([begun.sections, *_worth_a_try(rivals, begun, problem)], problem, _SEARCH)[0]
    refined = free
    if strength:
        held = refine_poles(begun.sections, problem._replace(penalty=sketch.problem.penalty), _SEARCH)
        if held.fit.misfit <= largest_misfit(free, problem):
            refined = held
        else:
            strength, refined = strongest_accepted(free, [], problem, prior, _SEARCH, WEAKER * strength)
    problem = problem._replace(penalty=scaled_penalty(prior, strength) if strength else None)
    return strength, Structure(sketch.delay, problem, refine_poles(refined.sections, problem, _FINISH))


def _worth_a_try(rivals: Sequence[Refinement], begun: Refinement, problem: Problem) -> list[Sections]:
    """Return the other optima that are not clearly worse on all lines than the fit."""
    bench = lay_out(*problem)
    others = unlike([begun, *rivals], 1 + _RIVALS)[1:]
    return [each for each in others if solve(each, bench).fit.misfit <= NEAR * begun.fit.misfit]


def fitted_structure(sketch: Structure, strength: float, walk: Walk) -> Structure:
    """Fit a structure to all lines, under a prior of given strength."""
    penalty = scaled_penalty(after_delay(walk.prior, sketch.delay), strength) if strength else None
    problem = Problem(walk.whole(sketch.delay), sketch.problem.feedthrough, penalty)
    return Structure(sketch.delay, problem, refine_poles(sketch.refinement.sections, problem, _FIT))

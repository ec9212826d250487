"""The walk over the delays: fits with feedthrough on a part of the lines, from one delay to the next.

A plant of delay d without feedthrough is contained in those of delay d and d + 1 with it, so that with feedthrough no
candidate is much worse than its neighbours for want of a parameter. The walk finds the best delay and all those about
which the recordings are not clearly of another opinion.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from archerfish.identification.axis.informative_lines import telling_lines
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.out_of_band import after_delay, out_of_band_prior, scaled_penalty
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_all, refine_poles
from archerfish.identification.axis.prior_strength import strongest_accepted
from archerfish.identification.axis.simulation_fit import Penalty
from archerfish.identification.axis.spectra import Spectrum
from archerfish.identification.axis.starting_points import Start, best_cost, distinct

_LINES = 1000
_CLEARLY = 0.999
_HOPELESS = 2.0
NEAR = 1.1
"""Cost over that of the best fit up to which another optimum may turn out the better one on other terms."""
_ROUGH, _SKETCH, _SEARCH = Effort(1.0, 4), Effort(1.0, 6), Effort(0.1, 15)


class Walk(NamedTuple):
    """Fits with feedthrough at the delays tried."""

    delay: int
    """The best of them [samples]."""
    sketches: dict[int, Refinement]
    """Delay → fit to a part of the lines."""
    misfit: float
    """Sum of squares without prior where the walk began."""
    part: Callable[[int], list[Spectrum]]
    """Delay → a part of the telling lines."""
    whole: Callable[[int], list[Spectrum]]
    """Delay → all telling lines."""
    prior: Penalty
    """At full strength."""
    strength: float
    """That the data accept; zero if none."""

    def penalty(self, delay: int) -> Penalty | None:
        """Return the prior for a delay, as strong as the data accept it."""
        return scaled_penalty(after_delay(self.prior, delay), self.strength) if self.strength else None

    def problem(self, delay: int, feedthrough: bool = True) -> Problem:
        """Return the problem of a sketch."""
        return Problem(self.part(delay), feedthrough, self.penalty(delay))

    def rounding(self) -> float:
        """Return a cost below which rounding tells fits apart, and nothing else."""
        return rounding(self.part(self.delay))

    def colour(self) -> float:
        """Return the residual's power where the response is loud over its mean: above one, costs differ by more."""
        return colour(self.problem(self.delay), self.sketches[self.delay])

    def allowed(self, chance: float = _CLEARLY) -> float:
        """Return the cost up to which a delay is not clearly worse than the best."""
        fit = self.sketches[self.delay].fit
        # Poles and zeros that are loosely known make up for a sample more or less: as many parameters move with it.
        excess = float(chdtri(len(fit.numerators), 1 - chance)) * max(1.0, self.colour()) / fit.residuals.size
        return max(self.sketches[self.delay].cost, self.rounding()) * float(np.exp(excess))

    def undecided(self, chance: float = _CLEARLY) -> list[int]:
        """Return the delays tried that are not clearly worse than the best, in order."""
        limit = self.allowed(chance)
        return sorted(each for each, sketch in self.sketches.items() if sketch.cost <= limit)


def rounding(experiments: Sequence[Spectrum]) -> float:
    """Return a cost below which rounding tells fits apart, and nothing else."""
    return 1e-16 * sum(float(np.sum(np.abs(each.outputs) ** 2)) for each in experiments)


def colour(problem: Problem, refinement: Refinement) -> float:
    """Return the residual's power where the response is loud over its mean power."""
    outputs = np.concatenate([each.outputs for each in problem.experiments])
    lines, count = len(outputs), outputs.shape[1]
    stacked = refinement.fit.residuals.reshape(count, -1)
    starts = np.cumsum([0, *(2 * each.lag.size for each in problem.experiments)])
    residual = np.empty((lines, count), np.complex128)
    for begin, stop in pairwise(starts.tolist()):
        real, imaginary = np.split(stacked[:, begin:stop].T, 2)
        residual[begin // 2 : stop // 2] = real + 1j * imaginary
    power, loudness = np.abs(residual) ** 2, np.abs(outputs - residual) ** 2
    total = float(np.sum(power.mean(axis=0) * loudness.sum(axis=0)))
    return float(np.sum(power * loudness)) / total if total > 0 else 1.0


def walk_delays(
    ground: Ground, starts: Sequence[Start], rivals: Sequence[Refinement], begin: int, max_delay: int
) -> Walk:
    """Set up the prior, and sketch fits from one delay to another until none nearby is better.

    Args:
      ground: the recordings.
      starts: guesses at a few delays.
      rivals: fits without prior at the delay `begin`, best first.
      begin: delay to begin with [samples].
      max_delay: longest delay [samples].
    """
    everything = Problem(ground.spectra(begin), True)
    prior = out_of_band_prior(everything, rivals[0])
    ground = ground._replace(lines=telling_lines(everything, rivals[0]))
    part, whole = cache(ground.thinned(_LINES).spectra), cache(ground.spectra)
    problem = Problem(part(begin), True)
    free = refine_poles(rivals[0].sections, problem, _SKETCH)
    near = [each.sections for each in rivals[1:] if each.cost <= NEAR * rivals[0].cost]
    strength, sketch = strongest_accepted(free, near, problem, after_delay(prior, begin), _SEARCH)
    walk = Walk(begin, {begin: sketch}, free.fit.misfit, part, whole, prior, strength)
    for delay in sorted({each.delay for each in starts}, key=lambda each: best_cost(starts, each)):
        if delay != begin and best_cost(starts, delay) < _HOPELESS * best_cost(starts, begin):
            near = [sketch.sections, *distinct(starts, delay, 1)]
            walk.sketches[delay] = refine_all(near, walk.problem(delay), _ROUGH)[0]
    walk = walk._replace(delay=_descend(walk, starts, max_delay))
    for side in (-1, 1):
        _bracket(walk, side, max_delay)
    return walk


def _descend(walk: Walk, starts: Sequence[Start], max_delay: int) -> int:
    """Halve the gaps beside the best delay until both its neighbours are worse, and return it; adds to the sketches."""
    sketches = walk.sketches
    asked: set[tuple[int, int]] = set()
    while True:
        best = min(sketches, key=lambda each: sketches[each].cost)
        below = max((each for each in sketches if each < best), default=-1)
        above = min((each for each in sketches if each > best), default=max_delay + 1)
        middles = {(below + best) // 2, (best + above + 1) // 2, best}
        waiting = [(each, best) for each in middles if 0 <= each <= max_delay and (each, best) not in asked]
        if not waiting:
            return best
        for delay, _ in waiting:
            near = [sketches[best].sections, *distinct(starts, delay, 1)]
            known = [sketches[delay].sections] if delay in sketches and delay != best else []
            sketches[delay] = refine_all([*near, *known], walk.problem(delay), _SEARCH if delay == best else _SKETCH)[0]
        asked.update(waiting)


def _bracket(walk: Walk, side: int, max_delay: int) -> None:
    """Go on to one side, from each delay to the next, until one is clearly worse."""
    limit, delay = walk.allowed(), walk.delay
    while 0 <= delay + side <= max_delay and walk.sketches[delay].cost <= limit:
        near = walk.sketches[delay].sections
        delay += side
        sketch = refine_poles(near, walk.problem(delay), _SKETCH)
        if delay not in walk.sketches or sketch.cost < walk.sketches[delay].cost:
            walk.sketches[delay] = sketch

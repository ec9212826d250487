"""The search for a plant: input delay, feedthrough and poles, each candidate judged by its simulation error.

A plant of delay d without feedthrough is contained in those of delay d and d + 1 with it. So the search goes over the
delay with feedthrough, where no candidate is much worse than its neighbours for want of a parameter, and asks at the
end whether the feedthrough is needed. All but the last steps use a part of the lines.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from archerfish.identification.axis.informative_lines import telling_lines, thinning
from archerfish.identification.axis.initial_poles import initial_poles
from archerfish.identification.axis.lag_factor import factor_lags
from archerfish.identification.axis.modal_form import Sections, free_numbers, sections_from_poles, stabilised
from archerfish.identification.axis.normal_equations import Bench, lay_out, solve
from archerfish.identification.axis.out_of_band import after_delay, out_of_band_prior, scaled_penalty
from archerfish.identification.axis.pole_pursuit import pursue_poles
from archerfish.identification.axis.pole_refinement import Effort, Problem, Refinement, refine_all, refine_poles
from archerfish.identification.axis.prior_strength import WEAKER, largest_misfit, strongest_accepted
from archerfish.identification.axis.simulation_fit import Penalty
from archerfish.identification.axis.spectra import Spectrum, picked, row_count, spectrum, unsettled, with_delay
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_DELAYS = (0, 1, 2, 4, 8, 14, 20, 30, 50)
_LINES, _FEW_LINES = 1000, 400
_STARTS = 6
_SAME_START = 0.05
_CLEARLY = 0.999
_HOPELESS = 2.0
_QUIETER = 0.5
_ROUGH, _SKETCH, _SEARCH, _FINISH = Effort(1.0, 4), Effort(1.0, 6), Effort(0.1, 15), Effort(0.01, 40)
_RIVALS = 2


class Found(NamedTuple):
    """What a search found."""

    delay: int
    """Input delay [samples]."""
    problem: Problem
    """What was fitted: the telling lines, whether D was estimated, and the prior as strong as the data accept it."""
    refinement: Refinement
    """Poles and linear parameters, of outputs in units of `scale`."""
    sketches: dict[int, float]
    """Delay [samples] → penalised sum of squares of its sketch over the thinned lines."""
    sketch_rows: int
    """Number of squares in it."""


class _Start(NamedTuple):
    cost: float
    delay: int
    sections: Sections


class _Ground(NamedTuple):
    """The recordings, ready for any delay."""

    recordings: Sequence[Recording]
    undelayed: Sequence[Spectrum]
    skips: Sequence[int]
    """Samples that are left out at the beginning, per recording."""
    lines: Sequence[NDArray[np.intp]]
    """Lines to look at, per recording."""

    def spectra(self, delay: int) -> list[Spectrum]:
        """Spectra with the inputs delayed."""
        logs = zip(self.undelayed, self.recordings, self.skips, self.lines, strict=True)
        return [picked(with_delay(spectrum, log, delay, skip), lines) for spectrum, log, skip, lines in logs]

    def thinned(self, count: int) -> "_Ground":
        """Only so many lines, as do for a search."""
        kept = thinning(self.spectra(0), count)
        return self._replace(lines=[lines[each] for lines, each in zip(self.lines, kept, strict=True)])


class _Walk(NamedTuple):
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

    def problem(self, delay: int) -> Problem:
        """Return the problem of a sketch."""
        return Problem(self.part(delay), True, self.penalty(delay))


def search_plant(recordings: Sequence[Recording], order: int, max_delay: int, scale: Array) -> Found:
    """Find the structure that explains the recordings best for its number of parameters (BIC), and its fit.

    Args:
      recordings: m inputs and p outputs each (m or p is 1).
      order: number of poles.
      max_delay: longest delay that is tried [samples].
      scale: what the squared errors of each output are measured in, shape (p,).
    """
    skips = [unsettled(each.inputs, max_delay) for each in recordings]
    undelayed = [spectrum(each, 0, scale, skip) for each, skip in zip(recordings, skips, strict=True)]
    ground = _Ground(recordings, undelayed, skips, [np.arange(each.lag.size) for each in undelayed])
    starts, delay = _starts(ground, order, max_delay)
    rough = Problem(ground.thinned(_FEW_LINES).spectra(delay), True)
    sketched = refine_all([*_distinct(starts, delay, _STARTS), *pursue_poles(rough, order)], rough, _ROUGH)
    near = _unlike(sketched, _RIVALS)
    while True:
        rivals = refine_all(near, Problem(ground.thinned(_LINES).spectra(delay), True), _SEARCH)
        walk = _walk(ground, starts, rivals, delay, max_delay)
        if walk.delay == delay or walk.sketches[walk.delay].fit.misfit > _QUIETER * walk.misfit:
            return _checked(_structured(walk), rivals, walk)
        # What was taken for noise came of the wrong delay, and made the prior too strong: again, from the better one.
        delay, near = walk.delay, [walk.sketches[walk.delay].sections, *(each.sections for each in rivals)]


def _walk(ground: _Ground, starts: Sequence[_Start], rivals: Sequence[Refinement], begin: int, max_delay: int) -> _Walk:
    """Set up the prior, and sketch fits from one delay to another until none nearby is better."""
    everything = Problem(ground.spectra(begin), True)
    prior = out_of_band_prior(everything, rivals[0])
    ground = ground._replace(lines=telling_lines(everything, rivals[0]))
    part, whole = cache(ground.thinned(_LINES).spectra), cache(ground.spectra)
    problem = Problem(part(begin), True)
    free = refine_poles(rivals[0].sections, problem, _SKETCH)
    near = [each.sections for each in rivals[1:]]
    strength, sketch = strongest_accepted(free, near, problem, after_delay(prior, begin), _SEARCH)
    walk = _Walk(begin, {begin: sketch}, free.fit.misfit, part, whole, prior, strength)
    for delay in sorted({each.delay for each in starts}, key=lambda each: _best_cost(starts, each)):
        if delay != begin and _best_cost(starts, delay) < _HOPELESS * _best_cost(starts, begin):
            near = [sketch.sections, *_distinct(starts, delay, 1)]
            walk.sketches[delay] = refine_all(near, walk.problem(delay), _ROUGH)[0]
    walk = walk._replace(delay=_descend(walk, starts, max_delay))
    for side in (-1, 1):
        _bracket(walk, side, max_delay)
    return walk


def _starts(ground: _Ground, order: int, max_delay: int) -> tuple[list[_Start], int]:
    """First guesses and the delay that suits one of them best."""
    delays = [each for each in _DELAYS if each <= max_delay]
    guesses = initial_poles(factor_lags(_without_units(ground.recordings), order), order, delays)
    few = ground.thinned(_FEW_LINES)
    benches = {delay: lay_out(few.spectra(delay), True) for delay in delays}
    starts = [_scored(delay, sections_from_poles(stabilised(poles)), benches[delay]) for delay, poles in guesses]
    return starts, min(starts, key=lambda each: each.cost).delay


def _without_units(recordings: Sequence[Recording]) -> list[Recording]:
    """Scale every signal to about the size one, alike in all recordings, so that the guesses don't depend on units."""
    inputs, outputs = (
        np.concatenate([signals - signals.mean(axis=0) for signals in each]).std(axis=0)
        for each in ([one.inputs for one in recordings], [one.outputs for one in recordings])
    )
    return [replace(each, inputs=each.inputs / inputs, outputs=each.outputs / outputs) for each in recordings]


def _scored(delay: int, sections: Sections, bench: Bench) -> _Start:
    return _Start(solve(sections, bench).fit.cost, delay, sections)


def _best_cost(starts: Sequence[_Start], delay: int) -> float:
    return min((each.cost for each in starts if each.delay == delay), default=np.inf)


def _distinct(starts: Sequence[_Start], delay: int, count: int) -> list[Sections]:
    """Return the best starts for the nearest delay that differ from one another."""
    nearest = min({each.delay for each in starts}, key=lambda each: abs(each - delay))
    return _unlike(sorted((each for each in starts if each.delay == nearest), key=lambda each: each.cost), count)


def _unlike(guesses: Iterable[_Start | Refinement], count: int) -> list[Sections]:
    """Return the first few poles that differ from one another; alike ones lead to the same minimum."""
    kept: list[Sections] = []
    for guess in guesses:
        numbers = free_numbers(guess.sections)
        if not any(_alike(numbers, free_numbers(other)) for other in kept):
            kept.append(guess.sections)
    return kept[:count]


def _alike(one: Array, other: Array) -> bool:
    return one.shape == other.shape and float(np.abs(one - other).max()) < _SAME_START


def _descend(walk: _Walk, starts: Sequence[_Start], max_delay: int) -> int:
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
            near = [sketches[best].sections, *_distinct(starts, delay, 1)]
            known = [sketches[delay].sections] if delay in sketches else []
            sketches[delay] = refine_all([*near, *known], walk.problem(delay), _SEARCH if delay == best else _SKETCH)[0]
        asked.update(waiting)


def _bracket(walk: _Walk, side: int, max_delay: int) -> None:
    """Halve the gap to the nearest delay on one side that is clearly worse, so that the range of delays has its end."""
    sketches = walk.sketches
    rows, parameters = sketches[walk.delay].fit.residuals.size, len(sketches[walk.delay].fit.numerators)
    limit = sketches[walk.delay].cost * (1 + chi2.ppf(_CLEARLY, parameters) / rows)
    while True:
        beyond = sorted((each for each in sketches if side * each > side * walk.delay), key=lambda each: side * each)
        worse = next((each for each in beyond if sketches[each].cost > limit), max_delay + 1 if side > 0 else -1)
        inside = next((each for each in reversed(beyond) if side * each < side * worse), walk.delay)
        middle = (inside + worse) // 2
        if middle in (inside, worse) or not 0 <= middle <= max_delay:
            return
        sketches[middle] = refine_poles(sketches[inside].sections, walk.problem(middle), _SKETCH)


def _structured(walk: _Walk) -> Found:
    """Refine the neighbouring structures on all lines, and choose by Bayes's information criterion.

    A longer delay must beat a shorter one by as much as a parameter more.
    """
    delay, sketches = walk.delay, walk.sketches
    costs = {each: sketches[each].cost for each in sorted(sketches)}
    chosen: tuple[float, Found] | None = None
    for tried, feedthrough in ((delay - 1, False), (delay, False), (delay, True)):
        if tried < 0:
            continue
        experiments, penalty = walk.whole(tried), walk.penalty(tried)
        near = [sketches[each].sections for each in dict.fromkeys((delay, tried)) if each in sketches]
        near = [refine_all(near, Problem(walk.part(tried), feedthrough, penalty), _SKETCH)[0].sections]
        refined = refine_poles(near[0], Problem(experiments, feedthrough, penalty), _SKETCH)
        rows = row_count(experiments) * experiments[0].outputs.shape[1]
        # Without noise, all structures that hold the plant fit to rounding, which must not choose among them.
        rounding = 1e-16 * sum(float(np.sum(np.abs(each.outputs) ** 2)) for each in experiments)
        parameters = feedthrough * refined.fit.feedthrough.size
        criterion = rows * np.log(max(refined.cost, rounding)) + parameters * np.log(rows)
        squares = sketches[delay].fit.residuals.size
        found = Found(tried, Problem(experiments, feedthrough, penalty), refined, costs, squares)
        if chosen is None or criterion < chosen[0] - np.log(rows) * (tried > chosen[1].delay):
            chosen = (criterion, found)
    assert chosen is not None  # delay ≥ 0 passes the loop at least twice
    return chosen[1]


def _checked(found: Found, rivals: Sequence[Refinement], walk: _Walk) -> Found:
    """Hold the fit against other optima on all lines, and weaken the prior until all lines accept it.

    Args:
      found: the fit.
      rivals: optima without prior on a part of the lines, where the order of merit may be another.
      walk: the prior, and the strength that the fit was found with.
    """
    prior, strength = after_delay(walk.prior, found.delay), walk.strength
    problem = found.problem._replace(penalty=None)
    free = refine_all([found.refinement.sections, *_unlike(rivals, _RIVALS)], problem, _SEARCH)[0]
    refined = free
    if strength:
        held = refine_poles(found.refinement.sections, found.problem, _SEARCH)
        if held.fit.misfit <= largest_misfit(free, problem):
            refined = held
        else:
            strength, refined = strongest_accepted(free, [], problem, prior, _SEARCH, WEAKER * strength)
    problem = problem._replace(penalty=scaled_penalty(prior, strength) if strength else None)
    return found._replace(refinement=refine_poles(refined.sections, problem, _FINISH), problem=problem)

"""Where a search over the poles begins: guesses of them, judged by the simulation error on a few lines."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.initial_poles import initial_poles
from archerfish.identification.axis.lag_factor import factor_lags
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.modal_form import Sections, free_numbers, sections_from_poles, stabilised
from archerfish.identification.axis.normal_equations import Bench, lay_out, solve
from archerfish.identification.axis.pole_refinement import Refinement
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

_DELAYS = (0, 1, 2, 4, 8, 14, 20, 30, 50)
_SAME_START = 0.05


class Start(NamedTuple):
    """A guess."""

    cost: float
    """Sum of squared simulation errors."""
    delay: int
    """Delay that it was made for [samples]."""
    sections: Sections
    """Its poles."""


def first_guesses(few: Ground, order: int, max_delay: int) -> list[Start]:
    """Return guesses at a few delays, each with its simulation error.

    Args:
      few: the lines to judge them by.
      order: number of poles.
      max_delay: longest delay [samples].
    """
    delays = [each for each in _DELAYS if each <= max_delay]
    guesses = initial_poles(factor_lags(_without_units(few.recordings), order), order, delays)
    benches = {delay: lay_out(few.spectra(delay), True) for delay in delays}
    return [_scored(delay, sections_from_poles(stabilised(poles)), benches[delay]) for delay, poles in guesses]


def _without_units(recordings: Sequence[Recording]) -> list[Recording]:
    """Scale every signal to about the size one, alike in all recordings, so that the guesses don't depend on units."""
    inputs, outputs = (
        np.concatenate([signals - signals.mean(axis=0) for signals in each]).std(axis=0)
        for each in ([one.inputs for one in recordings], [one.outputs for one in recordings])
    )
    return [replace(each, inputs=each.inputs / inputs, outputs=each.outputs / outputs) for each in recordings]


def _scored(delay: int, sections: Sections, bench: Bench) -> Start:
    return Start(solve(sections, bench).fit.cost, delay, sections)


def best_cost(starts: Sequence[Start], delay: int) -> float:
    """Return the least cost of the guesses for a delay, infinite if there are none."""
    return min((each.cost for each in starts if each.delay == delay), default=np.inf)


def distinct(starts: Sequence[Start], delay: int, count: int) -> list[Sections]:
    """Return the best guesses for the nearest delay that differ from one another."""
    nearest = min({each.delay for each in starts}, key=lambda each: abs(each - delay))
    return unlike(sorted((each for each in starts if each.delay == nearest), key=lambda each: each.cost), count)


def unlike(guesses: Iterable[Start | Refinement], count: int) -> list[Sections]:
    """Return the first few poles that differ from one another; alike ones lead to the same minimum."""
    kept: list[Sections] = []
    for guess in guesses:
        numbers = free_numbers(guess.sections)
        if not any(_alike(numbers, free_numbers(other)) for other in kept):
            kept.append(guess.sections)
    return kept[:count]


def _alike(one: Array, other: Array) -> bool:
    return one.shape == other.shape and float(np.abs(one - other).max()) < _SAME_START

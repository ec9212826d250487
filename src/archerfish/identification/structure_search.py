"""Choice of the input delay and of a direct feedthrough, each candidate fitted and judged by its simulation error.

A plant of delay d without feedthrough is contained in those of delay d and d + 1 with it. So the search walks over the
delay with feedthrough, where no candidate is much worse than its neighbours for want of a parameter, and asks at the
end whether the feedthrough is needed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from archerfish.identification.arx import fit_arx, impulse_responses, initial_poles, response_length
from archerfish.identification.frequency import beyond_band
from archerfish.identification.modal_form import (
    Sections,
    free_numbers,
    section_poles,
    sections_from_poles,
    stabilised,
)
from archerfish.identification.pole_refinement import Refinement, refine_poles
from archerfish.identification.simulation_fit import Structure, fit_linear_parameters
from archerfish.records.recording import Recording

_STARTS = 2
_SAME_START = 0.05
_SKETCH_GAIN = 1e-4
_RINGING = 0.98


class Start(NamedTuple):
    """A first guess of the poles, scored."""

    cost: float
    """Sum of squared simulation errors."""
    delay: int
    """Input delay that it was scored with [samples]."""
    sections: Sections
    """The poles."""


def score_starts(recordings: Sequence[Recording], order: int, max_delay: int) -> list[Start]:
    """Score first guesses of the poles for every delay, best first.

    Args:
      recordings: m inputs and one output each.
      order: number of poles.
      max_delay: longest delay [samples].
    """
    direct = np.roots(fit_arx(recordings, order).a).astype(np.complex128)
    responses = impulse_responses(recordings, order, response_length(max_delay))
    starts = []
    for delay in range(max_delay + 1):
        for poles in (direct, *initial_poles(responses, order, delay)):
            sections = sections_from_poles(stabilised(poles))
            fit = fit_linear_parameters(sections, recordings, Structure(delay, True), with_slopes=False)
            starts.append(Start(fit.cost, delay, sections))
    return sorted(starts, key=lambda start: start.cost)


def search_structure(
    recordings: Sequence[Recording], starts: Sequence[Start], band_hz: tuple[float, float]
) -> tuple[Structure, Refinement]:
    """Find the structure that explains the recordings best for its number of parameters (BIC), and its fit.

    A longer delay must beat a shorter one by as much as a parameter more.

    Args:
      recordings: m inputs and one output each.
      starts: from `score_starts`.
      band_hz: frequencies that the inputs excite [Hz].
    """
    samples = sum(len(recording) for recording in recordings)
    inputs = recordings[0].inputs.shape[1]
    # Without noise, all structures that hold the plant fit to rounding, which must not choose among them.
    rounding = 1e-16 * sum(float(np.sum((each.outputs - each.outputs.mean()) ** 2)) for each in recordings)
    delay, sketch = _walk(recordings, starts)
    chosen: tuple[float, Structure, Refinement] | None = None
    for structure in (Structure(delay - 1, False), Structure(delay, False), Structure(delay, True)):
        if structure.delay < 0:
            continue
        nearest = [sketch.sections, *_nearest(starts, structure.delay)]
        refined = [refine_poles(each, recordings, structure) for each in nearest]
        refinement = min(refined, key=lambda each: (_rings(each, band_hz, recordings[0].sample_period_s), _cost(each)))
        deviance = samples * np.log(max(_cost(refinement), rounding))
        criterion = deviance + structure.feedthrough * inputs * np.log(samples)
        if chosen is None or criterion < chosen[0] - np.log(samples) * (structure.delay > chosen[1].delay):
            chosen = (criterion, structure, refinement)
    assert chosen is not None  # delay ≥ 0 passes the loop at least twice
    return chosen[1], chosen[2]


def _walk(recordings: Sequence[Recording], starts: Sequence[Start]) -> tuple[int, Refinement]:
    """Walk from the delay that the first guesses favour, and from none, to a delay that beats both its neighbours."""
    longest = max(start.delay for start in starts)
    sketches = {0: _sketch(recordings, starts, 0, [])}
    waiting = [starts[0].delay]
    while waiting:
        best = min(sketches, key=lambda delay: _cost(sketches[delay]))
        sketches[waiting[0]] = _sketch(recordings, starts, waiting[0], [sketches[best].sections])
        best = min(sketches, key=lambda delay: _cost(sketches[delay]))
        waiting = [each for each in (best - 1, best + 1) if 0 <= each <= longest and each not in sketches]
    return best, sketches[best]


def _sketch(recordings: Sequence[Recording], starts: Sequence[Start], delay: int, known: list[Sections]) -> Refinement:
    """Refine roughly, from the best first guesses for a delay and from poles that are known from another."""
    structure = Structure(delay, True)
    nearest = [*known, *_nearest(starts, delay)]
    tried = (refine_poles(each, recordings, structure, smallest_gain=_SKETCH_GAIN) for each in nearest)
    return min(tried, key=_cost)


def _nearest(starts: Sequence[Start], delay: int) -> list[Sections]:
    """Return the best starts for a delay that differ from one another; alike ones lead to the same minimum."""
    kept: list[Sections] = []
    for start in starts:
        numbers = free_numbers(start.sections)
        alike = any(np.abs(numbers - free_numbers(other)).max() < _SAME_START for other in kept)
        if start.delay == delay and not alike:
            kept.append(start.sections)
    return kept[:_STARTS]


def _rings(refinement: Refinement, band_hz: tuple[float, float], sample_period_s: float) -> bool:
    """Tell whether a mode rings on above the excited band: it follows a burst of noise by its initial state."""
    poles = section_poles(refinement.sections)
    return bool(np.any(beyond_band(poles, band_hz, sample_period_s) & (np.abs(poles) > _RINGING)))


def _cost(refinement: Refinement) -> float:
    return refinement.fit.cost

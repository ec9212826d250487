"""Does the response come later than the longest delay that was allowed? Then nothing found up to there is right."""

from collections.abc import Sequence

import numpy as np

from archerfish.identification.axis.delay_walk import Walk
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.modal_form import Sections
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_poles

_LINES = 400
_FURTHER = 4
"""Multiple of the longest delay up to which a look is taken."""
_LEAST = 40
"""Samples beyond which a look is taken even if hardly any delay was allowed."""
_GRID = 24
_TRIED = 3
_WORTH = 30.0
"""Twice the log likelihood that a later response must gain: noise alone gains so much in one log of 10⁵."""
_SKETCH = Effort(1.0, 8)


def later_delay(walk: Walk, ground: Ground, guesses: Sequence[Sections], max_delay: int) -> int | None:
    """Return a delay beyond the longest allowed that explains the recordings clearly better than any shorter one.

    Only where the recordings leave open the longest allowed.

    Args:
      walk: over the delays allowed.
      ground: the recordings.
      guesses: poles to look with.
      max_delay: longest delay allowed [samples].
    """
    shortest = min(len(each) for each in ground.recordings)
    furthest = min(max(_FURTHER * max_delay, _LEAST), shortest // 4)
    if walk.undecided()[-1] < max_delay or furthest <= max_delay:
        return None
    few = ground.thinned(_LINES)
    delays = np.unique(np.linspace(max_delay + 1, furthest, _GRID).round().astype(int)).tolist()
    costs = {each: _cost(few, each, guesses) for each in delays}
    here = Problem(few.spectra(walk.delay), True)
    known = refine_poles(walk.sketches[walk.delay].sections, here, _SKETCH)
    best: tuple[float, int] = (np.inf, max_delay)
    for delay in sorted(costs, key=lambda each: costs[each][0])[:_TRIED]:
        refined = refine_poles(costs[delay][1], Problem(few.spectra(delay), True), _SKETCH)
        best = min(best, (refined.cost, delay))
    rows = known.fit.residuals.size / max(1.0, walk.colour())
    gained = rows * float(np.log(max(known.cost, walk.rounding()) / max(best[0], walk.rounding())))
    return best[1] if gained > _WORTH else None


def _cost(few: Ground, delay: int, guesses: Sequence[Sections]) -> tuple[float, Sections]:
    bench = lay_out(few.spectra(delay), True)
    return min(((solve(each, bench).fit.cost, each) for each in guesses), key=lambda each: each[0])

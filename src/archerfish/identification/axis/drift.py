"""Does an output drift by itself? A world angle of a gyroscope does, and a slow disturbance looks the same.

A plant without drift follows it with a slow pole: by its transient, or with a steady gain that the input never had.
"""

import numpy as np

from archerfish.identification.axis.delay_walk import rounding
from archerfish.identification.axis.modal_form import Sections, section_poles, sections_from_poles
from archerfish.identification.axis.pole_refinement import Effort, Problem, refine_poles
from archerfish.identification.axis.structure_search import Found

_SHARE = 0.35
"""Share of the residual's power that a slow drift explains, from which the outputs are said to drift."""
_BETTER = 0.75
"""Residual with a drift over that with a slow pole, up to which the drift explains the recordings better."""
_SLOW = 6.0
"""Time constants of a pole that the longest recording holds, up to which a drift can look like it."""
_QUICK = 30.0
"""Factor on the speed of such a pole to look from."""
_EFFORT = Effort(1.0, 8)


def outputs_drift(found: Found) -> bool:
    """Tell whether a slow drift explains much of what the plant leaves, or the recordings better than a slow pole."""
    best, ground = found.best, found.ground
    sections = best.refinement.sections
    without = Problem(ground.spectra(best.delay), best.problem.feedthrough)
    beside = without._replace(experiments=ground.drifting().spectra(best.delay))
    here = max(refine_poles(sections, without, _EFFORT).fit.misfit, rounding(without.experiments))
    if refine_poles(sections, beside, _EFFORT).fit.misfit < (1 - _SHARE) * here:
        return True
    quick = _without_slow_poles(sections, max(len(each) for each in ground.recordings))
    return quick is not None and refine_poles(quick, beside, _EFFORT).fit.misfit < _BETTER * here


def _without_slow_poles(sections: Sections, samples: int) -> Sections | None:
    """Return poles that are none of them slow, None if they are none of them slow already."""
    poles = np.asarray(section_poles(sections), np.complex128)
    slow = -np.log(np.maximum(np.abs(poles), 1e-9)) * samples < _SLOW
    if not slow.any():
        return None
    return sections_from_poles(np.where(slow, np.abs(poles) ** _QUICK * np.exp(1j * np.angle(poles)), poles))

"""Delay, feedthrough and drift at a given order: coarse fits of delays, and the BIC of Whittle's likelihood.

The likelihood takes the residual over the noise's spectrum, which is what the best coarse fit leaves. It compares only
poles that were refitted under its weights.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from archerfish2.identification.axis.log_start import ROUNDING, Table
from archerfish2.identification.axis.noise import noise_power, slow_wander
from archerfish2.identification.axis.output_error import (
    LinearFit,
    cost_of,
    refine,
    refine_best,
    residuals_by_log,
    solve,
)
from archerfish2.identification.axis.sections import Sections, order_of
from archerfish2.identification.axis.spectrum import Experiment, Lines, lines_of, strongest, thinned
from archerfish2.identification.axis.starts import SPREADS, distinct, vector_fit, vector_fits
from archerfish2.identification.simulation import Array, Complex

_GRID = (0, 2, 5, 10, 15, 20)  # delays that are tried first
_SEARCH_LINES, _WHITTLE_LINES = 400, 1500
_CLEARLY = 20.0  # difference by which the pilot's optimum must be better, as out of band it may have fitted noise


class Structure(NamedTuple):
    """What is chosen by the criterion."""

    order: int  # number of poles
    delay: int  # of the inputs [samples]
    feedthrough: bool  # whether inputs act, after the delay, within their own sample
    drift: bool = False  # of the outputs, by a polynomial of third degree


Found = dict[Structure, tuple[float, LinearFit]]
"""Criterion and weighted fit of structures."""


def delay_table(experiments: Sequence[Experiment], order: int, delays: tuple[int, int]) -> Table:
    """Fit some delays on a few lines: a grid, bisected around the best, doubled while the best lies at its end.

    Args:
      experiments: logs.
      order: number of poles.
      delays: least and largest; the same for a delay that is given.
    """
    (lowest, highest), picks, tried = delays, thinned(experiments, _SEARCH_LINES), dict[int, LinearFit]()
    most = max(highest, min(len(e.u) for e in experiments) // 8) if lowest < highest else highest
    waiting = [d for d in _GRID if d <= highest] if lowest < highest else [lowest]
    while waiting:
        for delay in waiting:
            data = lines_of(experiments, picks, delay)
            near = [vector_fit(min(tried.values(), key=cost_of).sections, data, 3)] if tried else []
            extra, spreads = (0, SPREADS[:2]) if tried else (2, SPREADS)
            near = distinct([*near, *vector_fits(data, order, 4, extra, spreads)], 2)
            tried[delay] = refine_best([fit.sections for fit in near], data, 6, 1e-4)
        here = min(tried, key=lambda each: tried[each].cost)
        below = max((delay for delay in tried if delay < here), default=here)
        above = min((delay for delay in tried if delay > here), default=here)
        waiting = sorted({(below + here) // 2, (here + above + 1) // 2} - tried.keys())
        if min(highest, _GRID[-1]) <= here == max(tried) < most:
            waiting.append(min(2 * max(here, 1), most))
    return tried


class Criterion:
    """The BIC of structures under the noise that the best of some pilots leaves.

    Args:
      experiments: logs.
      pilots: coarse fits' poles.
      delay: of the pilots [samples].
      slow: whether the noise may have a slow wander, which else costs a pole.
    """

    def __init__(self, experiments: Sequence[Experiment], pilots: Sequence[Sections], delay: int, slow: bool) -> None:
        self.experiments, self.drifting = experiments, [replace(e, drift=True) for e in experiments]
        self.found: Found = {}
        data = [e.at(delay) for e in experiments]
        best = min((solve(each, data) for each in pilots), key=cost_of)
        both = list(zip(experiments, residuals_by_log(best, data), strict=True))
        least = ROUNDING * np.mean([np.mean(np.abs(e.outputs) ** 2) for e in experiments]) + 1e-300
        squares = [_power(residual) / 2 for _, residual in both]
        smooth = [np.maximum(noise_power(each), slow_wander(each, len(each)) if slow else 0) for each in squares]
        # A rest put before a log adds lines, not information.
        noise = [np.maximum(s, least) * e.length / e.measured for s, e in zip(smooth, experiments, strict=True)]
        responses = [_power(e.outputs - r) / power for (e, r), power in zip(both, noise, strict=True)]
        self._picks, self._weights = strongest(responses, _WHITTLE_LINES), [1 / np.sqrt(power) for power in noise]
        self._rows = sum(e.measured for e in experiments) * len(both[0][1])
        # On a log without noise plain vector fits miss what is small and out of band; those under the weights find it.
        lines = self._lines(Structure(0, delay, True))
        fresh = [fit.sections for fit in vector_fits(lines, order_of(pilots[0]))[:2]]
        fits = [refine(each, lines, 20, 1e-6) for each in (*pilots, *fresh)]
        own = [fit for fit in fits if order_of(fit.sections) == order_of(pilots[0])]
        self._pilots = [*pilots[1:], min(own, key=cost_of).sections, pilots[0]]
        # What is not linear leaves more between the lines of a comb than on them: an octave's mean is too large there.
        least = min(fit.cost / fit.residual.size for fit in fits)
        self._unit = float(np.sqrt(np.clip(least, 0.05, 1.0)))

    def evaluate(self, structure: Structure, near: Sequence[Sections] = ()) -> float:
        """Return the criterion of a structure, its poles refitted.

        Args:
          structure: to evaluate, if it has not been.
          near: poles to start from; vector fits and the pilots if not given.
        """
        if structure not in self.found:
            lines = self._lines(structure)
            same = [each for each in self._pilots if order_of(each) == structure.order]
            near = near or [*(fit.sections for fit in vector_fits(lines, structure.order)[:2]), *same[1:]]
            fit = refine_best(near, lines, 20, 1e-6)
            if same and (other := refine(same[0], lines, 20, 1e-6)).cost < fit.cost - _CLEARLY * self._unit:
                fit = other
            bic = fit.cost / self._unit + self.parameters(structure) * np.log(self._rows)
            self.found[structure] = bic, fit
        return self.found[structure][0]

    def fresh_starts(self, structure: Structure) -> list[Sections]:
        """Return the poles of the two best vector fits of a structure."""
        return [fit.sections for fit in vector_fits(self._lines(structure), structure.order, extra=0)[:2]]

    def parameters(self, structure: Structure) -> int:
        """Return the number of parameters, those of each log's transients and drift among them."""
        m, p, logs = self.experiments[0].u.shape[1], self.experiments[0].y.shape[1], len(self.experiments)
        poles, own = structure.order * (1 + m * p), p * logs * (structure.order + 3 * structure.drift)
        return int(poles + own + structure.feedthrough * m * p)

    def logs(self, structure: Structure) -> list[Experiment]:
        """Return the logs with a drift if the structure has one."""
        return self.drifting if structure.drift else list(self.experiments)

    def _lines(self, structure: Structure) -> list[Lines]:
        logs = self.logs(structure)
        return lines_of(logs, self._picks, structure.delay, structure.feedthrough, self._weights)


def _power(x: Complex) -> Array:
    return np.asarray(np.mean(np.abs(x) ** 2, axis=0))

"""Delay and feedthrough at a given order, by the BIC of Whittle's likelihood.

The likelihood takes the residual over the noise's spectrum, which is what the best coarse fit leaves. It chooses only
between poles that were refitted under its weights; of structures that are about as likely the one of the least plain
sum of squares is preferred.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from archerfish2.identification.axis.log_start import ROUNDING, Table, rounding_floor
from archerfish2.identification.axis.output_error import LinearFit, cost_of, refine_best, residuals_by_log, solve
from archerfish2.identification.axis.sections import Sections, order_of
from archerfish2.identification.axis.spectrum import Experiment, lines_of, strongest, thinned
from archerfish2.identification.axis.starts import SPREADS, distinct, subsets, vector_fit, vector_fits
from archerfish2.identification.simulation import Array, Complex

_GRID = (0, 2, 5, 10, 15, 20)  # delays that are tried first
_SEARCH_LINES, _PLAIN_LINES, _WHITTLE_LINES = 400, 1000, 1500
_CLOSE = 2.0  # difference of the criterion up to which structures are about as likely
_CLEARLY = 20.0  # difference by which the pilot's optimum must be better, as out of band it may have fitted noise
_FARTHEST = 8  # samples that the delay moves from the coarse fits' best one


class Structure(NamedTuple):
    """What is chosen by the criterion."""

    order: int  # number of poles
    delay: int  # of the inputs [samples]
    feedthrough: bool  # whether inputs act, after the delay, within their own sample


Evaluate = Callable[[Structure, list[Sections]], tuple[float, LinearFit]]
"""Gives the criterion and the weighted fit of a structure, from the pilot and poles that are given, or vector fits."""
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
        if highest <= here == max(tried) < most:
            waiting.append(min(2 * max(here, 1), most))
    return tried


def choose_structure(
    experiments: Sequence[Experiment], table: Table, order: int, delays: tuple[int, int], feedthrough: bool
) -> tuple[Structure, list[Sections]]:
    """Return the preferred delay and feedthrough, and sections from which the final fit may start, the likeliest first.

    Args:
      experiments: logs.
      table: coarse fits of the delays.
      order: number of poles.
      delays: least and largest.
      feedthrough: whether the plant may have one.
    """
    coarse = min(table, key=lambda delay: table[delay].cost)
    data = lines_of(experiments, thinned(experiments, _PLAIN_LINES), coarse)
    guesses = [table[coarse], *vector_fits(data, order)[:2]]
    pilot = refine_best([fit.sections for fit in guesses], data, 10, 1e-4).sections
    larger = refine_best([vector_fits(data, order + 2, extra=0)[0].sections], data, 8, 1e-4).sections
    evaluate = _criterion(experiments, pilot, coarse)
    found = _search(evaluate, Structure(order, coarse, False), delays, feedthrough)
    chosen = _preferred(experiments, found, table)
    starts = [found[chosen][1].sections, *(fit.sections for delay, fit in table.items() if delay == chosen.delay)]
    return chosen, [*starts, *subsets(larger, order)]


def noise_power(squares: Array) -> Array:
    """Return a residual's power at each line, smooth over octaves: each counts the next higher one as eight lines more.

    Args:
      squares: of the residual, shape (F,).
    """
    n = len(squares)
    edges = list(dict.fromkeys([0, *(2**k - 1 for k in range(1, int(np.log2(n + 1)) + 1)), n]))
    above, means = squares[n // 2 :].mean(), []
    for low, high in zip(edges[-2::-1], edges[:0:-1], strict=True):
        above = (squares[low:high].sum() + 8 * above) / (high - low + 8)
        means.append(np.log(max(above, 1e-300)))
    centres = [np.log(0.5 * (low + high + 1)) for low, high in pairwise(edges)]
    return np.asarray(np.exp(np.interp(np.log(np.arange(1, n + 1)), centres, means[::-1])))


def _criterion(experiments: Sequence[Experiment], pilot: Sections, delay: int) -> Evaluate:
    """Return the criterion under the noise that a pilot leaves."""
    data = [e.at(delay) for e in experiments]
    both = list(zip(experiments, residuals_by_log(solve(pilot, data), data), strict=True))
    least = ROUNDING * np.mean([np.mean(np.abs(e.outputs) ** 2) for e in experiments]) + 1e-300
    # A rest put before a log adds lines, not information.
    noise = [np.maximum(noise_power(_power(r) / 2), least) * e.length / e.measured for e, r in both]
    responses = [_power(e.outputs - r) / power for (e, r), power in zip(both, noise, strict=True)]
    picks = strongest(responses, _WHITTLE_LINES)
    rows, weights = sum(e.measured for e in experiments) * len(both[0][1]), [1 / np.sqrt(power) for power in noise]
    # On a log without noise plain vector fits miss what is small and out of band; those under the weights find it.
    data = lines_of(experiments, picks, delay, weights=weights)
    best = refine_best([pilot, *(fit.sections for fit in vector_fits(data, order_of(pilot))[:2])], data, 20, 1e-6)
    # What is not linear leaves more between the lines of a comb than on them: an octave's mean is too large there.
    unit = float(np.sqrt(np.clip(best.cost / best.residual.size, 0.05, 1.0)))

    def evaluate(structure: Structure, near: list[Sections]) -> tuple[float, LinearFit]:
        data = lines_of(experiments, picks, structure.delay, structure.feedthrough, weights)
        near = near or [*(fit.sections for fit in vector_fits(data, structure.order)[:2]), pilot]
        found, other = refine_best(near, data, 20, 1e-6), refine_best([best.sections], data, 20, 1e-6)
        found = other if other.cost < found.cost - _CLEARLY * unit else found
        return found.cost / unit + _parameters(experiments, structure) * np.log(rows), found

    return evaluate


def _power(x: Complex) -> Array:
    return np.asarray(np.mean(np.abs(x) ** 2, axis=0))


def _parameters(experiments: Sequence[Experiment], structure: Structure) -> int:
    m, p = experiments[0].u.shape[1], experiments[0].y.shape[1]
    return int(structure.order * (1 + m * p + p * len(experiments)) + structure.feedthrough * m * p)


def _search(evaluate: Evaluate, start: Structure, delays: tuple[int, int], feedthrough: bool) -> Found:
    """Walk to the best delay, then try the feedthrough there and a sample later."""
    lowest, highest = delays
    # The coarse fits have a feedthrough, so that without one the delay is a sample shorter.
    at = start = start._replace(delay=max(start.delay - 1, lowest))
    found = {start: evaluate(start, [])}
    for side in (-1, 1):
        here, beyond = at, 0
        while beyond < 2 and abs(here.delay - at.delay) < _FARTHEST and lowest <= here.delay + side <= highest:
            near, here = [found[here][1].sections], here._replace(delay=here.delay + side)
            found[here] = found.get(here) or evaluate(here, near)
            beyond += found[here][0] > found[at][0] + _CLOSE
            at = min(at, here, key=lambda each: found[each][0])
    for delay in (at.delay, min(at.delay + 1, highest)) if feedthrough else ():
        direct = Structure(start.order, delay, True)
        found[direct] = evaluate(direct, [found[at][1].sections])
    return found


def _preferred(experiments: Sequence[Experiment], found: Found, table: Table) -> Structure:
    """Of structures about as likely as the best one, that of the least BIC of the plain sum of squares."""
    first = min(found, key=lambda each: round(found[each][0], 6))
    close = [each for each in found if found[each][0] <= found[first][0] + _CLOSE]
    picks, values, least = thinned(experiments, _PLAIN_LINES), dict[Structure, float](), rounding_floor(experiments)
    for each in close if len(close) > 1 else ():
        near = [fit.sections for delay, fit in table.items() if abs(delay - each.delay) < 4]
        data = lines_of(experiments, picks, each.delay, each.feedthrough)
        fit = refine_best([found[each][1].sections, *near[:2]], data, 15, 1e-5)
        rows = fit.residual.size
        values[each] = rows * np.log(max(fit.cost, least)) + _parameters(experiments, each) * np.log(rows)
    return min(values, key=lambda each: values[each], default=first)

"""Delay and feedthrough at a given order, by the BIC of Whittle's likelihood.

The likelihood takes the residual over the noise's spectrum, which is what the best coarse fit leaves. It chooses only
between poles that were refitted under its weights; of structures that are about as likely the one of the least plain
sum of squares is preferred.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from archerfish2.identification.axis.log_start import ROUNDING, Table, rounding_floor
from archerfish2.identification.axis.output_error import LinearFit, refine, residuals_by_log, solve
from archerfish2.identification.axis.sections import Array, Sections, order_of
from archerfish2.identification.axis.spectrum import Experiment, Indices, Lines, strongest, thinned
from archerfish2.identification.axis.starts import SPREADS, distinct, subsets, vector_fit, vector_fits

_GRID = (0, 2, 5, 10, 15, 20)  # delays that are tried first
_SEARCH_LINES, _PLAIN_LINES, _WHITTLE_LINES = 400, 1000, 1500
_CLOSE = 2.0  # difference of the criterion up to which structures are about as likely
_FARTHEST = 8  # samples that the delay moves from the coarse fits' best one
_Range = tuple[int, int]


class Structure(NamedTuple):
    """What is chosen by the criterion."""

    order: int  # number of poles
    delay: int  # of the inputs [samples]
    feedthrough: bool  # whether inputs act, after the delay, within their own sample


class Whittle(NamedTuple):
    """The criterion of a set of logs."""

    experiments: Sequence[Experiment]
    weights: list[Array]  # one over the noise's standard deviation at all lines, (F,) each
    picks: list[Indices]  # lines of the largest response, (k,) each
    unit: float  # of the sum of squares
    rows: int  # measured samples times outputs


def delay_table(experiments: Sequence[Experiment], order: int, delays: _Range) -> Table:
    """Fit some delays on a few lines: a grid, bisected around the best, doubled while the best lies at its end.

    Args:
      experiments: logs.
      order: number of poles.
      delays: least and largest; the same for a delay that is given.
    """
    picks, tried = thinned(experiments, _SEARCH_LINES), dict[int, LinearFit]()
    lowest, highest = delays
    most = max(highest, min(len(e.u) for e in experiments) // 8) if lowest < highest else highest

    def best() -> int:
        return min(tried, key=lambda delay: tried[delay].cost)

    waiting = [d for d in _GRID if d <= highest] if lowest < highest else [lowest]
    while waiting:
        for delay in waiting:
            data = [e.at(delay).pick(k) for e, k in zip(experiments, picks, strict=True)]
            near = [vector_fit(tried[best()].sections, data, True, 3)] if tried else []
            extra, spreads = (0, SPREADS[:2]) if tried else (2, SPREADS)
            near += vector_fits(data, order, True, rounds=4, extra=extra, spreads=spreads)
            refined = [refine(f.sections, data, True, steps=6, tolerance=1e-4) for f in distinct(near, 2)]
            tried[delay] = min(refined, key=lambda fit: fit.cost)
        here = best()
        below, above = (
            max((d for d in tried if d < here), default=here),
            min((d for d in tried if d > here), default=here),
        )
        waiting = sorted({(below + here) // 2, (here + above + 1) // 2} - tried.keys())
        if highest <= here == max(tried) < most:
            waiting.append(min(2 * max(here, 1), most))
    return tried


def choose_structure(
    experiments: Sequence[Experiment], table: Table, order: int, delays: _Range, feedthrough: bool
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
    data = [e.at(coarse).pick(k) for e, k in zip(experiments, thinned(experiments, _PLAIN_LINES), strict=True)]
    guesses = [table[coarse], *vector_fits(data, order, True)[:2]]
    pilot = min((refine(f.sections, data, True, steps=10, tolerance=1e-4) for f in guesses), key=lambda fit: fit.cost)
    larger = vector_fits(data, order + 2, True, extra=0)[0].sections
    larger = refine(larger, data, True, steps=8, tolerance=1e-4).sections
    whittle = _criterion(experiments, pilot, coarse)
    found = _search(whittle, Structure(order, coarse, False), delays, feedthrough, pilot.sections)
    chosen = _preferred(experiments, found, table)
    coarse_fits = (fit.sections for delay, fit in table.items() if delay == chosen.delay)
    return chosen, [found[chosen][1].sections, *coarse_fits, *subsets(larger, order)]


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


def _criterion(experiments: Sequence[Experiment], pilot: LinearFit, delay: int) -> Whittle:
    data = [e.at(delay) for e in experiments]
    residuals = residuals_by_log(solve(pilot.sections, data, True), data)
    least = ROUNDING * np.mean([np.mean(np.abs(e.outputs) ** 2) for e in experiments]) + 1e-300
    # A rest put before a log adds lines, not information.
    powers = [
        np.maximum(noise_power(np.mean(np.abs(r) ** 2, 0) / 2), least) * e.length / e.measured
        for e, r in zip(experiments, residuals, strict=True)
    ]
    responses = [
        np.mean(np.abs(e.outputs - r) ** 2, 0) / p for e, r, p in zip(experiments, residuals, powers, strict=True)
    ]
    rows = sum(e.measured for e in experiments) * len(residuals[0])
    weights = [1 / np.sqrt(power) for power in powers]
    whittle = Whittle(experiments, weights, strongest(responses, _WHITTLE_LINES), 1.0, rows)
    # What is not linear leaves more between the lines of a comb than on them: an octave's mean is too large there.
    fit = refine(pilot.sections, _weighted(whittle, delay), True, steps=8)
    return whittle._replace(unit=float(np.sqrt(np.clip(fit.cost / fit.residual.size, 0.05, 1.0))))


def _weighted(whittle: Whittle, delay: int) -> list[Lines]:
    each = zip(whittle.experiments, whittle.picks, whittle.weights, strict=True)
    return [e.at(delay).pick(k, w) for e, k, w in each]


def _parameters(experiments: Sequence[Experiment], structure: Structure) -> int:
    m, p = experiments[0].u.shape[1], experiments[0].y.shape[1]
    return structure.order * (1 + m * p + p * len(experiments)) + structure.feedthrough * m * p


def _search(
    whittle: Whittle, start: Structure, delays: _Range, feedthrough: bool, pilot: Sections
) -> dict[Structure, tuple[float, LinearFit]]:
    """Criterion and fit of structures: walk to the best delay, then try the feedthrough there and a sample later."""
    found: dict[Structure, tuple[float, LinearFit]] = {}

    def value(structure: Structure, starts: Sequence[Sections]) -> float:
        if structure not in found:
            data = _weighted(whittle, structure.delay)
            fits = [refine(each, data, structure.feedthrough, steps=20) for each in starts]
            fit = min(fits, key=lambda each: each.cost)
            complexity = _parameters(whittle.experiments, structure) * np.log(whittle.rows)
            found[structure] = fit.cost / whittle.unit + complexity, fit
        return found[structure][0]

    lowest, highest = delays
    # The coarse fits have a feedthrough, so that without one the delay is a sample shorter.
    at = start = start._replace(delay=max(start.delay - 1, lowest))
    fresh = vector_fits(_weighted(whittle, start.delay), start.order, False)[:2]
    best = value(start, [*(fit.sections for fit in fresh), pilot])
    for side in (-1, 1):
        here, beyond = at, 0
        while beyond < 2 and abs(here.delay - at.delay) < _FARTHEST and lowest <= here.delay + side <= highest:
            near = [found[here][1].sections]
            here = here._replace(delay=here.delay + side)
            criterion = value(here, near)
            beyond += criterion > best + _CLOSE
            if criterion < best:
                at, best = here, criterion
    for delay in (at.delay, min(at.delay + 1, highest)) if feedthrough else ():
        value(Structure(start.order, delay, True), [found[at][1].sections])
    return found


def _preferred(
    experiments: Sequence[Experiment],
    found: dict[Structure, tuple[float, LinearFit]],
    table: Table,
) -> Structure:
    """Of structures about as likely as the best one, that of the least BIC of the plain sum of squares."""
    first = min(found, key=lambda each: round(found[each][0], 6))
    close = [each for each in found if found[each][0] <= found[first][0] + _CLOSE]
    picks, values = thinned(experiments, _PLAIN_LINES), dict[Structure, float]()
    for each in close if len(close) > 1 else ():
        data = [e.at(each.delay).pick(k) for e, k in zip(experiments, picks, strict=True)]
        near = [f.sections for d, f in table.items() if abs(d - each.delay) < 4 and order_of(f.sections) == each.order]
        starts = [found[each][1].sections, *near[:2]]
        fits = [refine(x, data, each.feedthrough, steps=15, tolerance=1e-5) for x in starts]
        cost, rows = max(min(fit.cost for fit in fits), rounding_floor(experiments)), fits[0].residual.size
        values[each] = rows * np.log(cost) + _parameters(experiments, each) * np.log(rows)
    return min(values, key=lambda each: values[each], default=first)

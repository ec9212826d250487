"""Selection of order, delay, feedthrough and drift by one criterion; of the order by held-back logs, if there are some.

Of structures that are about as likely the one of the least plain sum of squares is preferred.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from archerfish2.identification.axis.log_start import ROUNDING, Table, rounding_floor
from archerfish2.identification.axis.output_error import (
    LinearFit,
    cost_of,
    refine,
    refine_best,
    residuals_by_log,
    solve,
)
from archerfish2.identification.axis.sections import Sections, order_of, poles_of
from archerfish2.identification.axis.spectrum import (
    Experiment,
    Lines,
    lines_of,
    noise_power,
    slow_wander,
    strongest,
    thinned,
)
from archerfish2.identification.axis.starts import SPREADS, distinct, subsets, vector_fit, vector_fits
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


_PLAIN_LINES, _FIT_LINES = 1000, 8000
_CLOSE = 2.0  # difference of the criterion up to which structures are about as likely
_FARTHEST = 8  # samples that the delay moves from where its search begins
_WORSE = 2  # orders in a row that are worse, beyond which none is tried
_DRIFT_SHARE = 0.35  # of the residual's power that a drift explains at least beside the same poles
_SLOW, _INSTEAD = 6.0, 20.0  # log over a slow pole's time constant; criterion that a drift may lose to such a pole
_PER_STATE = 0.2  # points of fit on held-back logs that a state must gain


class Candidate(NamedTuple):
    """A structure that was evaluated."""

    order: int  # number of poles
    delay: int  # of the inputs [samples]
    feedthrough: bool  # whether inputs act, after the delay, within their own sample
    drift: bool  # of the outputs
    bic: float  # criterion
    weight: float  # probability among those that were kept; 0 of others
    fit_percent: float | None = None  # of the likeliest structure of each order
    held_back_percent: float | None = None  # of the same, on the held-back log that it predicts worst


class Selection(NamedTuple):
    """A structure, and what else is possible."""

    structure: Structure
    starts: list[Sections]  # from which its final fit may start, the likeliest first
    weights: dict[Structure, float]  # of the structures that were kept, the likeliest first; their sum is 1
    found: Found  # their criterion and weighted fit
    candidates: tuple[Candidate, ...]  # all structures, the likeliest first


def select_structure(
    experiments: Sequence[Experiment],
    table: Table,
    orders: Sequence[int],
    delays: tuple[int, int],
    feedthrough: bool,
    held_back: Callable[[Structure, LinearFit], float] | None = None,
) -> Selection:
    """Select a structure.

    Args:
      experiments: logs.
      table: coarse fits of the delays.
      orders: from which the order is chosen.
      delays: least and largest.
      feedthrough: whether the plant may have one.
      held_back: fit of a structure on held-back logs [%]; if given the order is chosen by it.
    """
    coarse = min(table, key=lambda delay: table[delay].cost)
    order = order_of(table[coarse].sections)
    data = lines_of(experiments, thinned(experiments, _PLAIN_LINES), coarse)
    guesses = [table[coarse], *vector_fits(data, order)[:2]]
    pilot = refine_best([fit.sections for fit in guesses], data, 10, 1e-4).sections
    larger = refine_best([vector_fits(data, order + 2, extra=0)[0].sections], data, 8, 1e-4).sections
    several = len(orders) > 1
    criterion = Criterion(experiments, [pilot, larger] if several else [pilot], coarse, several)
    # The coarse fits have a feedthrough, so that without one the delay is a sample shorter.
    search = _Search(criterion, max(coarse - 1, delays[0]), delays, feedthrough)
    worst = _WORSE if held_back is None else len(orders)
    for side in (-1, 1):
        each, worse = min(orders, key=lambda each: abs(each - order)), 0
        while each in orders and worse < worst:
            before = min((bic for bic, _ in criterion.found.values()), default=np.inf)
            worse = 0 if search.at_order(each) <= before else worse + 1
            each += side
    found, predicted = criterion.found, dict[Structure, float]()
    every = dict(found)
    if held_back is not None:
        predicted = {s: held_back(s, found[s][1]) for s in _best_of_orders(found)}
        kept = max(predicted, key=lambda s: predicted[s] - _PER_STATE * s.order).order
        _keep(found, lambda s: s.order == kept)
    search.try_drift(orders)
    every |= found
    chosen = _preferred(criterion, table)
    likely = {s: float(np.exp(-0.5 * (found[s][0] - found[_best(found)][0]))) for s in found}
    weights = {s: w / sum(likely.values()) for s, w in sorted(likely.items(), key=lambda each: -each[1])}
    same = [table[chosen.delay].sections] if chosen.delay in table and order == chosen.order else []
    starts = [found[chosen][1].sections, *same, *subsets(larger, chosen.order)]
    fits = {s: _fit_percent(criterion, s, every[s][1]) for s in _best_of_orders(every)}
    likeliest = sorted(every, key=lambda s: (-weights.get(s, 0.0), every[s][0]))
    facts = [(*s, every[s][0], weights.get(s, 0.0), fits.get(s), predicted.get(s)) for s in likeliest]
    return Selection(chosen, starts, weights, found, tuple(Candidate(*each) for each in facts))


class _Search:
    """Evaluates structures: at an order, the best delay, then the feedthrough there and a sample later."""

    def __init__(self, criterion: Criterion, start: int, delays: tuple[int, int], feedthrough: bool) -> None:
        self.criterion, self.found, self.start = criterion, criterion.found, start
        self.delays, self.feedthrough = delays, feedthrough

    def at_order(self, order: int, drift: bool = False) -> float:
        """Return the least criterion of an order."""
        evaluate, (lowest, highest) = self.criterion.evaluate, self.delays
        at = start = Structure(order, self.start, False, drift)
        best = evaluate(start)
        for side in (-1, 1):
            here, beyond = start, 0
            while beyond < 2 and abs(here.delay - at.delay) < _FARTHEST and lowest <= here.delay + side <= highest:
                near, here = self.found[here][1].sections, here._replace(delay=here.delay + side)
                bic = evaluate(here, [near])
                beyond += bic > best + _CLOSE
                at, best = (here, bic) if bic < best else (at, best)
        for delay in (at.delay, min(at.delay + 1, highest)) if self.feedthrough else ():
            best = min(best, evaluate(Structure(order, delay, True, drift), [self.found[at][1].sections]))
        return best

    def try_drift(self, orders: Sequence[int]) -> None:
        """Evaluate the best order and the two below it with a drift, on which fits may have spent poles; keep either.

        A drift is taken instead of slow poles if it is about as likely, with the same poles if it explains much.
        """
        first, found, logs = _best(self.found), self.found, self.criterion.logs
        for order in range(max(first.order - 2, min(orders)), first.order + 1):
            drifting = Structure(order, first.delay, first.feedthrough, True)
            same = [fit.sections for s, (_, fit) in found.items() if (s.order, s.delay) == (order, first.delay)]
            self.criterion.evaluate(drifting, [*same, *self.criterion.fresh_starts(drifting)])
        best = min((s for s in found if s.drift), key=lambda s: found[s][0])
        decay = -np.log(np.abs(poles_of(found[first][1].sections)) + 1e-300)
        slow = np.any(decay * max(e.measured for e in self.criterion.experiments) < _SLOW)
        allowed = _INSTEAD if best.order < first.order and slow else 0.0
        with_drift, without = (
            refine(found[s][1].sections, [e.at(s.delay, s.feedthrough) for e in logs(s)], 6, 1e-4).cost
            for s in (best, first)
        )
        little = best.order == first.order and with_drift > (1 - _DRIFT_SHARE) * without
        if not little and found[best][0] <= found[first][0] + allowed:
            self.start = best.delay
            self.at_order(best.order, drift=True)
            first = best
        _keep(found, lambda s: s.drift == first.drift)


def _best(found: Found) -> Structure:
    return min(found, key=lambda each: round(found[each][0], 6))


def _best_of_orders(found: Found) -> list[Structure]:
    orders = sorted({s.order for s in found})
    return [_best({s: each for s, each in found.items() if s.order == order}) for order in orders]


def _keep(found: Found, condition: Callable[[Structure], bool]) -> None:
    for s in [s for s in found if not condition(s)]:
        del found[s]


def _fit_percent(criterion: Criterion, s: Structure, fit: LinearFit) -> float:
    """Fit by given poles, each log's transients, level and drift fitted."""
    logs = criterion.logs(s)
    data = lines_of(logs, thinned(logs, _FIT_LINES), s.delay, s.feedthrough)
    power = sum(float(np.sum(np.abs(lines.outputs) ** 2)) for lines in data)
    return float(100 * (1 - np.sqrt(solve(fit.sections, data).cost / power)))


def _preferred(criterion: Criterion, table: Table) -> Structure:
    """Of structures of an order about as likely as the best one, that of the least BIC of the plain sum of squares."""
    found, experiments = criterion.found, criterion.experiments
    first = _best(found)
    close = [s for s, (bic, _) in found.items() if s.order == first.order and bic <= found[first][0] + _CLOSE]
    picks, values, least = thinned(experiments, _PLAIN_LINES), dict[Structure, float](), rounding_floor(experiments)
    for s in close if len(close) > 1 else ():
        near = [fit.sections for delay, fit in table.items() if abs(delay - s.delay) < 4]
        near = [found[s][1].sections, *(each for each in near if order_of(each) == s.order)][:3]
        fit = refine_best(near, lines_of(criterion.logs(s), picks, s.delay, s.feedthrough), 15, 1e-5)
        rows = fit.residual.size
        values[s] = rows * np.log(max(fit.cost, least)) + criterion.parameters(s) * np.log(rows)
    return min(values, key=lambda s: values[s], default=first)

"""Selection of order, delay, feedthrough and drift by one criterion; of the order by held-back logs, if any."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.constraints import out_of_band
from archerfish.identification.axis.output_error import (
    LinearFit,
    cost_of,
    plant_of,
    refine,
    refine_best,
    residuals_by_log,
    solve,
)
from archerfish.identification.axis.sections import Sections, Structure, order_of, poles_of
from archerfish.identification.axis.spectrum import (
    ROUNDING,
    Experiment,
    Lines,
    lines_of,
    noise_power,
    slow_wander,
    strongest,
    thinned,
)
from archerfish.identification.axis.vector_fitting import DelayTable, subsets, vector_fits
from archerfish.identification.simulation import TINY, Array, Complex, free_run

_WHITTLE_LINES, _PLAIN_LINES, _FIT_LINES = 1500, 1000, 8000  # of all logs
_CLEARLY = 20.0  # difference by which the pilot's optimum must be better, as out of band it may have fitted noise
_CLOSE = 2.0  # difference of the criterion up to which structures are about as likely
_FARTHEST = 8  # samples that the delay moves from where its search begins
_WORSE = 2  # orders in a row that are worse, beyond which none is tried
_DRIFT_SHARE = 0.35  # of the residual's power that a drift explains at least beside the same poles
_SLOW, _INSTEAD = 6.0, 20.0  # log over a slow pole's time constant; criterion that a drift may lose to such a pole
_PER_STATE = 0.2  # points of fit on held-back logs that a state must gain

Found = dict[Structure, tuple[float, LinearFit]]
"""Criterion and weighted fit of structures."""


class Criterion:
    """The BIC of structures under the noise that the best of some pilots leaves.

    Args:
      experiments: logs.
      pilots: coarse fits' poles.
      delay: of the pilots [samples].
      slow: whether the noise may have a slow wander, which else costs a pole.
    """

    def __init__(self, experiments: Sequence[Experiment], pilots: Sequence[Sections], delay: int, slow: bool) -> None:
        self.experiments = experiments
        self.drifting = [replace(log, drift=True) for log in experiments]
        self.found: Found = {}
        data = [log.at(delay) for log in experiments]
        best = min((solve(pilot, data) for pilot in pilots), key=cost_of)
        residuals = residuals_by_log(best, data)
        least = ROUNDING * np.mean([np.mean(np.abs(log.outputs) ** 2) for log in experiments]) + TINY
        noise, responses = list[Array](), list[Array]()
        for log, residual in zip(experiments, residuals, strict=True):
            squares = _power(residual) / 2
            smooth = np.maximum(noise_power(squares), slow_wander(squares, len(squares)) if slow else 0)
            # A rest put before a log adds lines, not information.
            noise.append(np.maximum(smooth, least) * log.length / log.measured)
            responses.append(_power(log.outputs - residual) / noise[-1])
        self._picks = strongest(responses, _WHITTLE_LINES)
        self._weights = [1 / np.sqrt(power) for power in noise]
        self._rows = sum(log.measured for log in experiments) * len(residuals[0])
        # On a log without noise plain vector fits miss what is small and out of band; those under the weights find it.
        lines = self._lines(Structure(0, delay, True))
        order = order_of(pilots[0])
        fresh = [fit.sections for fit in vector_fits(lines, order)[:2]]
        fits = [refine(sections, lines, 20, 1e-6) for sections in (*pilots, *fresh)]
        own = [fit for fit in fits if order_of(fit.sections) == order]
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
            same = [sections for sections in self._pilots if order_of(sections) == structure.order]
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


class Validation(NamedTuple):
    """Logs that are held back, by which the order is chosen."""

    logs: Sequence[tuple[Array, Array]]  # inputs (N, m) and outputs (N, p), less their means
    scale: Array  # of the outputs that are fitted, (p,)
    period_s: float  # sampling period [s]


class Selection(NamedTuple):
    """A structure, and what else is possible."""

    structure: Structure
    starts: list[Sections]  # from which its final fit may start, the likeliest first
    weights: dict[Structure, float]  # of the structures that were kept, the likeliest first; their sum is 1
    found: Found  # their criterion and weighted fit
    candidates: tuple[Candidate, ...]  # all structures, the likeliest first


def select_structure(
    experiments: Sequence[Experiment],
    table: DelayTable,
    orders: Sequence[int],
    delays: tuple[int, int],
    feedthrough: bool,
    validation: Validation | None = None,
) -> Selection:
    """Select a structure.

    Args:
      experiments: logs.
      table: coarse fits of the delays.
      orders: from which the order is chosen.
      delays: least and largest.
      feedthrough: whether the plant may have one.
      validation: logs by whose fit the order is chosen, if there are some.
    """
    coarse = min(table, key=lambda delay: table[delay].cost)
    order = order_of(table[coarse].sections)
    data = lines_of(experiments, thinned(experiments, _PLAIN_LINES), coarse)
    starts = [table[coarse], *vector_fits(data, order)[:2]]
    pilot = refine_best([fit.sections for fit in starts], data, 10, 1e-4).sections
    larger = refine_best([vector_fits(data, order + 2, extra=0)[0].sections], data, 8, 1e-4).sections
    several = len(orders) > 1
    criterion = Criterion(experiments, [pilot, larger] if several else [pilot], coarse, several)
    # The coarse fits have a feedthrough, so that without one the delay is a sample shorter.
    search = _Search(criterion, max(coarse - 1, delays[0]), delays, feedthrough)
    search.orders_around(order, orders, len(orders) if validation else _WORSE)
    found = criterion.found
    every = dict(found)
    held_back = dict[Structure, float]()
    if validation is not None:
        for structure in _best_of_orders(found):
            held_back[structure] = _validation_fit(experiments, structure, found[structure][1], validation)
        best = max(held_back, key=lambda structure: held_back[structure] - _PER_STATE * structure.order)
        _keep(found, lambda structure: structure.order == best.order)
    search.try_drift(orders)
    every |= found
    chosen = _best(found)
    weights = _weights(found)
    same = [table[chosen.delay].sections] if chosen.delay in table and order == chosen.order else []
    candidates = _candidates(criterion, every, weights, held_back)
    final_starts = [found[chosen][1].sections, *same, *subsets(larger, chosen.order)]
    return Selection(chosen, final_starts, weights, found, candidates)


class _Search:
    """Evaluates structures: at an order, the best delay, then the feedthrough there and a sample later."""

    def __init__(self, criterion: Criterion, start: int, delays: tuple[int, int], feedthrough: bool) -> None:
        self.criterion, self.found, self.start = criterion, criterion.found, start
        self.delays, self.feedthrough = delays, feedthrough

    def orders_around(self, order: int, orders: Sequence[int], worst: int) -> None:
        """Evaluate the orders below and above one, each side until so many in a row are worse."""
        for side in (-1, 1):
            tried, worse = min(orders, key=lambda other: abs(other - order)), 0
            while tried in orders and worse < worst:
                before = min((bic for bic, _ in self.found.values()), default=np.inf)
                worse = 0 if self.at_order(tried) <= before else worse + 1
                tried += side

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
        first, found = _best(self.found), self.found
        for order in range(max(first.order - 2, min(orders)), first.order + 1):
            drifting = Structure(order, first.delay, first.feedthrough, True)
            same = [fit.sections for s, (_, fit) in found.items() if (s.order, s.delay) == (order, first.delay)]
            self.criterion.evaluate(drifting, [*same, *self.criterion.fresh_starts(drifting)])
        best = min((structure for structure in found if structure.drift), key=lambda structure: found[structure][0])
        decay = -np.log(np.abs(poles_of(found[first][1].sections)) + TINY)
        slow = np.any(decay * max(log.measured for log in self.criterion.experiments) < _SLOW)
        allowed = _INSTEAD if best.order < first.order and slow else 0.0
        little = best.order == first.order and self._cost(best) > (1 - _DRIFT_SHARE) * self._cost(first)
        if not little and found[best][0] <= found[first][0] + allowed:
            self.start = best.delay
            self.at_order(best.order, drift=True)
            first = best
        _keep(found, lambda structure: structure.drift == first.drift)

    def _cost(self, structure: Structure) -> float:
        """Return the plain sum of squares of a structure, its poles refitted."""
        logs = self.criterion.logs(structure)
        data = [log.at(structure.delay, structure.feedthrough) for log in logs]
        return refine(self.found[structure][1].sections, data, 6, 1e-4).cost


def _best(found: Found) -> Structure:
    return min(found, key=lambda structure: round(found[structure][0], 6))


def _best_of_orders(found: Found) -> list[Structure]:
    by_order = defaultdict[int, Found](dict)
    for structure, fit in found.items():
        by_order[structure.order][structure] = fit
    return [_best(by_order[order]) for order in sorted(by_order)]


def _keep(found: Found, condition: Callable[[Structure], bool]) -> None:
    for structure in list(found):
        if not condition(structure):
            del found[structure]


def _weights(found: Found) -> dict[Structure, float]:
    """Return the probabilities of structures by their criterion, the likeliest first."""
    least = found[_best(found)][0]
    likelihood = {structure: float(np.exp(-0.5 * (bic - least))) for structure, (bic, _) in found.items()}
    total = sum(likelihood.values())
    likeliest = sorted(likelihood, key=lambda structure: -likelihood[structure])
    return {structure: likelihood[structure] / total for structure in likeliest}


def _candidates(
    criterion: Criterion, found: Found, weights: dict[Structure, float], held_back: dict[Structure, float]
) -> tuple[Candidate, ...]:
    """Return all structures that were evaluated, the likeliest first, and the fits of the best of each order."""
    fits = {structure: _fit_percent(criterion, structure, found[structure][1]) for structure in _best_of_orders(found)}
    likeliest = sorted(found, key=lambda structure: (-weights.get(structure, 0.0), found[structure][0]))
    candidates = list[Candidate]()
    for structure in likeliest:
        bic, _ = found[structure]
        shares = weights.get(structure, 0.0), fits.get(structure), held_back.get(structure)
        candidates.append(Candidate(*structure, bic, *shares))
    return tuple(candidates)


def _fit_percent(criterion: Criterion, structure: Structure, fit: LinearFit) -> float:
    """Return the fit by given poles [%], each log's transients, level and drift fitted."""
    logs = criterion.logs(structure)
    data = lines_of(logs, thinned(logs, _FIT_LINES), structure.delay, structure.feedthrough)
    power = sum(float(np.sum(np.abs(lines.outputs) ** 2)) for lines in data)
    return float(100 * (1 - np.sqrt(solve(fit.sections, data).cost / power)))


def _validation_fit(
    experiments: Sequence[Experiment], structure: Structure, fit: LinearFit, validation: Validation
) -> float:
    """Return the fit of a structure on the held-back log that it predicts worst [%]."""
    logs = [replace(log, drift=structure.drift) for log in experiments]
    data = lines_of(logs, thinned(logs, _PLAIN_LINES), structure.delay, structure.feedthrough)
    constraints, ridge = out_of_band(solve(fit.sections, data), data, structure.delay)
    fit = refine(fit.sections, data + constraints, 15, 1e-5, ridge)
    plant = plant_of(fit, structure, validation.scale, validation.period_s)
    runs = [free_run(plant, u, y, drift=structure.drift) for u, y in validation.logs]
    return min(float(run.fit_percent.min()) for run in runs)

"""Choice of the order: by the fit on recordings that were not fitted, or by Bayes's information criterion.

The order decides on the delay too: a plant of more states than the axis needs makes several samples of delay out of
its spare poles and zeros, and explains the recordings as well. So the delays that are left open are those of all
orders together, each weighed by its criterion.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.gimbal import (
    AxisIdentification,
    AxisSearch,
    best_plant,
    complete_axis,
    search_axis,
)
from archerfish.identification.axis.log_ground import DRIFT
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.axis.structure_evidence import gather, neighbours
from archerfish.identification.validation.free_run import common_offset, free_run, own_zero_run
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

ORDERS = tuple(range(1, 9))
"""Orders that can be tried."""
USUAL_ORDERS = tuple(range(1, 5))
"""Orders that an axis without unusual resonances has."""
WORTH_A_STATE = 0.2
"""Points of fit on held-back recordings that another state must bring."""
_FIRST = (2, 4)
"""Orders that are tried first where nothing is held back; then those beside the better one."""
_IN_VAIN = 2
"""Orders above the usual ones that are tried without getting better."""
_TAIL = 0.025
"""Weight of the delays that are left out on either side."""


class OrderTrial(NamedTuple):
    """One order tried."""

    order: int
    """Number of states."""
    fit_percent: float
    """Worst fit of the fitted recordings in free run [%]."""
    validation_percent: float | None
    """Worst fit of the recordings that were held back [%], if there are any."""
    criterion: float
    """Bayes's information criterion, less that of the best order."""


class OrderChoice(NamedTuple):
    """An axis of the order that suits it."""

    result: AxisIdentification
    """The axis."""
    trials: tuple[OrderTrial, ...]
    """All orders that the recordings could bear."""


def choose_order(
    recordings: Sequence[Recording],
    held_back: Sequence[Recording] = (),
    *,
    orders: Sequence[int] = ORDERS,
    advance: Callable[[int], None] = lambda _: None,
    max_delay: int | None = None,
    axis: str = "axis",
    seed: int = 0,
    dc_gain: Sequence[float] | None = None,
    feedthrough: bool = True,
) -> OrderChoice:
    """Identify an axis with several orders, and choose one.

    With recordings held back it is the order of which their worst fit, less 0.2 points for each state, is the largest;
    otherwise the order of the lowest information criterion, counted with the residuals' colour. A half of a log is no
    held-back recording: on a sweep it tests the extrapolation to other frequencies.

    Args:
      recordings: to fit.
      held_back: to judge by.
      orders: to try, rising; without recordings held back those far from the best one are left out.
      advance: called with each order that is done.
      max_delay: longest input delay that is tried [samples]; as long as the recordings call for if not given.
      axis: name for the record.
      seed: of the posterior draws.
      dc_gain: steady gain from each input, where it is known.
      feedthrough: whether the outputs may jump with an input.

    Raises:
      InputError: if the recordings can bear no order at all.
    """
    searches: dict[int, AxisSearch] = {}
    worst: dict[int, float | None] = {}
    waiting = list(orders) if held_back else [order for order in _FIRST if order in orders] or list(orders)
    while waiting:
        order = waiting.pop(0)
        reached = max((each.longest_delay for each in searches.values()), default=None)
        try:
            searches[order] = search_axis(
                recordings,
                order,
                max_delay=max_delay,
                dc_gain=dc_gain,
                feedthrough=feedthrough,
                reached=reached,
                drift=next((each.drifts for each in searches.values()), None),
            )
        except InputError:
            if not searches and order == min(orders):
                raise
            # Too short for this order and for every higher one.
            waiting = [each for each in orders if each < order and each not in searches]
            continue
        advance(order)
        if held_back:
            worst[order] = _worst_fit(searches[order], recordings, held_back)
            if order > max(USUAL_ORDERS) and order - _best(worst) >= _IN_VAIN:
                break
        elif not waiting and set(searches) == {*_FIRST} & {*orders}:
            waiting = _next_to_best(searches, orders)
    searches = dict(sorted(searches.items()))
    candidates = _candidates(searches)
    least = _least(candidates)
    trials = [_trial(searches[order], recordings, worst.get(order), least) for order in searches]
    chosen = _best(worst) if held_back else min(least, key=lambda order: least[order])
    weights = _delay_weights(candidates)
    search = _likeliest_first(searches[chosen], [each for each in candidates if each.order == chosen])
    found = search.found._replace(delays=_open_delays(weights), delay_weights=weights)
    result = complete_axis(search._replace(found=found), axis=axis, seed=seed)
    return OrderChoice(result, tuple(trials))


def _next_to_best(searches: Mapping[int, AxisSearch], orders: Sequence[int]) -> list[int]:
    """Return the neighbours of the best order so far that have not been tried."""
    least = _least(_candidates(searches))
    best = min(least, key=lambda order: least[order])
    return [order for order in (best - 1, best + 1) if order in orders and order not in searches]


class _Candidate(NamedTuple):
    order: int
    structure: Structure
    criterion: float


def _candidates(searches: Mapping[int, AxisSearch]) -> list[_Candidate]:
    """Return all structures that were found, and those beside the best one, with their criteria on the same samples."""
    # The samples that the longest delay leaves.
    widest = max(searches.values(), key=lambda each: (each.longest_delay, each.order))
    found = [
        (order, structure)
        for order, search in searches.items()
        for structure in (search.found.best, *search.found.others)
    ]
    evidence = gather([structure for _, structure in found], widest.found.ground)
    candidates = [_Candidate(*each, evidence.criterion(each[1])) for each in found]
    best = min(candidates, key=lambda each: each.criterion)
    prompt = best.structure.problem._replace(feedthrough=False)
    beside = neighbours(best.structure._replace(problem=prompt), evidence, widest.longest_delay)
    return [*candidates, *(_Candidate(best.order, *each) for each in beside)]


def _least(candidates: Sequence[_Candidate]) -> dict[int, float]:
    """Return the least criterion of each order."""
    least: dict[int, float] = {}
    for each in candidates:
        least[each.order] = min(each.criterion, least.get(each.order, np.inf))
    return dict(sorted(least.items()))


def _likeliest_first(search: AxisSearch, candidates: Sequence[_Candidate]) -> AxisSearch:
    found = search.found
    fitted = (found.best, *found.others)
    criteria = [min(each.criterion for each in candidates if each.structure is one) for one in fitted]
    order = np.argsort(criteria, kind="stable")
    best, *others = (fitted[index] for index in order)
    ranked = found._replace(best=best, others=tuple(others), criteria=tuple(criteria[index] for index in order))
    return search._replace(found=ranked)


def _delay_weights(candidates: Sequence[_Candidate]) -> dict[int, float]:
    """Return how likely each delay is, all orders together; a plant with feedthrough answers a sample earlier."""
    values: dict[tuple[int, int, bool], float] = {}
    for order, structure, value in candidates:
        key = order, structure.delay, structure.problem.feedthrough
        values[key] = min(value, values.get(key, np.inf))
    least = min(values.values())
    weights: dict[int, float] = {}
    for (_, delay, feedthrough), value in values.items():
        prompt = delay - feedthrough
        weights[prompt] = weights.get(prompt, 0.0) + float(np.exp(-0.5 * (value - least)))
    total = sum(weights.values())
    return {delay: weights[delay] / total for delay in sorted(weights)}


def _open_delays(weights: Mapping[int, float]) -> tuple[int, int]:
    """Return the shortest and the longest delay between which 95 % of the weight lie [samples]."""
    delays, below = list(weights), np.cumsum(list(weights.values()))
    first, last = np.searchsorted(below, [_TAIL, 1 - _TAIL])
    return max(delays[first], 0), max(delays[min(last, len(delays) - 1)], 0)


def _worst_fit(search: AxisSearch, recordings: Sequence[Recording], held_back: Sequence[Recording]) -> float | None:
    if not held_back:
        return None
    plant = best_plant(search)
    drift = DRIFT if search.drifts else 0
    shared = common_offset(plant, recordings, drift=drift)
    return min(float(free_run(plant, each, shared, drift=drift).fit_percent.mean()) for each in held_back)


def _best(worst: Mapping[int, float | None]) -> int:
    """Return the order of the largest fit on what was held back, less what each state must bring."""
    return max(worst, key=lambda order: (worst[order] or 0.0) - WORTH_A_STATE * order)


def _trial(
    search: AxisSearch, recordings: Sequence[Recording], validation: float | None, least: Mapping[int, float]
) -> OrderTrial:
    plant = best_plant(search)
    fits = [
        float(own_zero_run(plant, each, drift=DRIFT if search.drifts else 0)[1].fit_percent.mean())
        for each in recordings
    ]
    return OrderTrial(search.order, min(fits), validation, least[search.order] - min(least.values()))

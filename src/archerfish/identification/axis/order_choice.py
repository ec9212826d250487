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
    weight_within,
)
from archerfish.identification.axis.log_ground import DRIFT
from archerfish.identification.axis.pole_refinement import refine_poles
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.axis.structure_evidence import Evidence, gather, neighbours, pursued
from archerfish.identification.validation.free_run import common_offset, free_run, own_zero_run
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording, slice_recording

ORDERS = tuple(range(1, 9))
"""Orders that can be tried."""
USUAL_ORDERS = tuple(range(1, 5))
"""Orders that an axis without unusual resonances has."""
WORTH_A_STATE = 0.2
"""Points of fit on held-back recordings that another state must bring."""
WORTH_A_LIKELY_STATE = 1.0
"""Points of fit on what was fitted, and then on the last third, that a state beyond the likeliest order must bring."""
_FIRST = (2, 4)
"""Orders that are tried first where nothing is held back; then those beside the better one."""
_IN_VAIN = 2
"""Orders above the usual ones that are tried without getting better."""
_EARLIER = (0, 2, 5, 10)
"""Samples before the likeliest delay where poles are built anew."""
_CLOSE = 4.0
"""Difference of the criterion up to which two structures are about as likely."""
_TEMPERED = 0.5
"""Share of the criterion that counts as evidence: no axis is quite linear, nor its noise quite stationary."""
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
    drifts = any(each.drifts for each in searches.values())
    candidates = _candidates(searches)
    least = _least(candidates)
    trials = [_trial(searches[order], recordings, worst.get(order), least) for order in searches]
    weights = _delay_weights(candidates)
    first = _preferred(candidates, weights)
    chosen = _best(worst) if held_back else _order_that_lasts(searches, first.order, drifts=drifts)
    if chosen != first.order:
        candidates = [each for each in candidates if each.order == chosen]
        first = _preferred(candidates, weights)
    search = _with_first(searches, first, candidates)
    found = search.found._replace(delays=_open_delays(weights), delay_weights=weights)
    result = complete_axis(search._replace(found=found), axis=axis, seed=seed)
    return OrderChoice(result, tuple(trials))


def _next_to_best(searches: Mapping[int, AxisSearch], orders: Sequence[int]) -> list[int]:
    """Return the neighbours of the best order so far that have not been tried."""
    candidates, _ = _fitted(searches)
    best = min(candidates, key=lambda each: each.criterion).order
    return [order for order in (best - 1, best + 1) if order in orders and order not in searches]


class _Candidate(NamedTuple):
    order: int
    structure: Structure
    criterion: float

    @property
    def prompt(self) -> int:
        """Delay of the first response, less the sample that any plant without feedthrough takes [samples]."""
        return self.structure.delay - self.structure.problem.feedthrough


def _fitted(searches: Mapping[int, AxisSearch]) -> tuple[list[_Candidate], Evidence]:
    """Return all structures that were found with their criteria on the same samples, and what they are compared on."""
    # The samples that the longest delay leaves.
    widest = max(searches.values(), key=lambda each: (each.longest_delay, each.order))
    found = [
        (order, structure)
        for order, search in searches.items()
        for structure in (search.found.best, *search.found.others)
    ]
    evidence = gather([structure for _, structure in found], widest.found.ground)
    return [_Candidate(*each, evidence.criterion(each[1])) for each in found], evidence


def _candidates(searches: Mapping[int, AxisSearch]) -> list[_Candidate]:
    """Return all structures that were found, those that a second look finds, and those beside the best one."""
    candidates, evidence = _fitted(searches)
    best = min(candidates, key=lambda each: each.criterion)
    delays = sorted({max(best.prompt - step, 0) for step in _EARLIER})
    for order in (best.order, best.order + 1):
        if order in searches and order > 1:
            anew = _Candidate(order, *pursued(searches[order].found.best, order, delays, evidence))
            candidates.append(anew)
            best = min(best, anew, key=lambda each: each.criterion)
    prompt = best.structure.problem._replace(feedthrough=False)
    longest = max(each.longest_delay for each in searches.values())
    beside = neighbours(best.structure._replace(problem=prompt), evidence, longest)
    return [*candidates, *(_Candidate(best.order, *each) for each in beside)]


def _least(candidates: Sequence[_Candidate]) -> dict[int, float]:
    """Return the least criterion of each order."""
    least: dict[int, float] = {}
    for each in candidates:
        least[each.order] = min(each.criterion, least.get(each.order, np.inf))
    return dict(sorted(least.items()))


def _preferred(candidates: Sequence[_Candidate], weights: Mapping[int, float]) -> _Candidate:
    """Return the structure whose delay is likeliest to be right, among those about as likely as the best one."""
    least = min(each.criterion for each in candidates)
    close = [each for each in candidates if each.criterion <= least + _CLOSE]
    return max(close, key=lambda each: (round(weight_within(weights, each.prompt), 2), -each.criterion))


def _with_first(searches: Mapping[int, AxisSearch], first: _Candidate, candidates: Sequence[_Candidate]) -> AxisSearch:
    """Return the search for the order of a structure, that structure the first one and others as likely added."""
    search = searches[first.order]
    fitted = {id(each) for each in (search.found.best, *search.found.others)}
    kept = [first]
    for each in sorted(candidates, key=lambda each: each.criterion):
        likely = id(each.structure) in fitted or each.criterion <= first.criterion
        if each is not first and each.order == first.order and likely:
            kept.append(each)
    structures = [
        each.structure if id(each.structure) in fitted else _on_all_lines(each.structure, search) for each in kept
    ]
    found = search.found._replace(
        best=structures[0], others=tuple(structures[1:]), criteria=tuple(_TEMPERED * each.criterion for each in kept)
    )
    return search._replace(found=found)


def _on_all_lines(structure: Structure, search: AxisSearch) -> Structure:
    problem = structure.problem._replace(experiments=search.found.ground.spectra(structure.delay))
    return structure._replace(problem=problem, refinement=refine_poles(structure.refinement.sections, problem))


def _order_that_lasts(searches: Mapping[int, AxisSearch], likeliest: int, *, drifts: bool) -> int:
    """Return the likeliest order, or a higher one that explains much more, also of what it was not fitted to.

    What an axis does beyond a linear plant is no noise: the criterion counts it as if it were, and leaves out poles
    that follow it. So where a higher order explains clearly more, the last thirds of the recordings decide, the one
    that it explains worst.

    Args:
      searches: by order.
      likeliest: order of the least criterion.
      drifts: whether a drift is fitted beside the response.
    """
    left = {order: _left_percent(search) for order, search in searches.items() if order >= likeliest}
    richest = min(left, key=lambda order: left[order] + WORTH_A_LIKELY_STATE * order)
    if richest == likeliest:
        return likeliest
    recordings = searches[likeliest].recordings
    cuts = [2 * len(each) // 3 for each in recordings]
    begun = [slice_recording(each, 0, cut) for each, cut in zip(recordings, cuts, strict=True)]
    rest = [slice_recording(each, cut, len(each)) for each, cut in zip(recordings, cuts, strict=True)]
    fits = {}
    for order in (likeliest, richest):
        try:
            search = search_axis(begun, order, max_delay=searches[order].longest_delay, drift=drifts)
        except InputError:
            return likeliest  # too short to tell
        runs = [own_zero_run(best_plant(search), each, drift=DRIFT if drifts else 0)[1] for each in rest]
        fits[order] = min(float(each.fit_percent.mean()) for each in runs)
    gained = fits[richest] - fits[likeliest]
    return richest if gained > WORTH_A_LIKELY_STATE * (richest - likeliest) else likeliest


def _left_percent(search: AxisSearch) -> float:
    """Return how much of the outputs a plant leaves, standard deviations [%]."""
    best = search.found.best
    outputs = sum(float(np.sum(np.abs(each.outputs) ** 2)) for each in best.problem.experiments)
    return 100 * float(np.sqrt(best.refinement.fit.misfit / max(outputs, np.finfo(float).tiny)))


def _delay_weights(candidates: Sequence[_Candidate]) -> dict[int, float]:
    """Return how likely each delay is, all orders together; a plant with feedthrough answers a sample earlier."""
    values: dict[tuple[int, int, bool], float] = {}
    for each in candidates:
        key = each.order, each.structure.delay, each.structure.problem.feedthrough
        values[key] = min(each.criterion, values.get(key, np.inf))
    least = min(values.values())
    weights: dict[int, float] = {}
    for (_, delay, feedthrough), value in values.items():
        prompt = delay - feedthrough
        weights[prompt] = weights.get(prompt, 0.0) + float(np.exp(-0.5 * _TEMPERED * (value - least)))
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

"""Choice of the order: by the fit on recordings that were not fitted, or by Bayes's information criterion.

The order decides on the delay too: a plant of more states than the axis needs makes several samples of delay out of
its spare poles and zeros, and explains the recordings as well. So the delays that are left open are those of all
orders together, each weighed by its criterion.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.delay_walk import colour, rounding
from archerfish.identification.axis.gimbal import (
    AxisIdentification,
    AxisSearch,
    best_plant,
    complete_axis,
    search_axis,
)
from archerfish.identification.axis.log_ground import Ground
from archerfish.identification.axis.normal_equations import lay_out, solve
from archerfish.identification.axis.pole_refinement import Problem, Refinement
from archerfish.identification.axis.spectra import row_count
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.validation.free_run import common_offset, free_run
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

ORDERS = tuple(range(1, 9))
"""Orders that can be tried."""
USUAL_ORDERS = tuple(range(1, 5))
"""Orders that an axis without unusual resonances has."""
WORTH_A_STATE = 0.2
"""Points of fit on held-back recordings that another state must bring."""
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
      orders: to try, rising.
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
    for order in orders:
        try:
            searches[order] = search_axis(
                recordings, order, max_delay=max_delay, dc_gain=dc_gain, feedthrough=feedthrough
            )
        except InputError:
            if not searches:
                raise
            break  # too short for this order and for every higher one
        advance(order)
        worst[order] = _worst_fit(searches[order], recordings, held_back)
        if order > max(USUAL_ORDERS) and order - _best(worst) >= _IN_VAIN:
            break
    criteria = _criteria(searches)
    least = {order: min(value for _, value in each) for order, each in criteria.items()}
    trials = [_trial(searches[order], recordings, worst[order], least) for order in searches]
    search = searches[_best(worst) if held_back else min(least, key=lambda order: least[order])]
    delays = _open_delays([pair for each in criteria.values() for pair in each])
    result = complete_axis(search._replace(found=search.found._replace(delays=delays)), axis=axis, seed=seed)
    return OrderChoice(result, tuple(trials))


def _criteria(searches: Mapping[int, AxisSearch]) -> dict[int, list[tuple[int, float]]]:
    """Return the delay and the criterion of every structure of each order, on all lines and without prior."""
    # The same samples for all: those that the longest delay leaves.
    ground = max(searches.values(), key=lambda each: (each.longest_delay, each.order)).found.ground
    fits = {order: [_on_all_lines(each, ground) for each in _structures(search)] for order, search in searches.items()}
    inflation = max(1.0, min(colour(*each[0]) for each in fits.values()))
    return {
        order: [
            (structure.delay, _criterion(*fit, inflation))
            for structure, fit in zip(_structures(searches[order]), each, strict=True)
        ]
        for order, each in fits.items()
    }


def _structures(search: AxisSearch) -> list[Structure]:
    return [search.found.best, *search.found.others]


def _on_all_lines(structure: Structure, ground: Ground) -> tuple[Problem, Refinement]:
    problem = Problem(ground.spectra(structure.delay), structure.problem.feedthrough)
    fit = solve(structure.refinement.sections, lay_out(*problem)).fit
    return problem, Refinement(structure.refinement.sections, fit, fit.cost)


def _criterion(problem: Problem, refinement: Refinement, inflation: float) -> float:
    """N ln σ² + parameters ln N; N coloured residuals count as fewer, by the inflation of the variances."""
    fit = refinement.fit
    outputs = fit.numerators.shape[2]
    rows = row_count(problem.experiments) * outputs / inflation
    parameters = len(fit.numerators) + fit.numerators.size + problem.feedthrough * fit.feedthrough.size
    return rows * float(np.log(max(fit.misfit, rounding(problem.experiments)))) + parameters * float(np.log(rows))


def _open_delays(criteria: Sequence[tuple[int, float]]) -> tuple[int, int]:
    """Return the shortest and the longest delay between which 95 % of the weight of all structures lie [samples]."""
    delays: NDArray[np.int64] = np.array([delay for delay, _ in criteria])
    values = np.array([value for _, value in criteria])
    order = np.argsort(delays, kind="stable")
    weights = np.exp(-0.5 * (values - values.min()))[order]
    below = np.cumsum(weights) / weights.sum()
    first, last = np.searchsorted(below, [_TAIL, 1 - _TAIL])
    return int(delays[order][first]), int(delays[order][min(last, len(order) - 1)])


def _worst_fit(search: AxisSearch, recordings: Sequence[Recording], held_back: Sequence[Recording]) -> float | None:
    if not held_back:
        return None
    plant = best_plant(search)
    shared = common_offset(plant, recordings)
    return min(float(free_run(plant, each, shared).fit_percent.mean()) for each in held_back)


def _best(worst: Mapping[int, float | None]) -> int:
    """Return the order of the largest fit on what was held back, less what each state must bring."""
    return max(worst, key=lambda order: (worst[order] or 0.0) - WORTH_A_STATE * order)


def _trial(
    search: AxisSearch, recordings: Sequence[Recording], validation: float | None, least: Mapping[int, float]
) -> OrderTrial:
    plant = best_plant(search)
    fits = [float(free_run(plant, each, common_offset(plant, [each])).fit_percent.mean()) for each in recordings]
    return OrderTrial(search.order, min(fits), validation, least[search.order] - min(least.values()))

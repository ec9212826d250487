"""Choice of the order: by the fit on recordings that were not fitted, or by Bayes's information criterion."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.identification.axis.gimbal import AxisIdentification, identify_axis
from archerfish.identification.validation.free_run import free_run
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

ORDERS = tuple(range(1, 9))
"""Orders that are tried."""
WORTH_A_STATE = 0.2
"""Points of fit on held-back recordings that another state must bring."""


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
    advance: Callable[[int], None] = lambda _: None,
    max_delay: int = 20,
    axis: str = "axis",
    seed: int = 0,
    dc_gain: Sequence[float] | None = None,
    feedthrough: bool = True,
) -> OrderChoice:
    """Identify an axis with every order, and choose one.

    With recordings held back it is the order of which their worst fit, less 0.2 points for each state, is the largest;
    otherwise the order of the lowest information criterion, counted with the residuals' colour. A half of a log is no
    held-back recording: on a sweep it tests the extrapolation to other frequencies.

    Args:
      recordings: to fit.
      held_back: to judge by.
      advance: hears of each order that is done.
      max_delay: longest input delay that is tried [samples].
      axis: name for the record.
      seed: of the posterior draws.
      dc_gain: steady gain from each input, where it is known.
      feedthrough: whether the outputs may jump with an input.

    Raises:
      InputError: if the recordings can bear no order at all.
    """
    results: dict[int, AxisIdentification] = {}
    for order in ORDERS:
        try:
            results[order] = identify_axis(
                recordings,
                order,
                max_delay=max_delay,
                axis=axis,
                seed=seed,
                dc_gain=dc_gain,
                feedthrough=feedthrough,
            )
        except InputError:
            if not results:
                raise
            break  # too short for this order and for every higher one
        advance(order)
    inflation = max(1.0, min(result.parameters.inflation for result in results.values()))
    samples = sum(len(each) for each in recordings) / inflation
    criteria = {order: _criterion(result, samples) for order, result in results.items()}
    worst = {order: _worst_fit(result, held_back) for order, result in results.items()}
    chosen = min(criteria, key=lambda order: criteria[order])
    if held_back:
        chosen = max(worst, key=lambda order: (worst[order] or 0.0) - WORTH_A_STATE * order)
    least = min(criteria.values())
    trials = [
        OrderTrial(order, min(result.fit_percent), worst[order], criteria[order] - least)
        for order, result in results.items()
    ]
    return OrderChoice(results[chosen], tuple(trials))


def _worst_fit(result: AxisIdentification, held_back: Sequence[Recording]) -> float | None:
    fits = [float(free_run(result.plant, each, result.offset).fit_percent.mean()) for each in held_back]
    return min(fits, default=None)


def _criterion(result: AxisIdentification, samples: float) -> float:
    """N ln σ² + parameters ln N; N coloured residuals count as fewer, by the inflation of the variances."""
    parameters = result.parameters.free.size + result.parameters.linear.size + 1
    deviance = samples * float(np.sum(np.log(np.maximum(result.residual_sd, np.finfo(float).tiny) ** 2)))
    return deviance + parameters * float(np.log(samples))

"""Several cells taken together, with an interval made from theirs."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from archerfish.evaluation.results import Cell, Comparison, Drop


class Estimate(NamedTuple):
    """A rate or a difference of rates with its interval."""

    value: float
    """As measured."""
    low: float
    """Lower end of its 95 % interval."""
    high: float
    """Upper end of its 95 % interval."""


def pooled_cells(cells: Iterable[Cell]) -> Estimate | None:
    """Return hits per shot that counts over several cells of one controller; None without any."""
    shot = [cell for cell in cells if cell.counted]
    return weighted_mean([Estimate(cell.rate, cell.low, cell.high) for cell in shot], [cell.counted for cell in shot])


def pooled_differences(differences: Iterable[Comparison | Drop]) -> Estimate | None:
    """Return the mean over several cells of one difference, every cell counting alike; None without cells."""
    found = [Estimate(each.difference, each.low, each.high) for each in differences]
    return weighted_mean(found, [1.0] * len(found))


def weighted_mean(estimates: Sequence[Estimate], weights: Sequence[float]) -> Estimate | None:
    """Average independent estimates.

    The interval is put together from theirs by Zou and Donner's method of variance estimates recovery (2008): the ends'
    distances from the estimates add up in squares, the lower and the upper ones apart, as asymmetric intervals ask for.
    The engagements of different cells are drawn independently.
    """
    total = sum(weights)
    if not total:
        return None
    shares = [weight / total for weight in weights]
    value = math.fsum(share * each.value for share, each in zip(shares, estimates, strict=True))
    below = math.hypot(*(share * (each.value - each.low) for share, each in zip(shares, estimates, strict=True)))
    above = math.hypot(*(share * (each.high - each.value) for share, each in zip(shares, estimates, strict=True)))
    return Estimate(value, value - below, value + above)

"""Several trainings of one configuration taken together: how well it shoots, however its seed falls.

All trainings meet the same engagements. The interval has two parts, which add up in squares: the engagements, sampled
once for all trainings, and the trainings, which differ by their seed.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from archerfish.evaluation.hit_rate import CONFIDENCE, hit_rate
from archerfish.evaluation.pooling import Estimate, weighted_mean
from archerfish.records.errors import InputError


class SeedSpread(NamedTuple):
    """How far trainings that differ by their seed alone lie apart."""

    deviation: float
    """Standard deviation of their hit rates, the median of several configurations'."""
    degrees: int
    """Degrees of freedom behind it: trainings less configurations."""


def seed_spread(rates: Sequence[Sequence[float]]) -> SeedSpread | None:
    """Return the usual spread between the trainings of a configuration; None where each has one.

    A configuration whose trainings diverge now and then would blow up a mean; the median holds what is usual.

    Args:
      rates: of each configuration, the hit rates of its trainings.
    """
    several = [each for each in rates if len(each) > 1]
    if not several:
        return None
    deviations = [float(np.std(each, ddof=1)) for each in several]
    return SeedSpread(float(np.median(deviations)), sum(len(each) - 1 for each in several))


def pooled_trainings(hits: NDArray[np.int64], shots: int, spread: SeedSpread | None = None) -> Estimate:
    """Return hits per shot over all trainings of a configuration and all cells.

    Args:
      hits: hits in each engagement, shape (trainings, cells, engagements).
      shots: of each engagement.
      spread: what is usual; the interval takes the larger of it and this configuration's own. Without it, as with one
        training each, the interval is that of these very trainings.

    Raises:
      InputError: if there is no training, or an engagement has more hits than shots.
    """
    if hits.ndim != 3 or not hits.size or hits.min() < 0 or hits.max() > shots:
        raise InputError(f"hits must be 0…{shots} of shape (trainings, cells, engagements), got shape {hits.shape}")
    trainings, cells, _ = hits.shape
    # An interval by engagement takes no notice of which of its shots hit.
    hit = np.arange(shots) < hits[..., None]
    counted = [hit_rate(np.concatenate(list(hit[:, cell]), axis=-1)) for cell in range(cells)]
    met = weighted_mean([Estimate(each.rate, each.low, each.high) for each in counted], [1.0] * cells)
    assert met is not None
    if spread is None:
        return met
    own = float(np.std(hits.mean(axis=(1, 2)) / shots, ddof=1)) if trainings > 1 else 0.0
    quantile = float(stdtrit(spread.degrees, (1 + CONFIDENCE) / 2))
    by_seed = quantile * max(own, spread.deviation) / math.sqrt(trainings)
    low = met.value - math.hypot(met.value - met.low, by_seed)
    high = met.value + math.hypot(met.high - met.value, by_seed)
    return Estimate(met.value, max(0.0, low), min(1.0, high))

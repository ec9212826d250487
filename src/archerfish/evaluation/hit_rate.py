"""Hit rates with 95 % intervals: k hits of n decisions, where the decisions of one engagement are not independent.

A controller that aims badly in one engagement misses most of its shots, so an interval that counts every decision as an
independent trial is too narrow. Here the engagement is the unit of sampling. Every decision counts: one without fire is
a miss.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from archerfish.errors import InputError
from archerfish.reports.table import Estimate

CONFIDENCE = 0.95


class HitRate(NamedTuple):
    """k hits of n decisions and the 95 % interval of the rate."""

    hits: int  # k
    decisions: int  # n
    engagements: int  # independent ones that the decisions belong to
    low: float  # lower end, 0 to 1
    high: float  # upper end, 0 to 1

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1."""
        return self.hits / self.decisions


class Difference(NamedTuple):
    """The hit rate of one controller less that of another in the same engagements, −1 to 1, with its 95 % interval."""

    difference: float  # of the rates
    low: float  # lower end
    high: float  # upper end


def hit_rate(hits: ArrayLike, decisions: int) -> HitRate:
    """Count the hits and give the rate a 95 % interval clustered by engagement.

    Wilson's interval (1927) with two changes that survey statistics makes for clusters (Korn and Graubard 1998): n is
    divided by the design effect, the variance of the rate between engagements over that of independent shots, and the
    normal quantile is Student's with (engagements − 1) degrees of freedom. The design effect is at least 1. A few
    misses say little about how they cluster, so it is estimated as if there were one miss more, in an engagement that
    misses throughout. Without any miss the engagements alone count, as in the rule of three.

    Args:
      hits: of each engagement, whole numbers, shape (engagements,).
      decisions: of an engagement.

    Raises:
      InputError: if there are fewer than 2 engagements or no decisions, or more hits than decisions.
    """
    counts = _checked("hits", hits, decisions)
    k, engagements = int(counts.sum()), len(counts)
    n = engagements * decisions
    low, high = _wilson(k / n, n / _design_effect(counts, decisions), _quantile(engagements))
    return HitRate(k, n, engagements, low, high)


def paired_difference(hits_a: ArrayLike, hits_b: ArrayLike, decisions: int) -> Difference:
    """Compare two controllers in the same engagements with the same dispersion draws.

    Student's interval of the mean difference between engagements. To its variance is added that of one engagement in
    which √n more of the n decisions differ, so that the interval of two controllers that agree in every decision still
    has a width; beside a real spread the addition is negligible.

    Args:
      hits_a: of the first controller in each engagement, whole numbers, shape (engagements,).
      hits_b: of the second in the same engagements, in the same order, shape (engagements,).
      decisions: of an engagement.

    Raises:
      InputError: if the numbers of engagements differ, or `hit_rate` refuses one of them.
    """
    a, b = _checked("hits_a", hits_a, decisions), _checked("hits_b", hits_b, decisions)
    if len(a) != len(b):
        remedy = "evaluate both controllers in the same engagements"
        raise InputError(f"hits_a has {len(a)} engagements and hits_b {len(b)}, expected as many; {remedy}")
    n = len(a) * decisions
    difference = (int(a.sum()) - int(b.sum())) / n
    variance = float(np.var(a / decisions - b / decisions, ddof=1)) / len(a) + 1 / (n * len(a))
    half_width = _quantile(len(a)) * math.sqrt(variance)
    return Difference(difference, max(-1.0, difference - half_width), min(1.0, difference + half_width))


def weighted_mean(estimates: Sequence[Estimate], weights: Sequence[float]) -> Estimate:
    """Average independent estimates, such as the cells of one controller, whose engagements are drawn independently.

    The interval follows from theirs by the method of variance estimates recovery (Zou and Donner 2008): the distances
    of the ends from the estimates add in squares, the lower and the upper ones apart.

    Args:
      estimates: at least one.
      weights: one each, of any positive sum.
    """
    shares = [weight / sum(weights) for weight in weights]
    weighted = list(zip(shares, estimates, strict=True))
    value = math.fsum(share * estimate.value for share, estimate in weighted)
    below = math.hypot(*(share * (estimate.value - estimate.low) for share, estimate in weighted))
    above = math.hypot(*(share * (estimate.high - estimate.value) for share, estimate in weighted))
    return Estimate(value, value - below, value + above, estimates[0].unit)


def _design_effect(hits: NDArray[np.int64], decisions: int) -> float:
    """Variance of the rate between engagements over that of independent shots, at least 1."""
    k, n = int(hits.sum()), len(hits) * decisions
    rarer = min(k, n - k)
    if rarer == 0:
        return float(decisions)  # as if all decisions of an engagement agreed
    variance_of_k = len(hits) * float(np.var(hits, ddof=1))
    estimated = variance_of_k / (k * (n - k) / n)
    return max(1.0, float(rarer * estimated + decisions) / (rarer + 1))


def _wilson(rate: float, trials: float, quantile: float) -> tuple[float, float]:
    shrink = 1 / (1 + quantile**2 / trials)
    centre = shrink * (rate + quantile**2 / (2 * trials))
    half_width = shrink * quantile * math.sqrt(rate * (1 - rate) / trials + (quantile / (2 * trials)) ** 2)
    # Rounding may carry an end past the rate when every shot hit, or none.
    return max(0.0, min(centre - half_width, rate)), min(1.0, max(centre + half_width, rate))


def _quantile(engagements: int) -> float:
    """Return Student's quantile for a two-sided interval."""
    from scipy.special import stdtrit  # slow to load

    return float(stdtrit(engagements - 1, (1 + CONFIDENCE) / 2))


def _checked(name: str, hits: ArrayLike, decisions: int) -> NDArray[np.int64]:
    counts = np.asarray(hits)
    is_valid = counts.dtype.kind in "iu" and counts.ndim == 1 and len(counts) >= 2 and decisions >= 1
    if not is_valid or counts.min() < 0 or counts.max() > decisions:
        expected = f"whole numbers of at least 2 engagements, 0…{decisions}"
        raise InputError(f"{name} is {counts.dtype} of shape {counts.shape}, expected {expected}; evaluate more")
    return counts.astype(np.int64)

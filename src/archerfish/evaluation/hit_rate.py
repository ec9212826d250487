"""Hit rates with honest intervals: k hits of n shots, the shots of one engagement not independent.

One engagement is one meeting with one target: a policy that aims badly there misses most of its shots, so an interval
that counts every shot as a fresh trial is too narrow. Everything here takes the engagement as the unit of sampling.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from archerfish.records.errors import InputError

CONFIDENCE = 0.95
"""Probability with which an interval should hold the true value."""

Hits = NDArray[np.bool_]


class HitRate(NamedTuple):
    """k hits of n shots and the interval of the rate."""

    hits: int
    """Shots that hit, k."""
    shots: int
    """Shots fired, n."""
    engagements: int
    """Independent engagements that the shots fall into."""
    low: float
    """Lower end of the 95 % interval of the hit rate, 0 to 1."""
    high: float
    """Upper end of the 95 % interval of the hit rate, 0 to 1."""

    @property
    def rate(self) -> float:
        """Hits per shot, 0 to 1."""
        return self.hits / self.shots


class Difference(NamedTuple):
    """The hit rate of one controller less that of another in the same engagements."""

    difference: float
    """Difference of the rates, −1 to 1."""
    low: float
    """Lower end of its 95 % interval."""
    high: float
    """Upper end of its 95 % interval."""


class Misses(NamedTuple):
    """The misses, by what the gimbal was doing."""

    slewing: int
    """Misses fired early in the engagement, while the gimbal is given time to turn towards the target."""
    settled: int
    """Misses fired afterwards."""


def hit_rate(hit: ArrayLike) -> HitRate:
    """Count the hits and give the rate a 95 % interval clustered by engagement.

    Wilson's interval (1927) with two changes that survey statistics makes for clusters (Korn and Graubard 1998): n is
    divided by the design effect, the variance of the rate between engagements over what independent shots would have,
    and the normal quantile is Student's with (engagements − 1) degrees of freedom. The design effect is never taken
    below 1. Few misses say little about how they cluster, so it is estimated as though one miss more had been seen, in
    an engagement that missed throughout. With no miss at all the engagements alone count, as in the rule of three.

    Args:
      hit: whether each shot hit, shape (engagements, shots).

    Raises:
      InputError: if `hit` is not a table of true and false, or has fewer than 2 engagements or no shots.
    """
    hits = _checked("hit", hit)
    engagements, shots = hits.shape
    k, n = int(hits.sum()), hits.size
    low, high = _wilson(k / n, n / _design_effect(hits.sum(axis=1), shots), _quantile(engagements))
    return HitRate(k, n, engagements, low, high)


def _design_effect(hits_per_engagement: NDArray[np.int64], shots: int) -> float:
    engagements = len(hits_per_engagement)
    k, n = int(hits_per_engagement.sum()), engagements * shots
    rarer = min(k, n - k)
    if rarer == 0:
        return float(shots)
    variance_of_k = engagements * float(np.var(hits_per_engagement, ddof=1))
    estimated = variance_of_k / (k * (n - k) / n)
    return max(1.0, (rarer * estimated + shots) / (rarer + 1))


def _wilson(rate: float, trials: float, quantile: float) -> tuple[float, float]:
    shrink = 1 / (1 + quantile**2 / trials)
    centre = shrink * (rate + quantile**2 / (2 * trials))
    half_width = shrink * quantile * math.sqrt(rate * (1 - rate) / trials + (quantile / (2 * trials)) ** 2)
    # Rounding may carry an end past the rate when every shot hit, or none.
    return max(0.0, min(centre - half_width, rate)), min(1.0, max(centre + half_width, rate))


def paired_difference(hit_a: ArrayLike, hit_b: ArrayLike) -> Difference:
    """Compare two controllers that met the same engagements with the same dispersion draws.

    Student's interval of the mean difference between engagements. To its variance is added that of one engagement in
    which √shots more shots come out differently, so that the interval of two controllers that happened to agree in
    every shot still has a width; beside a real spread the addition is lost.

    Args:
      hit_a: whether each shot of the first controller hit, shape (engagements, shots).
      hit_b: the same for the second controller, in the same order.

    Raises:
      InputError: if the tables differ in shape, or either can't be given to `hit_rate`.
    """
    a, b = _checked("hit_a", hit_a), _checked("hit_b", hit_b)
    if a.shape != b.shape:
        raise InputError(f"hit_a and hit_b must be of the same engagements, got shapes {a.shape} and {b.shape}")
    engagements, shots = a.shape
    differences = a.mean(axis=1) - b.mean(axis=1)
    variance = float(np.var(differences, ddof=1)) / engagements + 1 / (shots * engagements**2)
    half_width = _quantile(engagements) * math.sqrt(variance)
    mean = (int(a.sum()) - int(b.sum())) / a.size
    return Difference(mean, max(-1.0, mean - half_width), min(1.0, mean + half_width))


def split_misses(hit: ArrayLike, shot_time: ArrayLike, settled_after: float) -> Misses:
    """Tell misses while the gimbal slews to the target from misses once it has settled.

    Args:
      hit: whether each shot hit, shape (engagements, shots).
      shot_time: when each shot was fired, from the start of its engagement [s], shape (shots,) or that of `hit`.
      settled_after: shots before this time count as slewing [s].

    Raises:
      InputError: if `hit` can't be given to `hit_rate` or `shot_time` has another shape.
    """
    hits, times = _checked("hit", hit), np.asarray(shot_time, dtype=np.float64)
    if times.shape not in (hits.shape, hits.shape[1:]):
        raise InputError(f"shot_time must have shape {hits.shape[1:]} or {hits.shape}, got {times.shape}")
    # A time step that is not a binary fraction adds up to a hair below its round sum.
    slewing = times < settled_after - 1e-6
    return Misses(int((~hits & slewing).sum()), int((~hits & ~slewing).sum()))


def _quantile(engagements: int) -> float:
    return float(stdtrit(engagements - 1, (1 + CONFIDENCE) / 2))


def _checked(name: str, hit: ArrayLike) -> Hits:
    hits = np.asarray(hit)
    if hits.dtype != np.bool_ or hits.ndim != 2:
        raise InputError(
            f"{name} must be booleans of shape (engagements, shots), got {hits.dtype} of shape {hits.shape}"
        )
    if hits.shape[0] < 2 or hits.shape[1] < 1:
        raise InputError(
            f"{name} has {hits.shape[0]} engagements of {hits.shape[1]} shots; "
            "an interval takes at least 2 engagements of 1 shot"
        )
    return hits

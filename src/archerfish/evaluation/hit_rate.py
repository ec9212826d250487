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
    """Shots that count, n: those fired, or one for each decision."""
    engagements: int
    """Independent engagements that the decisions fall into."""
    low: float
    """Lower end of the 95 % interval of the hit rate, 0 to 1."""
    high: float
    """Upper end of the 95 % interval of the hit rate, 0 to 1."""

    @property
    def rate(self) -> float:
        """Hits per shot, 0 to 1; NaN of no shots."""
        return self.hits / self.shots if self.shots else math.nan


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


def hit_rate(hit: ArrayLike, fired: ArrayLike | None = None) -> HitRate:
    """Count the hits and give the rate a 95 % interval clustered by engagement.

    Wilson's interval (1927) with two changes that survey statistics makes for clusters (Korn and Graubard 1998): n is
    divided by the design effect, the variance of the rate between engagements over what independent shots would have,
    and the normal quantile is Student's with (engagements − 1) degrees of freedom. The design effect is never taken
    below 1. Few misses say little about how they cluster, so it is estimated as though one miss more had been seen, in
    an engagement that missed throughout. With no miss at all the engagements alone count, as in the rule of three.

    Where the shots of an engagement vary in number, the rate is a ratio of two sums over engagements, and its variance
    that of the linearised ratio estimator (Cochran 1977). Engagements without a shot contribute nothing; with
    shots in fewer than two, the interval is 0 to 1.

    Args:
      hit: whether each decision hit, shape (engagements, decisions).
      fired: which decisions fired the shots that count, of the same shape; if not given, every decision counts.

    Raises:
      InputError: if `hit` is not a table of true and false, or has fewer than 2 engagements or no decisions; if `fired`
        is no such table of the same shape, or a decision hit without firing.
    """
    hits = _checked("hit", hit)
    counted = _counted(hits, fired)
    by_engagement, shots = hits.sum(axis=1), counted.sum(axis=1)
    k, n, shooting = int(by_engagement.sum()), int(shots.sum()), int(np.count_nonzero(shots))
    if shooting < 2:
        return HitRate(k, n, len(hits), 0.0, 1.0)
    low, high = _wilson(k / n, n / _design_effect(by_engagement, shots), _quantile(shooting))
    return HitRate(k, n, len(hits), low, high)


def _design_effect(hits: NDArray[np.int64], shots: NDArray[np.int64]) -> float:
    """Design effect of a rate, from hits and shots by engagement."""
    k, n, engagements = int(hits.sum()), int(shots.sum()), int(np.count_nonzero(shots))
    # Of an engagement as a shot meets it: what the design effect would be if the shots of each succeeded together.
    largest = float(np.sum(shots**2)) / n
    rarer = min(k, n - k)
    if rarer == 0:
        return largest
    variance_of_k = engagements / (engagements - 1) * float(np.sum((hits - k / n * shots) ** 2))
    estimated = variance_of_k / (k * (n - k) / n)
    return max(1.0, (rarer * estimated + largest) / (rarer + 1))


def _wilson(rate: float, trials: float, quantile: float) -> tuple[float, float]:
    shrink = 1 / (1 + quantile**2 / trials)
    centre = shrink * (rate + quantile**2 / (2 * trials))
    half_width = shrink * quantile * math.sqrt(rate * (1 - rate) / trials + (quantile / (2 * trials)) ** 2)
    # Rounding may carry an end past the rate when every shot hit, or none.
    return max(0.0, min(centre - half_width, rate)), min(1.0, max(centre + half_width, rate))


def paired_difference(
    hit_a: ArrayLike, hit_b: ArrayLike, fired_a: ArrayLike | None = None, fired_b: ArrayLike | None = None
) -> Difference:
    """Compare two controllers that met the same engagements with the same dispersion draws.

    Student's interval of the mean difference between engagements. To its variance is added that of one engagement in
    which √shots more shots come out differently, so that the interval of two controllers that happened to agree in
    every shot still has a width; beside a real spread the addition is lost.

    Where fired shots count, each rate is a ratio of two sums over engagements, and the variance is that of the
    difference of the two linearised ratio estimators (Cochran 1977), engagement by engagement. The degrees of freedom
    are those of the controller that fired in fewer engagements; in fewer than two, the interval is −1 to 1.

    Args:
      hit_a: whether each decision of the first controller hit, shape (engagements, decisions).
      hit_b: the same for the second controller, in the same order.
      fired_a: which decisions of the first fired the shots that count, as `hit_rate` takes it.
      fired_b: those of the second.

    Returns:
      The difference; NaN if either fired no shot that counts.

    Raises:
      InputError: if the tables differ in shape, or either can't be given to `hit_rate`.
    """
    a, b = _checked("hit_a", hit_a), _checked("hit_b", hit_b)
    if a.shape != b.shape:
        raise InputError(f"hit_a and hit_b must be of the same engagements, got shapes {a.shape} and {b.shape}")
    counted_a, counted_b = _counted(a, fired_a), _counted(b, fired_b)
    shots_a, shots_b = int(counted_a.sum()), int(counted_b.sum())
    shots = min(shots_a, shots_b)
    if not shots:
        return Difference(math.nan, -1.0, 1.0)
    # Over one denominator, so that equal rates differ by zero.
    difference = (int(a.sum()) * shots_b - int(b.sum()) * shots_a) / (shots_a * shots_b)
    engagements = min(int(np.count_nonzero(each.any(axis=1))) for each in (counted_a, counted_b))
    if engagements < 2:
        return Difference(difference, -1.0, 1.0)
    influence = _influence(a, counted_a) - _influence(b, counted_b)
    variance = engagements / (engagements - 1) * float(np.sum(influence**2)) + 1 / (shots * engagements)
    half_width = _quantile(engagements) * math.sqrt(variance)
    return Difference(difference, max(-1.0, difference - half_width), min(1.0, difference + half_width))


def _influence(hits: Hits, counted: Hits) -> NDArray[np.float64]:
    """Return what each engagement adds to the linearised ratio of hits to shots, shape (engagements,)."""
    shots = counted.sum(axis=1)
    return np.asarray((hits.sum(axis=1) - hits.sum() / shots.sum() * shots) / shots.sum())


def split_misses(hit: ArrayLike, shot_time: ArrayLike, settled_after: float, fired: ArrayLike | None = None) -> Misses:
    """Tell misses while the gimbal slews to the target from misses once it has settled.

    Args:
      hit: whether each decision hit, shape (engagements, decisions).
      shot_time: when each shot was fired, from the start of its engagement [s], shape (decisions,) or that of `hit`.
      settled_after: shots before this time count as slewing [s].
      fired: which decisions fired the shots that count, as `hit_rate` takes it.

    Raises:
      InputError: if `hit` can't be given to `hit_rate` or `shot_time` has another shape.
    """
    hits, times = _checked("hit", hit), np.asarray(shot_time, dtype=np.float64)
    missed = _counted(hits, fired) & ~hits
    if times.shape not in (hits.shape, hits.shape[1:]):
        raise InputError(f"shot_time must have shape {hits.shape[1:]} or {hits.shape}, got {times.shape}")
    # A time step that is not a binary fraction adds up to a hair below its round sum.
    slewing = times < settled_after - 1e-6
    return Misses(int((missed & slewing).sum()), int((missed & ~slewing).sum()))


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


def _counted(hits: Hits, fired: ArrayLike | None) -> Hits:
    """Return which decisions count: those that fired, or all."""
    if fired is None:
        return np.ones(hits.shape, bool)
    counted = np.asarray(fired)
    if counted.dtype != np.bool_ or counted.shape != hits.shape:
        raise InputError(f"fired must be booleans of shape {hits.shape}, got {counted.dtype} of shape {counted.shape}")
    if np.any(hits & ~counted):
        raise InputError(f"{int(np.sum(hits & ~counted))} decisions hit without firing; a hit takes a shot")
    return counted

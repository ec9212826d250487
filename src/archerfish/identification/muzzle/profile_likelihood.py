"""Confidence intervals from the profile of a likelihood (Wilks): all values that the data don't reject."""

import math
from collections.abc import Callable

from scipy.stats import chi2
from scipy.stats import t as student

_TRIES = 30
_NEAR = 4e-3
"""Of the root of the deviance, which is 1.96 at the end of a 95 % interval: the interval is right to 0.2 %."""


def mean_threshold(freedom: float, level: float = 0.95) -> float:
    """Return how far a sum of squares over estimated variances may rise for a parameter of the mean: t².

    Exact where the model is linear and the variances share one unknown factor, which is known with ν = `freedom`
    degrees of freedom; χ²₁ is its limit.
    """
    return float(student.ppf(0.5 + level / 2, freedom) ** 2)


def spread_threshold(freedom: float, level: float = 0.95) -> float:
    """Return how far a deviance may rise above its minimum for a standard deviation: χ²₁ with Bartlett's correction.

    The rise for a variance with ν = `freedom` has the mean 1 + 1/(3 ν), up to higher powers of 1/ν.
    """
    return float(chi2.ppf(level, 1) * (1 + 1 / (3 * freedom)))


def interval_end(rise: Callable[[float], float], allowed: float, best: float, stride: float, end: float) -> float:
    """Walk from the best value towards `end` until the deviance has risen by what is allowed.

    The square root of the rise is nearly a straight line, so the rule of false position finds the end in a few calls.

    Args:
      rise: profile of the deviance less its minimum; zero at `best`.
      allowed: rise at the end of the interval.
      best: the estimate.
      stride: first step, about as long as this half of the interval is likely to be.
      end: where the search ends.

    Returns:
      Where the rise is as allowed, or `end` if it never gets so far.
    """
    inside, below = best, -math.sqrt(allowed)
    while abs(end - inside) > 1e-9 * max(1.0, abs(end)):
        outside = inside + math.copysign(min(stride, abs(end - inside)), end - inside)
        above = _root_excess(rise, allowed, outside)
        if above > 0:
            return _false_position(lambda value: _root_excess(rise, allowed, value), inside, below, outside, above)
        inside, below, stride = outside, above, 1.5 * stride
    return end


def _root_excess(rise: Callable[[float], float], allowed: float, value: float) -> float:
    return math.sqrt(max(rise(value), 0.0)) - math.sqrt(allowed)


def _false_position(
    function: Callable[[float], float], inside: float, below: float, outside: float, above: float
) -> float:
    """Find the zero between two places with values below and above zero (the Illinois variant)."""
    place, previous = outside, 0.0
    for _ in range(_TRIES):
        place = inside + (outside - inside) * below / (below - above)
        value = function(place)
        if abs(value) < _NEAR:
            break
        if value < 0:
            # An end that stays is given half its weight, or the rule would creep towards the other one.
            inside, below, above = place, value, above / (2.0 if previous < 0 else 1.0)
        else:
            outside, above, below = place, value, below / (2.0 if previous > 0 else 1.0)
        previous = value
    return place

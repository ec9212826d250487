"""Confidence intervals from the profile of a likelihood (Wilks): all values that the data don't reject."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

Array = NDArray[np.float64]
NegativeLogLikelihood = Callable[[Array], float]
Bounds = list[tuple[float, float]]


def maximise_likelihood(function: NegativeLogLikelihood, starts: list[Array], bounds: Bounds) -> Array:
    """Return the best local optimum that is reached from the starts, shape (q,)."""
    found = [_minimise(function, start, bounds) for start in starts]
    return min(found, key=function)


def profile_interval(
    function: NegativeLogLikelihood, best: Array, index: int, bounds: Bounds, level: float = 0.95
) -> tuple[float, float]:
    """Interval of one parameter: where the likelihood, maximised over the others, stays within χ²₁(level)/2 of its top.

    A side on which it never falls so far ends at the bound.

    Args:
      function: negative log-likelihood of q parameters.
      best: its minimum, shape (q,).
      index: which parameter.
      bounds: low and high end of each parameter.
      level: confidence level.
    """
    drop = chi2.ppf(level, 1) / 2
    stride = np.sqrt(2 * drop) * _spread(function, best, index, bounds)
    low, high = (
        _crossing(function, best, index, bounds, drop, stride, end) for end in (bounds[index][0], bounds[index][1])
    )
    return low, high


def _crossing(
    function: NegativeLogLikelihood,
    best: Array,
    index: int,
    bounds: Bounds,
    drop: float,
    stride: float,
    end: float,
) -> float:
    """Walk from the best value towards `end` in growing strides along the profile, then find the crossing."""
    allowed, others, inside = function(best) + drop, best, float(best[index])

    def excess(value: float) -> float:
        return function(_profiled(function, others, index, value, bounds)) - allowed

    while abs(end - inside) > 1e-9 * max(1.0, abs(end)):
        outside = inside + np.copysign(min(stride, abs(end - inside)), end - inside)
        if excess(outside) > 0:
            return float(brentq(excess, inside, outside, xtol=1e-3 * abs(outside - inside), maxiter=30))
        others, inside, stride = _profiled(function, others, index, outside, bounds), outside, 1.5 * stride
    return end


def _spread(function: NegativeLogLikelihood, best: Array, index: int, bounds: Bounds) -> float:
    """Guess a parameter's standard error from the curvature at the optimum, within the range of its bounds."""
    width = bounds[index][1] - bounds[index][0]
    steps = [1e-3 * (high - low) for low, high in bounds]
    moves = np.diag(steps)
    curvature = np.array(
        [
            [
                function(best + a + b) - function(best + a - b) - function(best - a + b) + function(best - a - b)
                for b in moves
            ]
            for a in moves
        ]
    ) / (4 * np.outer(steps, steps))
    variance = np.linalg.pinv(curvature, hermitian=True)[index, index]
    return float(np.clip(np.sqrt(variance) if variance > 0 else 0.05 * width, 1e-3 * width, 0.2 * width))


def _profiled(function: NegativeLogLikelihood, start: Array, index: int, value: float, bounds: Bounds) -> Array:
    """Return the parameters that maximise the likelihood with one of them held."""
    free = np.arange(start.size) != index
    point = start.copy()
    point[index] = value

    def restricted(values: Array) -> float:
        point[free] = values
        return function(point)

    point[free] = _minimise(restricted, start[free], [bound for bound, keep in zip(bounds, free, strict=True) if keep])
    return point


def _minimise(function: NegativeLogLikelihood, start: Array, bounds: Bounds) -> Array:
    return np.asarray(minimize(function, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 300}).x)

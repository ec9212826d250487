"""Restricted maximum likelihood (REML) of variance components.

Residuals r ~ N(X β, V) with V = Σ_j σ_j² a_j, a_j a known diagonal. Full likelihood divides squared residuals by their
number and so makes the σ_j too small by the share of the fitted parameters; the restricted one, of what is left when β
is projected out (Patterson and Thompson 1971), doesn't:

    −2 ℓ_R = Σ log V + r̃ᵀ V⁻¹ r̃ + log det(Xᵀ V⁻¹ X).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_POINTS = 17
"""Of the grid over the ratio of two variances; it is refined twice around its best point."""


class Residuals(NamedTuple):
    """Residuals of N measurements, and what they consist of."""

    residual: Array
    """Measured less expected, shape (N,)."""
    columns: Array
    """X: what is not scatter, shape (N, p)."""
    scales: Array
    """a_j: variance of each measurement per unit variance of each component, shape (c, N), c of 1 or 2."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom, N − p."""
        return int(self.residual.size - self.columns.shape[1])


def deviance(residuals: Residuals, variances: Array) -> Array:
    """Return −2 ℓ_R for several sets of variances, shape (G, c) → (G,), up to a constant."""
    squares, logarithms = _parts(residuals, variances @ residuals.scales)
    return squares + logarithms


def fit_variances(residuals: Residuals) -> Array:
    """Return the variances that maximise the restricted likelihood, shape (c,).

    Of two variances the common factor has a closed form, and their ratio is sought on a grid, where a maximum at the
    edge (one of them is zero) is as good as any.
    """
    size, freedom = residuals.scales.mean(axis=1), residuals.freedom
    if size.size == 1:
        return np.asarray(_parts(residuals, residuals.scales)[0] / freedom)

    def sets(share: Array) -> Array:
        return np.asarray(np.stack([share, 1.0 - share], axis=1) / size)

    def profile(share: Array) -> Array:
        squares, logarithms = _parts(residuals, sets(share) @ residuals.scales)
        return np.asarray(logarithms + freedom * np.log(squares))

    best = sets(np.array([_grid_minimum(profile, 0.0, 1.0)[0]]))
    return np.asarray(best[0] * _parts(residuals, best @ residuals.scales)[0] / freedom)


def profile_deviance(residuals: Residuals, component: int, variance: float) -> float:
    """Return −2 ℓ_R at a given variance of one component, minimised over the other one."""
    if len(residuals.scales) == 1:
        return float(deviance(residuals, np.array([[variance]]))[0])
    other = 1 - component
    # Twice what all of the scatter would make: no maximum lies beyond.
    most = np.sqrt(2.0 * np.mean(residuals.residual**2 / residuals.scales[other]))

    def at(sd: Array) -> Array:
        sets = np.full((sd.size, 2), variance)
        sets[:, other] = sd**2
        return deviance(residuals, sets)

    # Both variances zero would have no density.
    return _grid_minimum(at, 1e-4 * most, most)[1]


def variance_information(residuals: Residuals, variances: Array) -> Array:
    """Return the expected information on the logarithms of the standard deviations, shape (c, c) from (c,)."""
    parts = 2.0 * (variances[:, None] * residuals.scales) / (variances @ residuals.scales)
    return np.asarray(0.5 * parts @ parts.T)


def _grid_minimum(function: Callable[[Array], Array], low: float, high: float) -> tuple[float, float]:
    """Return place and value of the least value on [low, high], by a grid that is refined around its best point."""
    for _ in range(3):
        grid = np.linspace(low, high, _POINTS)
        values = function(grid)
        best, stride = int(np.argmin(values)), grid[1] - grid[0]
        low, high = max(low, grid[best] - stride), min(high, grid[best] + stride)
    return float(grid[best]), float(values[best])


def _parts(residuals: Residuals, total: Array) -> tuple[Array, Array]:
    """Weighted squares that X leaves, and the logarithms of the determinants, for several V: (G, N) → (G,) each."""
    columns = residuals.columns
    weighted = residuals.residual / total
    products = (columns.T / total[:, None, :]) @ columns
    # A trace of a ridge keeps a column without any influence from stopping it.
    ridge = 1e-12 * np.trace(products, axis1=1, axis2=2) + 1e-300
    products = products + ridge[:, None, None] * np.eye(columns.shape[1])
    slopes = weighted @ columns
    moves = np.linalg.solve(products, slopes[..., None])[..., 0]
    squares = weighted @ residuals.residual - np.sum(slopes * moves, axis=1)
    return squares, np.log(total).sum(axis=1) + np.linalg.slogdet(products)[1]

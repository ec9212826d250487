"""Poles to start from: vector fitting (Gustavsen and Semlyen 1999) on parallel sections."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag, lstsq

from archerfish2.identification.axis.output_error import LinearFit, cost_of, project, solve
from archerfish2.identification.axis.sections import Sections, order_of, sections_from_poles
from archerfish2.identification.axis.spectrum import Lines
from archerfish2.identification.simulation import TINY

_Spread = tuple[float, float, int]
SPREADS = ((0.1, 3.0, 0), (0.1, 0.5, 0), (0.7, 3.0, 0), (0.1, 3.0, 2))
"""Damping and highest frequency [rad/sample] of pairs that are spread over the band, real poles beside them."""


def vector_fit(sections: Sections, data: list[Lines], rounds: int) -> LinearFit:
    """Return the best of some rounds of vector fitting."""
    best = fit = solve(sections, data)
    for _ in range(rounds):
        fit = solve(_relocated(fit, data), data)
        best = min(best, fit, key=cost_of)
    return best


def vector_fits(
    data: list[Lines], order: int, rounds: int = 5, extra: int = 2, spreads: Sequence[_Spread] = SPREADS
) -> list[LinearFit]:
    """Return vector fits of an order, and of a higher one of which the sections are kept that explain most, best first.

    Args:
      data: lines of all logs.
      order: number of poles.
      rounds: of relocation.
      extra: poles of the higher order more; 0: none.
      spreads: of the poles that are relocated.
    """
    found = [vector_fit(_spread(data, order, *each), data, rounds) for each in spreads]
    for each in spreads if extra else ():
        larger = vector_fit(_spread(data, order + extra, *each), data, rounds).sections
        found += sorted((solve(kept, data) for kept in subsets(larger, order)), key=cost_of)[:2]
    return distinct(found)


def subsets(sections: Sections, order: int) -> Sequence[Sections]:
    """Return the choices of some of the sections that have an order, at most twenty."""
    kept = (each for k in range(1, len(sections)) for each in combinations(sections, k) if order_of(each) == order)
    return list(kept)[:20]


def distinct(fits: Sequence[LinearFit], most: int = 8) -> list[LinearFit]:
    """Return the best fits whose sums of squares differ by more than 1 %, best first."""
    kept: list[LinearFit] = []
    for fit in sorted(fits, key=cost_of):
        if not kept or fit.cost > 1.01 * kept[-1].cost:
            kept.append(fit)
    return kept[:most]


def _relocated(fit: LinearFit, data: list[Lines]) -> Sections:
    """Zeros of σ = 1 + Σ c state where σ Y is fitted with the poles of a fit; all outputs share σ."""
    both = zip(data, fit.logs, strict=True)
    sigma = [-((log.states * e.z)[:, None] * e.outputs).reshape(-1, len(e.z)) for e, log in both]
    columns = project(fit, sigma).reshape(order_of(fit.sections), -1)
    size = np.linalg.norm(columns, axis=1) + TINY
    scaled = (columns / size[:, None]).T
    c = lstsq(scaled, fit.residual.reshape(-1), lapack_driver="gelsy", cond=1e-12)[0] / size
    A = block_diag(*(np.column_stack([-s, np.eye(len(s), len(s) - 1)]) for s in fit.sections))
    first = np.concatenate([np.eye(len(s))[0] for s in fit.sections])
    return sections_from_poles(np.linalg.eigvals(A - np.outer(c, first)).astype(complex))


def _spread(data: list[Lines], order: int, damping: float, highest: float, real: int) -> Sections:
    """Pairs spread over the band from its lowest lines, and real poles beside them."""
    low = min(float(-np.angle(lines.z[0])) for lines in data)
    real = min(real, order // 2 * 2) + order % 2
    pairs = (order - real) // 2
    w = np.geomspace(min(4 * low, 0.1), highest, max(pairs, 1))[:pairs]
    p = np.exp(w * (-damping + 1j * np.sqrt(1 - damping**2)))
    lags = np.geomspace(0.1, low, real) if real > 1 else np.full(real, 0.1)
    return sections_from_poles(np.concatenate([p, p.conj(), np.exp(-lags)]))

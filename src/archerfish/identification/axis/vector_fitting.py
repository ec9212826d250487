"""Coarse fits: poles by vector fitting (Gustavsen and Semlyen 1999) on parallel sections, for each delay."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag, lstsq
from scipy.special import chdtri

from archerfish.identification.axis.output_error import (
    LinearFit,
    cost_of,
    noise_colour,
    project,
    refine,
    refine_best,
    residuals_by_log,
    solve,
)
from archerfish.identification.axis.sections import Sections, order_of, sections_from_poles
from archerfish.identification.axis.spectrum import (
    Experiment,
    Lines,
    lines_of,
    rounding_floor,
    thinned,
    unsettled_samples,
)
from archerfish.identification.simulation import TINY, Complex

_Spread = tuple[float, float, int]
SPREADS = ((0.1, 3.0, 0), (0.1, 0.5, 0), (0.7, 3.0, 0), (0.1, 3.0, 2))
"""Damping and highest frequency [rad/sample] of pairs that are spread over the band, real poles beside them."""
_GRID = (0, 2, 5, 10, 15, 20)  # delays that are tried first
_LINES = 400  # of all logs
_CONTRADICTED = 1e-2  # probability at which noise alone makes a rest look like motion

DelayTable = Mapping[int, LinearFit]
"""A coarse fit for each delay that was tried."""


def search_delays(
    experiments: Sequence[Experiment], order: int, delays: tuple[int, int]
) -> tuple[list[Experiment], DelayTable]:
    """Fit some delays coarsely, and correct how the logs begin.

    A log that a free initial state fits significantly better is not treated as beginning at rest.

    Args:
      experiments: logs.
      order: number of poles.
      delays: least and largest; the same for a delay that is given.
    """
    logs, table = list(experiments), _delay_table(experiments, order, delays)
    best = min(table, key=lambda delay: table[delay].cost)
    moved = [log for log in logs if log.pad and _in_motion(logs, log, table[best].sections, best)]
    if moved:
        logs = [replace(log, pad=0, skip=unsettled_samples(log.u, delays[1])) if log in moved else log for log in logs]
        table = _delay_table(logs, order, delays)
    return logs, table


def _delay_table(experiments: Sequence[Experiment], order: int, delays: tuple[int, int]) -> DelayTable:
    """Fit some delays on a few lines: a grid, bisected around the best, doubled while the best lies at its end."""
    lowest, highest = delays
    picks, tried = thinned(experiments, _LINES), dict[int, LinearFit]()
    most = max(highest, min(len(log.u) for log in experiments) // 8) if lowest < highest else highest
    waiting = [delay for delay in _GRID if delay <= highest] if lowest < highest else [lowest]
    while waiting:
        for delay in waiting:
            tried[delay] = _coarse_fit(lines_of(experiments, picks, delay), order, list(tried.values()))
        here = min(tried, key=lambda delay: tried[delay].cost)
        below = max((delay for delay in tried if delay < here), default=here)
        above = min((delay for delay in tried if delay > here), default=here)
        waiting = sorted({(below + here) // 2, (here + above + 1) // 2} - tried.keys())
        if min(highest, _GRID[-1]) <= here == max(tried) < most:
            waiting.append(min(2 * max(here, 1), most))
    return tried


def _coarse_fit(data: list[Lines], order: int, others: list[LinearFit]) -> LinearFit:
    """Fit from spread poles, and from those of the best of other delays' fits if there are some."""
    if others:
        starts = [vector_fit(min(others, key=cost_of).sections, data, 3)]
        starts += vector_fits(data, order, 4, 0, SPREADS[:2])
    else:
        starts = vector_fits(data, order, 4, 2, SPREADS)
    return refine_best([fit.sections for fit in distinct(starts, 2)], data, 6, 1e-4)


def _in_motion(logs: list[Experiment], extended: Experiment, sections: Sections, delay: int) -> bool:
    """Return whether a free initial state fits a log better than noise allows, 2 Δ log L > χ², which begins at rest."""
    # All logs together, as a log alone explains with other poles what is no rest.
    free = [replace(log, pad=0) if log is extended else log for log in logs]
    at_rest = refine(sections, [log.at(delay) for log in logs], 12, 1e-5)
    data = [log.at(delay) for log in free]
    with_free_state = refine(sections, data, 12, 1e-5)
    place = logs.index(extended)
    residual = residuals_by_log(with_free_state, data)[place]
    colour = noise_colour(residual, free[place].outputs - residual)
    samples = sum(log.measured for log in free) * len(residual) / colour
    least = rounding_floor(free)
    gain = samples * np.log(max(at_rest.cost, least) / max(with_free_state.cost, least))
    return bool(gain > chdtri(order_of(sections), _CONTRADICTED))


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
    found = [vector_fit(_spread(data, order, *spread), data, rounds) for spread in spreads]
    for spread in spreads if extra else ():
        larger = vector_fit(_spread(data, order + extra, *spread), data, rounds).sections
        found += sorted((solve(kept, data) for kept in subsets(larger, order)), key=cost_of)[:2]
    return distinct(found)


def subsets(sections: Sections, order: int) -> Sequence[Sections]:
    """Return the choices of some of the sections that have an order, at most twenty."""
    chosen = list[Sections]()
    for count in range(1, len(sections)):
        chosen += [kept for kept in combinations(sections, count) if order_of(kept) == order]
    return chosen[:20]


def distinct(fits: Sequence[LinearFit], most: int = 8) -> list[LinearFit]:
    """Return the best fits whose sums of squares differ by more than 1 %, best first."""
    kept: list[LinearFit] = []
    for fit in sorted(fits, key=cost_of):
        if not kept or fit.cost > 1.01 * kept[-1].cost:
            kept.append(fit)
    return kept[:most]


def _relocated(fit: LinearFit, data: list[Lines]) -> Sections:
    """Zeros of σ = 1 + Σ c state where σ Y is fitted with the poles of a fit; all outputs share σ."""
    sigma = list[Complex]()
    for lines, log in zip(data, fit.logs, strict=True):
        products = (log.states * lines.z)[:, None] * lines.outputs
        sigma.append(-products.reshape(-1, len(lines.z)))
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
    frequencies = np.geomspace(min(4 * low, 0.1), highest, max(pairs, 1))[:pairs]
    poles = np.exp(frequencies * (-damping + 1j * np.sqrt(1 - damping**2)))
    lags = np.geomspace(0.1, low, real) if real > 1 else np.full(real, 0.1)
    return sections_from_poles(np.concatenate([poles, poles.conj(), np.exp(-lags)]))

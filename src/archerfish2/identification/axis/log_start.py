"""How a log begins: at a rest that may be put before it, settled, or in a motion whose past the inputs don't show.

A log that begins at rest is extended backwards by its own length, which more than halves the scatter of the steady gain
of one step. Two guards: a rest that a free start contradicts is none, and where inputs from before the log still act
its first samples, as many as the longest delay, are left out for every delay.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from archerfish2.identification.axis.output_error import LinearFit, cost_of, refine, residuals_by_log
from archerfish2.identification.axis.sections import Sections, order_of
from archerfish2.identification.axis.spectrum import Experiment
from archerfish2.identification.simulation import Array

ROUNDING = 1e-16
"""Of the outputs' power; no residual counts as smaller."""
_CONTRADICTED = 1e-2  # probability at which noise alone makes a rest look like motion
_CLEANER = 0.7  # residual's power without the first samples over that with them, from which on they are left out
_HELD = 1e-9  # of an input's range, within which it counts as held

Table = Mapping[int, LinearFit]
"""A coarse fit for each delay that was tried."""


def rounding_floor(experiments: Sequence[Experiment]) -> float:
    """Return the sum of squares below which a residual is rounding."""
    return ROUNDING * sum(float(np.sum(np.abs(e.outputs) ** 2)) for e in experiments) + 1e-300


def resting_samples(u: Array, y: Array) -> int:
    """Return for how many samples, from the first, inputs are held and no output changes by more than noise.

    Args:
      u: inputs, shape (N, m).
      y: outputs, shape (N, p).
    """
    n = int(np.argmax((np.abs(u - u[0]) > _HELD * np.ptp(u, axis=0)).any(1)))
    if n < 2:
        return 0
    third = max(1, n // 3)
    change = np.abs(y[n - third : n].mean(0) - y[:third].mean(0))
    noise = np.std(np.diff(y[:n], axis=0), axis=0) / np.sqrt(2) if n > 2 else np.zeros(y.shape[1])
    still = change <= np.maximum(0.01 * np.ptp(y, axis=0), 6 * noise * np.sqrt(2 / third))
    return n if np.all(still & (y[:n].std(0) <= 0.3 * y.std(0))) else 0


def mostly_held(u: Array) -> bool:
    """Return whether inputs, shape (N, m), are held for most of a log, as those of steps are."""
    still = np.abs(np.diff(u, axis=0)) <= _HELD * np.ptp(u, axis=0)
    return bool(np.mean(np.all(still, axis=1)) > 0.5)


def first_guess(u: Array, y: Array, longest: int) -> Experiment:
    """Return a log, extended by its rest if it has one and its inputs are mostly held.

    Args:
      u: inputs, shape (N, m).
      y: outputs, shape (N, p).
      longest: delay that is considered [samples].
    """
    if rest := resting_samples(u, y):
        return Experiment(u, y, pad=len(y) if mostly_held(u) else 0, rest=rest)
    return Experiment(u, y, skip=_unsettled(u, longest))


def guarded(
    experiments: list[Experiment], longest: int, search: Callable[[list[Experiment]], Table]
) -> tuple[list[Experiment], Table]:
    """Correct the first guesses by what the logs say, and return them with the coarse fits of the delays.

    Args:
      experiments: logs as of `first_guess`.
      longest: delay that is considered [samples].
      search: makes the coarse fits.
    """
    table = search(experiments)
    best = min(table, key=lambda delay: table[delay].cost)
    moved = [e for e in experiments if e.pad and _in_motion(experiments, e, table[best].sections, best)]
    if moved:
        experiments = [replace(e, pad=0, skip=_unsettled(e.u, longest)) if e in moved else e for e in experiments]
        table = search(experiments)
    # Where inputs move most at the beginning those samples are worth much: they go only if they fit worse than others.
    cut = [replace(e, skip=longest) if not e.pad and not resting_samples(e.u, e.y) else e for e in experiments]
    if any(e.skip > f.skip for e, f in zip(cut, experiments, strict=True)):
        other, least = search(cut), rounding_floor(experiments)
        if _power(other, cut, least) < _CLEANER * _power(table, experiments, least):
            return cut, other
    return experiments, table


def _unsettled(u: Array, longest: int) -> int:
    """Count the samples on which inputs from before the log act; none where the inputs move most at its beginning."""
    moves = np.diff(u, axis=0) ** 2
    share = moves[:longest].sum(0) / np.maximum(moves.sum(0), 1e-300)
    return longest if longest and share.max() <= 2 * longest / len(moves) else 0


def _in_motion(experiments: list[Experiment], extended: Experiment, sections: Sections, delay: int) -> bool:
    """Whether a free start explains a log better than the noise allows, 2 Δ log L > χ², which begins at a rest."""
    # All logs together, as a log alone explains with other poles what is no rest.
    free = [replace(e, pad=0) if e is extended else e for e in experiments]
    data = [[e.at(delay) for e in each] for each in (experiments, free)]
    at_rest, loose = (refine(sections, each, 12, 1e-5) for each in data)
    place = experiments.index(extended)
    residual = residuals_by_log(loose, data[1])[place]
    response, noise = np.abs(free[place].outputs - residual) ** 2, np.abs(residual) ** 2
    # Noise that is stronger where the plant responds is worth as much as fewer white samples.
    colour = max(1.0, float(np.sum(noise * response) / max(np.mean(noise) * np.sum(response), 1e-300)))
    samples, least = sum(e.measured for e in free) * len(residual) / colour, rounding_floor(free)
    gain = samples * np.log(max(at_rest.cost, least) / max(loose.cost, least))
    return bool(gain > chdtri(order_of(sections), _CONTRADICTED))


def _power(table: Table, experiments: list[Experiment], least: float) -> float:
    return max(least, min(map(cost_of, table.values()))) / sum(e.measured for e in experiments)

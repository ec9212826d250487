"""How a log begins: at rest, settled, or in a motion that its inputs don't show.

A log that begins at rest is extended backwards by its own length, which more than halves the scatter of the steady gain
of one step. Of a log that begins in a motion, the first samples are left out. No plant is fitted here.
"""

import numpy as np

from archerfish2.identification.axis.spectrum import Experiment
from archerfish2.identification.simulation import TINY, Array

_HELD = 1e-9  # of an input's range, within which it counts as held


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


def begun_log(u: Array, y: Array, longest: int) -> Experiment:
    """Return a log, extended by its rest if it has one and its inputs are mostly held.

    Args:
      u: inputs, shape (N, m).
      y: outputs, shape (N, p).
      longest: delay that is considered [samples].
    """
    if rest := resting_samples(u, y):
        return Experiment(u, y, pad=len(y) if mostly_held(u) else 0, rest=rest)
    return Experiment(u, y, skip=unsettled_samples(u, longest))


def unsettled_samples(u: Array, longest: int) -> int:
    """Return how many samples of a log inputs from before it may act on; 0 where its inputs move most at its beginning.

    Args:
      u: inputs, shape (N, m).
      longest: delay that is considered [samples].
    """
    moves = np.diff(u, axis=0) ** 2
    share = moves[:longest].sum(0) / np.maximum(moves.sum(0), TINY)
    return longest if longest and share.max() <= 2 * longest / len(moves) else 0

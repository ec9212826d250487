"""What an input's own past does not foretell: the only part of it in which feedback can show.

A sweep or a multisine foretells itself. Whatever a plant misses of the answer to it (a limit, friction, a mode) is a
function of the same signal, so inputs that are still to come seem to explain it, without any feedback. A controller
that answers to noise makes inputs that their past can't foretell.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MEMORY = 30
"""Past samples from which an input is foretold."""
_BLOCK = 600
"""Samples over which one linear rule is to foretell it: a sweep changes its frequency."""
_LEAST = 1e-2
"""Share of an input's standard deviation below which what is not foretold is rounding, or the rule's own error."""


def surprises(signal: Array) -> Array:
    """Return what a signal's last 30 values don't foretell linearly, block by block.

    Args:
      signal: shape (N,).

    Returns:
      Shape (N,); zero for the first samples, and throughout a block whose signal all but foretells itself.
    """
    found, count = np.zeros(signal.size), signal.size
    if count < 4 * MEMORY:
        return found
    edges = np.linspace(MEMORY, count, max(1, (count - MEMORY) // _BLOCK) + 1).astype(int)
    for start, stop in itertools.pairwise(edges.tolist()):
        past = np.column_stack([signal[start - lag : stop - lag] for lag in range(1, MEMORY + 1)])
        columns = np.hstack([past, np.ones((stop - start, 1))])
        triangle = np.asarray(np.linalg.qr(np.column_stack([columns, signal[start:stop]]), mode="r"))
        rule = np.linalg.lstsq(triangle[:, :-1], triangle[:, -1], rcond=1e-10)[0]
        left = signal[start:stop] - columns @ rule
        if left.std() > _LEAST * signal[start - MEMORY : stop].std():
            found[start:stop] = left
    return found

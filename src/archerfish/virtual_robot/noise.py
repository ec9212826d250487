"""Random numbers of a batch of trials: each trial has its own streams, so the batch that it is in changes nothing."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Purpose → numbers in a row, their distribution, and rows that are drawn at once: enough to make the call cheap, few
# enough for the memory of large batches. The place in the table is part of the seed, so new ones go to the end.
_STREAMS = {
    "gyro": (2, "normal", 512),
    "command": (2, "uniform", 64),
    "feedback": (2, "uniform", 512),
    "camera": (4, "normal", 64),
    "detection": (2, "uniform", 64),
    "speed": (1, "normal", 64),
}


class NoiseStream:
    """Rows of standard normals or uniform numbers, a sequence for each trial, the same in whatever pieces it is read.

    A call may read rows from the one on at which the call before began; those before it are forgotten.
    """

    def __init__(self, seeds: NDArray[np.int64], purpose: str) -> None:
        """Begin at row 0, for trials of some seeds, shape (B,), and one of the purposes of the table."""
        width, kind, self._block = _STREAMS[purpose]
        number = list(_STREAMS).index(purpose)
        generators = [np.random.Generator(np.random.Philox([int(seed), number])) for seed in seeds]
        self._draws = [source.standard_normal if kind == "normal" else source.random for source in generators]
        self._first = 0
        self._rows = np.empty((len(seeds), 0, width))

    def rows(self, start: int, count: int) -> Array:
        """Return rows `start` to `start + count` (exclusive) of every trial, shape (B, count, width)."""
        self._draw(start, start + count)
        return self._rows[:, start - self._first : start - self._first + count]

    def rows_at(self, index: NDArray[np.int64]) -> Array:
        """Return each trial's rows of its own indices, shape (B, N) → (B, N, width)."""
        self._draw(int(index.min()), int(index.max()) + 1)
        return self._rows[np.arange(len(index))[:, None], index - self._first]

    def _draw(self, low: int, high: int) -> None:
        trials, held, width = self._rows.shape
        last = self._first + held
        if high <= last:
            return
        drawn = np.empty((trials, max(self._block, high - last), width))
        for draw, rows in zip(self._draws, drawn, strict=True):
            draw(out=rows)
        kept = min(low, last)
        self._rows = np.concatenate([self._rows[:, kept - self._first :], drawn], axis=1)
        self._first = kept

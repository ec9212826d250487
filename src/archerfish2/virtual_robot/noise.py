"""Random numbers of a batch of trials: each has streams of its own, so the company that it is in changes nothing."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError

Array = NDArray[np.float64]
Kind = Literal["normal", "uniform"]

PURPOSES = ("gyro", "command", "feedback", "camera", "detection", "speed")
"""What a stream is for; its place is part of the seed, so new ones go to the end."""
_BLOCK = 512
"""Rows that are drawn at once: enough to make the call cheap, few enough for the memory of large batches."""


def check_seeds(seeds: NDArray[np.int64], batch: int) -> NDArray[np.int64]:
    """Return the seeds of a batch, checked: whole numbers from 0 on, shape (B,).

    Raises:
      InputError: if there are more or fewer than the batch has trials, or one is no such number.
    """
    found = np.atleast_1d(np.asarray(seeds))
    if found.shape != (batch,) or found.dtype.kind not in "iu" or np.any(found < 0):
        raise InputError(f"seeds must be {batch} whole numbers from 0 on, shape ({batch},), got {seeds!r}")
    return found.astype(np.int64)


class NoiseStream:
    """Rows of random numbers, a sequence for each trial; row k is the same however the rows are fetched."""

    def __init__(self, seeds: NDArray[np.int64], purpose: str, width: int, kind: Kind, block: int = _BLOCK) -> None:
        number = PURPOSES.index(purpose)
        self._generators = [np.random.Generator(np.random.Philox([int(seed), number])) for seed in seeds]
        self._kind = kind
        self._width = width
        self._block = block
        self._first = 0
        self._rows = np.empty((0, len(seeds), width))
        self._trials = np.arange(len(seeds))

    def rows(self, start: int, count: int) -> Array:
        """Return rows `start` to `start + count` (exclusive) of every trial, shape (count, B, width).

        Rows before `start` are given back: a later call must not ask for them.
        """
        self._hold(start, start + count)
        return self._rows[start - self._first : start - self._first + count]

    def rows_at(self, index: NDArray[np.int64]) -> Array:
        """Return each trial's rows of its own indices, shape (B, N) → (B, N, width); earlier ones are given back."""
        if index.size == 0:
            return np.empty((*index.shape, self._width))
        self._hold(int(index.min()), int(index.max()) + 1)
        return self._rows[index - self._first, self._trials[:, None]]

    def _hold(self, low: int, high: int) -> None:
        last = self._first + len(self._rows)
        if high <= last:
            return
        count = max(self._block, high - last)
        drawn = np.empty((count, len(self._generators), self._width))
        for trial, generator in enumerate(self._generators):
            shape = (count, self._width)
            drawn[:, trial] = generator.standard_normal(shape) if self._kind == "normal" else generator.random(shape)
        kept = max(min(low, last), self._first)
        self._rows = np.concatenate([self._rows[kept - self._first :], drawn])
        self._first = kept

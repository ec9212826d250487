"""One triangular factor of all lags of inputs and outputs, from which every linear regression on them follows.

ARX models of any order and subspace methods regress shifted signals on one another. With the QR factorisation of the
matrix of all shifts done once, each of them is a small problem in the columns of R.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.recording import Recording

Array = NDArray[np.float64]

MOST_LAGS = 30
_ROWS_PER_COLUMN = 3
_MOST_ROWS = 5000
"""First guesses need no more; of longer recordings every few samples begin a row."""


class LagFactor(NamedTuple):
    """R of the shifted signals, a constant of each recording taken out."""

    triangle: Array
    """Shape (c, c): the outputs with lags 0…L each, then the inputs with lags 0…L each."""
    lags: int
    """L."""
    outputs: int
    """Number of outputs p."""
    inputs: int
    """Number of inputs m."""

    def output(self, lags: Sequence[int]) -> Array:
        """Columns of all outputs at some lags, shape (c, p · number of lags): lag by lag, output by output."""
        return self._columns(range(self.outputs), lags)

    def input(self, lags: Sequence[int]) -> Array:
        """Columns of all inputs at some lags, shape (c, m · number of lags): lag by lag, input by input."""
        return self._columns(range(self.outputs, self.outputs + self.inputs), lags)

    def _columns(self, signals: Sequence[int], lags: Sequence[int]) -> Array:
        return self.triangle[:, [signal * (self.lags + 1) + lag for lag in lags for signal in signals]]


def factor_lags(recordings: Sequence[Recording], order: int) -> LagFactor:
    """Factorise the shifted signals of recordings, with as many lags as they bear.

    Args:
      recordings: m inputs and p outputs each.
      order: lags that there must be at least.
    """
    outputs, inputs = recordings[0].outputs.shape[1], recordings[0].inputs.shape[1]
    shortest = min(len(each) for each in recordings)
    samples = sum(len(each) for each in recordings)
    lags = min(MOST_LAGS, shortest // 3, samples // (_ROWS_PER_COLUMN * (outputs + inputs)))
    lags = max(lags, order + 1)
    stride = max(1, samples // _MOST_ROWS)
    rows = np.concatenate([_shifted(each, lags, stride) for each in recordings if len(each) > lags + 1])
    return LagFactor(np.asarray(np.linalg.qr(rows, mode="r")), lags, outputs, inputs)


def _shifted(recording: Recording, lags: int, stride: int) -> Array:
    """Return every so many rows of all shifts, the means over all rows taken off."""
    signals = np.concatenate([recording.outputs, recording.inputs], axis=1)
    count = len(signals) - lags
    shifts = [signals[lags - lag : lags - lag + count] for lag in range(lags + 1)]
    rows = np.stack([each[::stride] - each.mean(axis=0) for each in shifts], axis=2)
    return rows.reshape(len(rows), -1)

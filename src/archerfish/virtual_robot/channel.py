"""Messages on their way: each arrives after its latency, none overtakes another, a lost one never arrives."""

import math

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S

Array = NDArray[np.float64]
ARRIVAL_ROUNDING = 1e-9
"""Of times [s] and numbers of ticks."""


class Channel:
    """Messages to B receivers that have not been taken yet; latencies are uniform between two limits."""

    def __init__(self, batch: int, width: int, latency_ms: tuple[float, float], rate_hz: float | None = None) -> None:
        """Begin without a message.

        Args:
          batch: number of receivers B.
          width: numbers in a message.
          latency_ms: shortest and longest latency.
          rate_hz: of the messages, if it is constant.
        """
        self._low_ms, self._spread_ms = latency_ms[0], latency_ms[1] - latency_ms[0]
        self._rate_hz = rate_hz
        self._latest = np.full(batch, -np.inf)
        self._arrival = np.empty((batch, 0))
        self._content = np.empty((batch, 0, width))

    def send(self, sent: Array, uniform: Array, lost: NDArray[np.bool_] | bool, content: Array) -> None:
        """Send messages.

        Args:
          sent: when, rising, later than those before [s], shape (B, N); infinite where there is none.
          uniform: uniform numbers that decide on the latencies, shape (B, N).
          lost: whether they are lost, shape (B, N).
          content: shape (B, N, width).
        """
        gone = lost | np.isinf(sent)
        latency = 1e-3 * (self._low_ms + self._spread_ms * uniform)
        alone = np.where(gone, -np.inf, sent + latency)
        queued = np.maximum.accumulate(np.concatenate([self._latest[:, None], alone], axis=1), axis=1)
        self._latest = queued[:, -1]
        self._arrival = np.concatenate([self._arrival, np.where(gone, np.inf, queued[:, 1:])], axis=1)
        self._content = np.concatenate([self._content, content], axis=1)

    def take(self, until: float, ticks: int) -> tuple[Array, Array]:
        """Take what has arrived by a moment.

        Args:
          until: the moment [s], finite.
          ticks: since the last call.

        Returns:
          Arrivals in order [s], shape (B, M), and contents, shape (B, M, width), NaN where there is none. M is how many
          may arrive in so many ticks at the rate, else how many have arrived; what exceeds it stays.
        """
        arrived = self._arrival <= until + ARRIVAL_ROUNDING
        place = np.cumsum(arrived, axis=1) - 1
        if self._rate_hz is None:
            size = int(np.max(place, initial=-1)) + 1
        else:
            size = math.floor((ticks * TICK_S + 1e-3 * self._spread_ms) * self._rate_hz + ARRIVAL_ROUNDING) + 1
        taken = arrived & (place < size)
        batch, waiting, width = self._content.shape
        arrival, content = np.full((batch, size), np.nan), np.full((batch, size, width), np.nan)
        # By their places in the flattened arrays, which NumPy reads several times as fast as by a mask.
        source = np.flatnonzero(taken)
        goal = source // max(waiting, 1), place.ravel()[source]
        arrival[goal] = self._arrival.ravel()[source]
        content[goal] = self._content.reshape(-1, width).take(source, axis=0)
        self._arrival = np.where(taken, np.inf, self._arrival)
        kept = np.isfinite(self._arrival).any(axis=0)
        self._arrival, self._content = self._arrival[:, kept], self._content[:, kept]
        return arrival, content

"""Messages under way: each arrives at its time, none overtakes another, a lost one never arrives."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def arrivals(sent: Array, latency: Array, lost: NDArray[np.bool_], last: Array) -> tuple[Array, Array]:
    """Return when messages arrive over a channel in which none overtakes another.

    Args:
      sent: rising [s], shape (B, N); infinite where there is none.
      latency: of each alone [s], shape (B, N).
      lost: whether each is lost, shape (B, N).
      last: arrival of the one before [s], shape (B,).

    Returns:
      Arrivals, infinite where lost [s], shape (B, N); the latest of them all [s], shape (B,).
    """
    gone = lost | np.isinf(sent)
    alone = np.where(gone, -np.inf, sent + latency)
    queued = np.maximum.accumulate(np.concatenate([last[:, None], alone], axis=1), axis=1)
    return np.where(gone, np.inf, queued[:, 1:]), queued[:, -1]


class Mailbox:
    """What has been sent to B trials' receivers and not been taken yet."""

    def __init__(self, batch: int, width: int) -> None:
        self._received = np.empty((batch, 0))
        self._content = np.empty((batch, 0, width))
        self._next = np.inf

    def put(self, received: Array, content: Array) -> None:
        """Add messages.

        Args:
          received: when they arrive [s], infinite where never, shape (B, N).
          content: shape (B, N, width).
        """
        if received.shape[1] == 0:
            return
        self._received = np.concatenate([self._received, received], axis=1)
        self._content = np.concatenate([self._content, content], axis=1)
        order = np.argsort(self._received, axis=1, kind="stable")
        self._received = np.take_along_axis(self._received, order, axis=1)
        self._content = np.take_along_axis(self._content, order[..., None], axis=1)
        self._trim()

    def take(self, until: float, size: int | None = None) -> tuple[Array, Array]:
        """Take what has arrived by a moment.

        Args:
          until: the moment [s].
          size: number of places M in the answer; as many as are needed if not given. What exceeds it stays.

        Returns:
          Arrivals [s], shape (B, M), in order, NaN where there is none; contents, shape (B, M, width), likewise.
        """
        batch, width = self._received.shape[0], self._content.shape[2]
        if self._next > until:
            return np.full((batch, size or 0), np.nan), np.full((batch, size or 0, width), np.nan)
        count = np.sum(self._received <= until, axis=1)
        if size is None:
            size = int(count.max())
        count = np.minimum(count, size)
        received, content = self._padded(size)
        here = np.arange(size) < count[:, None]
        received, content = np.where(here, received, np.nan), np.where(here[..., None], content, np.nan)
        self._received = np.where(np.arange(self._received.shape[1]) < count[:, None], np.inf, self._received)
        # Sorting anew brings what was taken to the end, where it is cut off.
        order = np.argsort(self._received, axis=1, kind="stable")
        self._received = np.take_along_axis(self._received, order, axis=1)
        self._content = np.take_along_axis(self._content, order[..., None], axis=1)
        self._trim()
        return received, content

    def _padded(self, size: int) -> tuple[Array, Array]:
        lack = size - self._received.shape[1]
        if lack <= 0:
            return self._received[:, :size], self._content[:, :size]
        received = np.pad(self._received, ((0, 0), (0, lack)), constant_values=np.inf)
        return received, np.pad(self._content, ((0, 0), (0, lack), (0, 0)))

    def _trim(self) -> None:
        used = int(np.sum(np.isfinite(self._received), axis=1).max(initial=0))
        self._received, self._content = self._received[:, :used], self._content[:, :used]
        self._next = float(self._received[:, 0].min()) if used else np.inf

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
    """What was sent to B receivers and has not been taken yet: each trial's in order, infinity after the last."""

    def __init__(self, batch: int, width: int) -> None:
        self._received = np.empty((batch, 0))
        self._content = np.empty((batch, 0, width))
        self._next = np.inf

    def put(self, received: Array, content: Array) -> None:
        """Add messages, none of which arrives before one that was added earlier.

        Args:
          received: when they arrive [s], infinite where never, shape (B, N).
          content: shape (B, N, width).
        """
        if received.shape[1] == 0:
            return
        self._received = np.concatenate([self._received, received], axis=1)
        self._content = np.concatenate([self._content, content], axis=1)
        self._close_ranks()

    def take(self, until: float, size: int | None = None) -> tuple[Array, Array]:
        """Take what has arrived by a moment.

        Args:
          until: the moment [s].
          size: number of places M in the answer; as many as are needed if not given. What exceeds it stays.

        Returns:
          Arrivals [s], shape (B, M), in order, NaN where there is none; contents, shape (B, M, width), likewise.
        """
        batch, held = self._received.shape
        count = np.sum(self._received <= until, axis=1) if self._next <= until else np.zeros(batch, np.int64)
        size = int(count.max()) if size is None else size
        count = np.minimum(count, size)
        received, content = np.full((batch, size), np.nan), np.full((batch, size, self._content.shape[2]), np.nan)
        used = int(count.max())
        if used == 0:
            return received, content
        here = np.arange(used) < count[:, None]
        received[:, :used] = np.where(here, self._received[:, :used], np.nan)
        content[:, :used] = np.where(here[..., None], self._content[:, :used], np.nan)
        if int(count.min()) == used:
            self._received, self._content = self._received[:, used:], self._content[:, used:]
        else:
            self._received = np.where(np.arange(held) < count[:, None], np.inf, self._received)
        self._close_ranks()
        return received, content

    def _close_ranks(self) -> None:
        """Bring what never arrives, or was taken, to the end of each trial's row, and cut it off there."""
        under_way = np.isfinite(self._received)
        if not under_way.all():
            order = np.argsort(self._received, axis=1, kind="stable")
            used = int(under_way.sum(axis=1).max())
            trial, order = np.arange(len(order))[:, None], order[:, :used]
            self._received, self._content = self._received[trial, order], self._content[trial, order]
        self._next = float(self._received[:, 0].min()) if self._received.shape[1] else np.inf

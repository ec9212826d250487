"""Another clock's stamps on the computer's clock, from the times at which stamped messages are received."""

from collections import deque

import numpy as np

_WINDOW, _EVERY = 200, 8
_JUMP_S, _JUMPS, _JUMPS_TAKE_S = 0.2, 5, 0.05


class ClockOffset:
    """The offset of a clock that drifts: the median of receipt less stamp in a window, less the mean latency.

    Messages that are more than 0.2 s off are left out as late ones. After five in a row, received in more than 50 ms,
    the clock is another one, whose offset is estimated from the beginning. A stamp that does not advance is left out: a
    repeated message is no news.
    """

    def __init__(self, latency_s: float) -> None:
        """Begin without messages.

        Args:
          latency_s: mean time from the moment that a stamp is of until receipt [s].
        """
        self._latency_s = latency_s
        self._differences = deque[float](maxlen=_WINDOW)
        self._offset, self._odd, self._count, self._last_s = np.nan, 0, 0, -np.inf
        self._odd_since_s = -np.inf  # when the first odd one in a row was received

    def own_time(self, stamp_s: float, received_s: float) -> float:
        """Return the moment of a stamp on the computer's clock [s]; NaN for a message that is left out."""
        difference = received_s - stamp_s
        advances, self._last_s = stamp_s > self._last_s, stamp_s
        if not advances:
            return np.nan
        if abs(difference - self._offset) > _JUMP_S:
            self._odd += 1
            self._odd_since_s = received_s if self._odd == 1 else self._odd_since_s
            if self._odd < _JUMPS or received_s - self._odd_since_s < _JUMPS_TAKE_S:
                return np.nan
            self._differences.clear()
        self._odd = 0
        self._differences.append(difference)
        if len(self._differences) == 1 or self._count % _EVERY == 0:
            self._offset = float(np.median(self._differences))
        self._count += 1
        return stamp_s + self._offset - self._latency_s

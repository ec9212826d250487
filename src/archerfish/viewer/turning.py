"""The page's own thread of time: pictures, one after the other."""

import threading
import time
from typing import Any

FRAME_S = 0.04
"""Between two pictures [s]."""
LONGEST_STEP_S = 0.2
"""A film that a busy machine can't draw in time goes slower, rather than jump [s]."""


def keep_turning(server: Any, page: Any, stop: threading.Event) -> None:
    """Turn a page over while somebody looks at it, until it is to stop."""
    before = time.monotonic()
    while not stop.wait(FRAME_S):
        now = time.monotonic()
        # A film that nobody watches need not go on.
        if server.get_clients():
            page.turn(min(now - before, LONGEST_STEP_S))
        before = now

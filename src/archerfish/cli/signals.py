"""Ctrl-C and SIGTERM: neither is lost.

A signal raises `Stopped` in the main thread. That may happen in a destructor or in a callback of a library, whose
exceptions Python drops (JAX has a callback that runs at every collection of garbage), so a timer raises it again.
"""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

AGAIN_S = 0.2
"""Between two attempts [s]."""


class Stopped(KeyboardInterrupt):
    """A signal ended the command."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.status = 128 + number
        """Of the process, as shells count it."""
        self.word = "interrupted" if number == signal.SIGINT else "terminated"
        """What happened."""


@contextmanager
def stop_requests() -> Iterator[None]:
    """Have Ctrl-C and SIGTERM raise `Stopped` while a block runs; what was ignored before stays so."""
    first: list[int] = []

    def stop(number: int, _: Any) -> None:
        first.append(number)
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        error = sys.exception()  # what is cleaned up after is not interrupted
        while error is not None and not isinstance(error, Stopped):
            error = error.__context__
        if error is None:
            raise Stopped(first[0])

    numbers = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) != signal.SIG_IGN]
    numbers += [signal.SIGALRM] if hasattr(signal, "setitimer") else []
    before, dropped = {each: signal.getsignal(each) for each in numbers}, sys.unraisablehook
    try:
        sys.unraisablehook = lambda lost: None if isinstance(lost.exc_value, Stopped) else dropped(lost)
        for each in numbers:
            signal.signal(each, stop)
        yield
    finally:
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for each in numbers:
            signal.signal(each, before[each])
        sys.unraisablehook = dropped

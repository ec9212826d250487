"""Ctrl-C and the wish of a system that a process ends: moments in which they must not strike, and an orderly end."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Ignore Ctrl-C while a block of milliseconds runs; processes that it starts ignore it for good."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kept = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, kept)


class Stopped(KeyboardInterrupt):
    """A signal ended the command."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number
        """Of the process, as shells count it."""
        self.told = f"{'interrupted' if number == signal.SIGINT else 'terminated'}; what was unfinished is discarded"
        """In one line; whoever keeps something says what."""


class StopRequests:
    """The signals that asked a long command to end."""

    def __init__(self) -> None:
        self.number: int | None = None
        """Of the signal that came, None before."""
        self.patient = False
        """Whether the command looks at `number` from time to time; before, a signal raises Stopped."""

    def hear(self, number: int, _: Any) -> None:
        """Answer a signal; a second one is not asked to wait."""
        if not self.patient or self.number is not None:
            raise Stopped(number)
        self.number = number


@contextmanager
def stop_requests() -> Iterator[StopRequests]:
    """Let Ctrl-C and SIGTERM be requests while a block runs; what was ignored before stays so."""
    requests = StopRequests()
    if threading.current_thread() is not threading.main_thread():
        yield requests
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    kept = {each: signal.getsignal(each) for each in numbers if signal.getsignal(each) is not signal.SIG_IGN}
    try:
        for each in kept:
            signal.signal(each, requests.hear)
        yield requests
    finally:
        for each, handler in kept.items():
            signal.signal(each, handler)

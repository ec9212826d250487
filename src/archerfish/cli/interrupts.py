"""Ctrl-C and SIGTERM: neither is lost, and a command ends soon after it, in order if it can.

A signal raises `Stopped` in the main thread. That may strike in a callback of a library, which drops what is raised
there ("Exception ignored in …"), or have to wait for a compiled program. So a thread watches: until the command begins
to end, `Stopped` is raised again and again; and a program that has not ended after `LONGEST_S` is cleaned up after and
ended by the thread.
"""

import _thread
import os
import signal
import socket
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import Any

AGAIN_S = 0.2
"""Between two attempts to raise `Stopped` [s]."""
PATIENCE_S = 10.0
"""Longest time that a command which looks for requests itself may take until it does [s]."""
LONGEST_S = 15.0
"""Longest time from a signal to the end of the process [s]."""


class Stopped(KeyboardInterrupt):
    """A signal ended the command."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number
        """Of the process, as shells count it."""
        self.word = "interrupted" if number == signal.SIGINT else "terminated"
        """What happened."""
        self.told = f"{self.word}; what was unfinished is discarded"
        """In one line; whoever keeps something says what."""


class StopRequests:
    """The signals that request a command to end."""

    def __init__(self) -> None:
        self.number: int | None = None
        """Of the signal that the main thread has answered, None before."""
        self.noticed: int | None = None
        """Of a signal that it may not have answered yet, or that a library has answered in its place."""
        self.is_accepted = False
        """Whether the signal was the usual end of the command."""
        self.patient = False
        """Whether the command looks at `number` from time to time; else a signal raises Stopped."""
        self.at_once = False
        """Whether a signal ends the process in its place, since nothing is left to do."""
        self._held = 0
        self._repeated = False
        self._raised: weakref.ref[Stopped] | None = None
        self._last_actions: list[Callable[[], object]] = []

    def receive(self, number: int, _: Any) -> None:
        """Answer a signal, in the main thread; for a second one nothing is patient."""
        if self.at_once:
            os._exit(128 + number)
        repeated, self._repeated = self._repeated, False
        self.patient = self.patient and (self.number is None or repeated)
        self.number = self.number or number
        self.stop_if_due()

    @property
    def is_due(self) -> bool:
        """Whether Stopped is to be raised: a signal came, and the exception is not on its way already."""
        on_its_way = self._raised is not None and self._raised() is not None
        return self.number is not None and not (self._held or self.patient or on_its_way)

    def stop_if_due(self) -> None:
        """Raise Stopped if a signal came and it may strike here."""
        if self.is_due:
            self.stop()

    def stop(self) -> None:
        """Raise Stopped for the signal that came."""
        stopped = Stopped(self.number or signal.SIGINT)
        self._raised = weakref.ref(stopped)
        try:
            raise stopped
        finally:
            del stopped  # nothing of ours keeps it alive: so it is noticed if a library drops it

    @contextmanager
    def held(self) -> Iterator[None]:
        """Let signals wait while a block runs."""
        self._held += 1
        try:
            yield
        finally:
            self._held -= 1
            self.stop_if_due()

    @contextmanager
    def at_last(self, action: Callable[[], object]) -> Iterator[None]:
        """Do something after a block, and whatever strikes, before the process ends; so it may be done twice."""
        self._last_actions.append(action)
        try:
            yield
        finally:
            with self.held():
                action()
                if action in self._last_actions:
                    self._last_actions.remove(action)

    def settle(self) -> None:
        """Let nothing strike any more, and do what is left to do."""
        self._held += 1
        for action in reversed(self._last_actions):
            with suppress(Exception):
                action()
        self._last_actions.clear()

    @property
    def came(self) -> int | None:
        """Number of the signal that came, whether it was answered or not."""
        return None if self.is_accepted else self.number or self.noticed

    def accept(self) -> None:
        """Take the signal that came as the usual end of a command."""
        self.is_accepted = True
        self.number = self._raised = None

    def repeat(self, number: int) -> None:
        """Have the main thread answer a signal again."""
        self._repeated = True
        if hasattr(signal, "pthread_kill"):  # it also wakes a system call that waits
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:
            _thread.interrupt_main(signal.Signals(number))


_active: StopRequests | None = None


@contextmanager
def stop_requests(*, may_exit: bool = False) -> Iterator[StopRequests]:
    """Let Ctrl-C and SIGTERM be requests while a block runs; what was ignored before stays so.

    Args:
      may_exit: whether a process that does not end by itself is ended.

    Yields:
      The requests; within another such block, those of that one.
    """
    global _active  # the handlers of a process are one as well
    if _active is not None or not _in_main_thread():
        yield _active or StopRequests()
        return
    requests = StopRequests()
    found = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    kept = {each: handler for each, handler in found.items() if handler not in (signal.SIG_IGN, None)}
    with _watched(requests, frozenset(kept), may_exit=may_exit):
        try:
            _active = requests
            for each in kept:
                signal.signal(each, requests.receive)
            yield requests
        finally:
            for each, handler in kept.items():
                signal.signal(each, handler)
            _active = None


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM wait while a block of milliseconds runs."""
    with _active.held() if _active and _in_main_thread() else nullcontext():
        yield


@contextmanager
def at_last(action: Callable[[], object]) -> Iterator[None]:
    """Do something after a block, and whatever strikes, before the process ends; so it may be done twice."""
    if _active and _in_main_thread():
        with _active.at_last(action):
            yield
        return
    try:
        yield
    finally:
        action()


@contextmanager
def end_by_ctrl_c() -> Iterator[None]:
    """Take Ctrl-C as the usual end of a block, which knows no other; SIGTERM stays what it is."""
    try:
        yield
    except KeyboardInterrupt as error:
        if isinstance(error, Stopped) and error.status != 128 + signal.SIGINT:
            raise
        if _active:
            _active.accept()


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def _watched(requests: StopRequests, numbers: frozenset[int], *, may_exit: bool) -> Iterator[None]:
    """Have a thread see to it that signals are honoured, which learns of them even while a compiled program runs."""
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    over = threading.Event()

    def watch() -> None:
        while received := receiver.recv(1):
            if received[0] in numbers:
                _see_through(requests, received[0], over, may_exit=may_exit)

    thread = threading.Thread(target=watch, name="signals", daemon=True)
    thread.start()
    before = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        over.set()
        sender.close()
        thread.join()
        receiver.close()


def _see_through(requests: StopRequests, number: int, over: threading.Event, *, may_exit: bool) -> None:
    begun, requests.noticed = time.monotonic(), number
    while not over.wait(AGAIN_S) and not requests.is_accepted:
        waited = time.monotonic() - begun
        if waited > LONGEST_S and may_exit:
            requests.settle()
            word = Stopped(number).word
            os.write(2, f"archerfish: {word}; it did not end by itself within {LONGEST_S:g} s\n".encode())
            os._exit(128 + number)
        if waited > PATIENCE_S:
            requests.patient = False
        if requests.is_due or requests.number is None:
            requests.repeat(number)

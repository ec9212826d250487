"""The loop on the robot's computer: ports, threads and deadlines around a pilot that has none of them.

The thread that decides touches no port: a read of a terminal device waits for a worker of the kernel, for up to a
second on a busy computer. A reader for each port stamps what arrives, and a writer has room for one frame, so that it
never sends an old one after a newer one.
"""

import contextlib
import ctypes
import gc
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from archerfish.reports.table import Table
from archerfish.safety.rules import LOST_S, STALE_S
from archerfish.wires.transports import DatagramPort, Port

_WAKE_S = 0.005  # between looks at what arrived, while there is time
_SPIN_S = 1e-4  # before a deadline, without sleeping: a sleep ends later than it was asked to
_STALL_S = 0.05  # a loop that was late by more discards what arrived meanwhile: a full line keeps its oldest bytes
_RETRY_S = 0.2  # between attempts to open a port that has gone
_LAST_FRAME_S = 0.5  # at most, for the last frame to be written
_MOST_READS, _MOST_DATAGRAMS = 256, 8  # that wait; the oldest are lost
_LEAST_SHARE = 0.6  # of a period between decisions: the gate takes less than half of one for a fault
_READING, _WRITING, _DECIDING = 55, 54, 50  # priorities, where the system allows them
_LOCK_NOW_AND_LATER = 3  # MCL_CURRENT | MCL_FUTURE
_BOOT_CLOCK: int | None = getattr(time, "CLOCK_BOOTTIME", None)


def _clock() -> float:
    """Return the computer's time, which goes on while it sleeps, where the system has such a clock [s]."""
    return time.clock_gettime(_BOOT_CLOCK) if _BOOT_CLOCK is not None else time.monotonic()


class Deciding(Protocol):
    """What the loop runs: a `Pilot`, or what stands in for it in a test."""

    def on_bytes(self, now: float, data: bytes) -> None:
        """Take bytes of the wire."""

    def on_datagram(self, now: float, data: bytes) -> None:
        """Take a datagram of the camera's program."""

    def tick(self, now: float) -> bytes:
        """Decide, and return the bytes to send."""

    def withdraw(self) -> None:
        """Forget the last decision, which was not sent."""

    def last_frame(self) -> bytes:
        """Return bytes that end the fire, without deciding; it never fails."""

    def restart(self) -> None:
        """Forget what was received: the port has gone and come back."""


class _Arrival(NamedTuple):
    """Bytes with the time of their receipt."""

    time_s: float
    data: bytes


class Durations:
    """How often durations were how long, in a fixed amount of memory: within 6 % of each."""

    def __init__(self) -> None:
        self._edges = np.geomspace(1e-6, 100.0, 320)  # [s]
        self._counts = np.zeros(len(self._edges) + 1, np.int64)

    def __len__(self) -> int:
        return int(self._counts.sum())

    def add(self, seconds: float) -> None:
        """Count a duration [s]."""
        self._counts[np.searchsorted(self._edges, seconds)] += 1

    def quantile(self, share: float) -> float:
        """Return the duration that so many are not above [s]; 0 without any."""
        reached = np.cumsum(self._counts) >= share * len(self)
        return float(self._edges[min(int(np.argmax(reached)), len(self._edges) - 1)]) if len(self) else 0.0


@dataclass
class Timing:
    """How well the loop kept its deadlines."""

    lateness: Durations = field(default_factory=Durations)  # of each decision's begin
    work: Durations = field(default_factory=Durations)  # of each decision
    missed: int = 0  # deadlines that passed during a decision, and were left out
    withdrawn: int = 0  # frames that were not written before the next decision
    stalls: int = 0  # times when what had arrived was discarded
    lost: int = 0  # times when the port went away
    let_go: int = 0  # times when no decision ended for more than 0.1 s
    is_realtime: bool = False  # whether the system gave priority and locked the memory

    def table(self) -> Table:
        """Return the figures."""
        rows: list[tuple[str, float, float, float]] = []
        for name, durations in (("late by", self.lateness), ("decision took", self.work)):
            median, high, highest = (1e3 * durations.quantile(share) for share in (0.5, 0.99, 0.999))
            rows.append((name, median, high, highest))
        counts = f"{len(self.work)} decisions, {self.missed} deadlines missed, {self.withdrawn} frames withdrawn"
        return Table("Times [ms]", ("", "median", "99 %", "99.9 %"), tuple(rows), f"{counts}.")


class RobotLoop:
    """Runs a pilot against a port and a camera's datagrams until it is stopped."""

    def __init__(
        self, pilot: Deciding, open_port: Callable[[], Port], datagrams: DatagramPort, period_s: float
    ) -> None:
        """Take what runs; `run` begins.

        Args:
          pilot: decides.
          open_port: opens the wire's port, now and each time that it has gone.
          datagrams: of the camera's program.
          period_s: of the decisions [s].

        Raises:
          InputError: if the port can't be opened now.
        """
        self._pilot, self._open, self._period = pilot, open_port, period_s
        self._port: Port | None = open_port()
        self._datagrams = datagrams
        self._bytes = deque[_Arrival](maxlen=_MOST_READS)
        self._plates = deque[_Arrival](maxlen=_MOST_DATAGRAMS)
        self._unsent, self._frame_is_there = deque[bytes](maxlen=1), threading.Semaphore(0)
        self._is_running, self._is_new_port = False, False
        self.timing = Timing()
        """Of what ran so far."""

    def run(self, is_stopped: Callable[[], bool], seconds: float = float("inf")) -> Timing:
        """Decide at each deadline until stopped; the last frame ends the fire, whatever ended the loop.

        Args:
          is_stopped: asked before each decision.
          seconds: after which the loop ends by itself [s].
        """
        self._is_running = True
        writer = threading.Thread(target=self._write, daemon=True)
        readers = [threading.Thread(target=read, daemon=True) for read in (self._read_port, self._read_datagrams)]
        for thread in (writer, *readers):
            thread.start()
        self.timing.is_realtime = prefer(_DECIDING) and _lock_memory()
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            self._decide(is_stopped, seconds)
        finally:
            gc.enable()
            gc.unfreeze()
            self._send(self._pilot.last_frame())
            self._is_running = False
            self._frame_is_there.release()
            # The port stays open until the last frame is written.
            writer.join(_LAST_FRAME_S)
            for thread in readers:
                thread.join(2.0)
            if self._port is not None:
                self._port.close()
            prefer(0)
        return self.timing

    def _decide(self, is_stopped: Callable[[], bool], seconds: float) -> None:
        due = _clock() + self._period
        end = due + seconds
        while due < end and not is_stopped():
            self._wait(due)
            begun = _clock()
            if begun - due > _STALL_S and len(self.timing.work):
                self._bytes.clear()
                self._plates.clear()
                self.timing.stalls += 1
            if self._is_new_port:
                self._bytes.clear()
                self._unsent.clear()
                self._pilot.restart()
                self._is_new_port = False
            self._take()
            if self._unsent:
                with contextlib.suppress(IndexError):  # the writer may take it just now
                    self._unsent.pop()
                    self._pilot.withdraw()
                    self.timing.withdrawn += 1
            asked = _clock()
            frame = self._pilot.tick(asked)
            done = _clock()
            if done - asked <= STALE_S:
                self._send(frame)
            else:  # what it knew is old by now
                self._pilot.withdraw()
            self.timing.lateness.add(begun - due)
            self.timing.work.add(done - begun)
            # After a late decision the next one is not to come too early.
            due = max(due + self._period, begun + _LEAST_SHARE * self._period)
            skipped = max(0, int(np.ceil((done - due) / self._period)))
            self.timing.missed += skipped
            due += skipped * self._period

    def _wait(self, due: float) -> None:
        """Take what arrives until a deadline."""
        while (left := due - _clock()) > _SPIN_S:
            time.sleep(min(_WAKE_S, left - _SPIN_S))
            self._take()
        while _clock() < due:
            pass

    def _take(self) -> None:
        """Hand over what has arrived, at most what the queues hold: a flood does not keep it from deciding."""
        for _ in range(len(self._bytes)):
            self._pilot.on_bytes(*self._bytes.popleft())
        for _ in range(len(self._plates)):
            self._pilot.on_datagram(*self._plates.popleft())

    def _send(self, frame: bytes) -> None:
        if frame:
            self._unsent.append(frame)
            self._frame_is_there.release()

    def _read_port(self) -> None:
        """Read, and open the port again where it has gone, for as long as the loop runs."""
        prefer(_READING)
        while self._is_running:
            port = self._port
            try:
                if port is None:
                    self._is_new_port = True  # before the port is there: no command of before is sent to it
                    self._port = self._open()
                elif data := port.read():
                    self._bytes.append(_Arrival(_clock(), data))
            except Exception:  # whatever a driver raises, the port has gone
                self._port = None
                if port is not None:
                    self.timing.lost += 1
                    with contextlib.suppress(Exception):
                        port.close()
                time.sleep(_RETRY_S)

    def _read_datagrams(self) -> None:
        prefer(_READING)
        while self._is_running:
            with contextlib.suppress(OSError):
                if data := self._datagrams.read():
                    self._plates.append(_Arrival(_clock(), data))

    def _write(self) -> None:
        prefer(_WRITING)
        is_let_go = True  # before the first command
        while self._is_running or self._unsent:
            is_there = self._frame_is_there.acquire(timeout=LOST_S + self._period)
            if not is_there and is_let_go:
                continue
            # A decision that does not end leaves no frame: the gimbal is let go, once.
            is_let_go = not is_there
            self.timing.let_go += is_let_go
            port = self._port
            with contextlib.suppress(Exception):  # the reader sees that the port has gone
                frame = self._unsent.popleft() if is_there else self._pilot.last_frame()
                if port is not None and not self._is_new_port:
                    port.write(frame)


def prefer(priority: int) -> bool:
    """Run this thread before all usual ones, if the system allows it; 0 makes it a usual one."""
    try:
        policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
        os.sched_setscheduler(threading.get_native_id(), policy, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


def _lock_memory() -> bool:
    """Keep the process in memory, if the system allows it."""
    try:
        return int(ctypes.CDLL(None).mlockall(_LOCK_NOW_AND_LATER)) == 0
    except (AttributeError, OSError, TypeError):
        return False

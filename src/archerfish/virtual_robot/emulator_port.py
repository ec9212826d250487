"""An emulated robot in real time: its wire behind a pseudo-terminal, its camera's detections as datagrams."""

import contextlib
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Self

from archerfish.errors import InputError
from archerfish.runtime.loop import prefer
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Emulator
from archerfish.wires.transports import read_address

_TICKS = 2  # between looks at what arrived
_PRIORITY = 40  # below the computer's, where the system allows one: a robot does not slow down beside other programs
_MOST_BYTES = 4096  # of a read
_SILENT_S = 1.0  # after which bytes are those of a computer that begins
_BEHIND_S = 0.5  # a robot that is later than that skips the time: a computer that slept is no slow robot


class EmulatorPort:
    """The robot's end of the wire; `name` is the computer's end."""

    def __init__(self, emulator: Emulator, detections: str) -> None:
        """Open a pseudo-terminal.

        Args:
          emulator: the robot.
          detections: HOST:PORT that the camera's program sends to.

        Raises:
          InputError: if it is no such address, or the system has no pseudo-terminals.
        """
        family, self._host, self._number = read_address(detections)
        if not self._number:
            raise InputError(f"address {detections}: expected the port of a program, got 0; name that of deploy")
        try:
            import tty

            self._robot, self._computer = os.openpty()
            tty.setraw(self._computer)
        except (ImportError, AttributeError, OSError) as error:
            raise InputError(f"the system has no pseudo-terminal ({error}); emulate on Linux or macOS") from error
        os.set_blocking(self._robot, False)
        self.name = os.ttyname(self._computer)
        """Of the port that the computer opens."""
        self._emulator = emulator
        self._camera = socket.socket(family, socket.SOCK_DGRAM)
        self._received = deque[bytes]()
        self.late_s = 0.0
        """Most that the robot was behind real time [s]."""
        self.begun_s = float("inf")
        """When the first bytes of the computer came, by the robot's clock [s]."""
        self._is_open = True
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_open = False
        self._reader.join()  # or it would read a file that is opened with the same number
        os.close(self._robot)
        os.close(self._computer)
        self._camera.close()

    def run(self, is_stopped: Callable[[], bool], seconds: float = float("inf")) -> None:
        """Let the robot live in real time.

        Times of the operator's switch and of faults count from the first bytes of the computer on, and again from the
        first ones after a second without any: a computer that is started again meets a switch that goes on.

        Args:
          is_stopped: asked every two milliseconds.
          seconds: after the very first bytes, until which it lives [s].
        """
        robot, begun = self._emulator, time.monotonic() - self._emulator.time
        robot.trial_s = self.begun_s = float("inf")
        last_bytes_s = float("-inf")
        prefer(_PRIORITY)
        while robot.time - self.begun_s < seconds and not is_stopped():
            left = begun + robot.time + _TICKS * TICK_S - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            self.late_s = max(self.late_s, -left)
            if left < -_BEHIND_S:
                begun -= left
            while self._received:
                self.begun_s = min(self.begun_s, robot.time)
                if robot.time - last_bytes_s > _SILENT_S:
                    robot.trial_s = robot.time
                last_bytes_s = robot.time
                robot.on_bytes(self._received.popleft())
            for delivery in robot.advance(_TICKS):
                if delivery.is_datagram:
                    self._camera.sendto(delivery.data, (self._host, self._number))
                else:
                    self._write(delivery.data)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: a line loses what has no room
            os.write(self._robot, data)

    def _read(self) -> None:
        """Read in a thread of its own: a read of a terminal device may wait."""
        import select

        with contextlib.suppress(OSError, ValueError):  # closed
            while self._is_open:
                if select.select([self._robot], [], [], 0.1)[0]:
                    self._received.append(os.read(self._robot, _MOST_BYTES))

"""Ports of the computer: a serial line, or anything that looks like one, and datagrams of the camera's program."""

import ipaddress
import socket
from pathlib import Path
from typing import Any, Protocol

from archerfish.errors import InputError, one_line

_WAIT_S = 0.1  # of a read without bytes
_MOST_BYTES = 65_536  # of a datagram


class Port(Protocol):
    """What threads read and write; each may block."""

    def read(self) -> bytes:
        """Wait a moment for bytes and return them; nothing where none came.

        Raises:
          OSError: if the port has gone.
        """

    def write(self, data: bytes) -> None:
        """Write bytes.

        Raises:
          OSError: if the port has gone.
        """

    def close(self) -> None:
        """Let others have the port."""


class SerialPort:
    """A serial port that no other program has: a device, or a pseudo-terminal."""

    def __init__(self, name: str, baud: int = 115_200) -> None:
        """Open the port.

        Args:
          name: of the device; those in /dev/serial/by-id stay the same when cables are exchanged.
          baud: bits per second; of USB and pseudo-terminals it has no meaning.

        Raises:
          InputError: if it is not there, or another program has it.
        """
        serial = _pyserial()
        try:
            self._port = serial.Serial(name, baud, timeout=_WAIT_S, write_timeout=_WAIT_S, exclusive=True)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            reason = one_line(str(error))[:200]
            raise InputError(f"port {name}: can't be opened ({reason}); {_ports()}") from error

    def read(self) -> bytes:
        """Wait a moment for bytes; see `Port.read`."""
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def write(self, data: bytes) -> None:
        """Write bytes; see `Port.write`. What the line has not yet taken of former ones is discarded."""
        if self._port.out_waiting:
            self._port.reset_output_buffer()
        self._port.write(data)

    def close(self) -> None:
        """Let others have the port."""
        self._port.close()


class DatagramPort:
    """A UDP port that receives; on this computer alone unless another address is given."""

    def __init__(self, address: str) -> None:
        """Open the port.

        Args:
          address: HOST:PORT, such as 127.0.0.1:47000; PORT 0 takes a free one.

        Raises:
          InputError: if it is no such address, or another program has it.
        """
        host, _, number = address.rpartition(":")
        try:
            family = socket.AF_INET6 if ipaddress.ip_address(host.strip("[]")).version == 6 else socket.AF_INET
            port = int(number)
        except ValueError as error:
            expected = "expected HOST:PORT with an IP address, such as 127.0.0.1:47000"
            raise InputError(f"detections: {expected}, got {address!r}; correct it") from error
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(_WAIT_S)
        try:
            self._socket.bind((host.strip("[]"), port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise InputError(f"detections: {address} can't be opened ({error}); choose another port") from error
        self.number = int(self._socket.getsockname()[1])
        """Of the port."""

    def read(self) -> bytes:
        """Wait a moment for a datagram; see `Port.read`."""
        try:
            return self._socket.recv(_MOST_BYTES)
        except TimeoutError:
            return b""

    def close(self) -> None:
        """Let others have the port."""
        self._socket.close()


def _pyserial() -> Any:
    try:
        import serial
    except ImportError as error:
        raise InputError('serial ports need pyserial; install it: pip install "archerfish[robot]"') from error
    return serial


def _ports() -> str:
    """Return what may be opened instead, as the remedy of a message."""
    from serial.tools import list_ports

    stable = [str(path) for path in sorted(Path("/dev/serial/by-id").glob("*"))]
    names = stable or [port.device for port in list_ports.comports()]
    return f"there are {', '.join(names[:8])}" if names else "no serial port is there: plug it in, and see its rights"

"""Ports of the computer: a serial line, or anything that looks like one, and datagrams of the camera's program."""

import contextlib
import errno
import ipaddress
import os
import socket
from pathlib import Path
from typing import Any, Protocol

from archerfish.errors import InputError, one_line

_WAIT_S = 0.1  # of a read without bytes
_MOST_BYTES = 65_536  # of a datagram
_LAST_PORT = 65_535
_PSEUDO_TERMINALS = "/dev/pts/"
_ADDRESS_REMEDIES = {
    errno.EADDRINUSE: "end the program that has it, or choose another port",
    errno.EADDRNOTAVAIL: "take 127.0.0.1, an address of this computer, or 0.0.0.0 for all of its addresses",
    errno.EACCES: "choose a port from 1024 on",
}


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
            raise InputError(f"port {name}: {_problem(name, error)}") from error
        # pyserial's lock binds programs that ask for it alone. A pseudo-terminal would stay closed to others where this
        # program is killed, since its other end keeps it.
        self._is_exclusive = not os.path.realpath(name).startswith(_PSEUDO_TERMINALS)
        self._exclude_others(self._is_exclusive)

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
        if self._is_exclusive:
            self._exclude_others(False)
        self._port.close()

    def _exclude_others(self, others_are_excluded: bool) -> None:
        """Have the system refuse others that open the port, or let them, where it can."""
        with contextlib.suppress(ImportError, AttributeError, OSError):  # Windows excludes them by itself
            import fcntl
            import termios

            fcntl.ioctl(self._port.fileno(), termios.TIOCEXCL if others_are_excluded else termios.TIOCNXCL)


def read_address(address: str) -> tuple[socket.AddressFamily, str, int]:
    """Return family, host and port of HOST:PORT.

    Raises:
      InputError: if it is no such address.
    """
    text, _, number = address.rpartition(":")
    host = text.strip("[]")
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(host).version == 6 else socket.AF_INET
        port = int(number)
    except ValueError as error:
        expected = "expected HOST:PORT with an IP address, such as 127.0.0.1:47000"
        raise InputError(f"address {address!r}: {expected}; correct it") from error
    if not 0 <= port <= _LAST_PORT:
        raise InputError(f"address {address}: expected a port from 0 to {_LAST_PORT}, got {port}; correct it")
    return family, host, port


class DatagramPort:
    """A UDP port that receives; on this computer alone unless another address is given."""

    def __init__(self, address: str) -> None:
        """Open the port.

        Args:
          address: HOST:PORT, such as 127.0.0.1:47000; PORT 0 takes a free one.

        Raises:
          InputError: if it is no such address, or another program has it.
        """
        family, host, port = read_address(address)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.settimeout(_WAIT_S)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            remedy = _ADDRESS_REMEDIES.get(error.errno or 0, "choose another address")
            raise InputError(f"address {address}: can't be opened ({error.strerror}); {remedy}") from error
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


def _problem(name: str, error: Exception) -> str:
    """Return why a port can't be opened, and what to do about it."""
    code = getattr(error, "errno", None) or next(iter(getattr(error.__context__, "args", ())), None)
    if code in (errno.EACCES, errno.EPERM):
        return f"this user may not open it; add the user to its group (ls -l {name} shows it), and log in again"
    if code in (errno.EAGAIN, errno.EBUSY):
        return f"another program has it; end that one (fuser -v {name} shows it)"
    if code == errno.ENOENT:
        return f"there is no such port; {_ports()}"
    reason = os.strerror(code) if isinstance(code, int) else one_line(str(error))[:200]
    return f"can't be used as a serial port ({reason}); {_ports()}"


def _ports() -> str:
    """Return what may be opened instead, as the remedy of a message."""
    from serial.tools import list_ports

    stable = [str(path) for path in sorted(Path("/dev/serial/by-id").glob("*"))]
    names = stable or [port.device for port in list_ports.comports()]
    return f"there are {', '.join(names[:8])}" if names else "there is none: plug the robot in"

"""Ports: who has one keeps others out, and what can't be opened is refused with its cause and a remedy."""

import contextlib
import os
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from archerfish.errors import InputError
from archerfish.wires import transports
from archerfish.wires.transports import DatagramPort, SerialPort

pytest.importorskip("serial", reason="pyserial is not installed")
NOBODY = 65534


@pytest.fixture
def terminal():
    """Return the name of a pseudo-terminal."""
    robot, computer = os.openpty()
    tty.setraw(computer)
    yield os.ttyname(computer)
    os.close(robot)
    os.close(computer)


@contextlib.contextmanager
def without_rights():
    """Be a usual user, whom a system's rights bind."""
    if os.geteuid() == 0:
        os.seteuid(NOBODY)
        yield
        os.seteuid(0)
    else:
        yield


def opens(name):
    """Return what another program, of a usual user, says that opens a port without asking for its lock."""
    code = f"import os\nif os.geteuid() == 0: os.setuid({NOBODY})\nos.open({name!r}, os.O_RDWR | os.O_NOCTTY)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr


def test_a_port_has_one_user(terminal, refused, monkeypatch):
    Path(terminal).chmod(0o666)
    port = SerialPort(terminal)
    refused(rf"port {terminal}: another program has it; end that one \(fuser", SerialPort, terminal)
    port.close()
    monkeypatch.setattr(transports, "_PSEUDO_TERMINALS", "/none/")  # as if it were a device
    port = SerialPort(terminal)
    assert "Device or resource busy" in opens(terminal)
    port.close()
    assert opens(terminal) == ""


def test_a_port_that_cannot_be_opened_is_refused_with_its_cause(terminal, refused, tmp_path):
    refused(r"port /dev/ttyNone: there is no such port; there (are|is)", SerialPort, "/dev/ttyNone")
    Path(terminal).chmod(0)
    with without_rights(), pytest.raises(InputError, match="this user may not open it; add the user to its group"):
        SerialPort(terminal)
    file = tmp_path / "file"
    file.touch()
    text = str(refused("can't be used as a serial port", SerialPort, str(file)))
    assert (text.count(str(file)), text.count("Inappropriate ioctl"), "Errno" in text) == (1, 1, False)


def test_an_address_that_cannot_be_opened_is_refused_with_its_cause(refused):
    port = DatagramPort("127.0.0.1:0")
    taken = f"127.0.0.1:{port.number}"
    refused(rf"address {taken}: .*in use.*; end the program that has it, or choose another port", DatagramPort, taken)
    port.close()
    for wrong in ("47000", "localhost:47000", "127.0.0.1:x", "127.0.0.1:"):
        refused("expected HOST:PORT with an IP address, such as 127.0.0.1:47000", DatagramPort, wrong)
    refused("expected a port from 0 to 65535, got 99999", DatagramPort, "127.0.0.1:99999")
    refused("take 127.0.0.1, an address of this computer, or 0.0.0.0", DatagramPort, "192.0.2.1:47000")

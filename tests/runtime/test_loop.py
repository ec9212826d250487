"""Ports, threads and deadlines; nothing here asserts how late they are."""

import os
import signal
import socket
import sys
import threading
import time
import tty

import numpy as np
import pytest

from archerfish.cli.deploy import StateDisplay
from archerfish.runtime.loop import Durations, RobotLoop
from archerfish.studies.deploy import stop_flag
from archerfish.wires.transports import DatagramPort, SerialPort

pytest.importorskip("serial", reason="pyserial is not installed")
PERIOD_S = 0.02


class Terminal:
    """A pseudo-terminal: the robot's end is here, the computer's has a name."""

    def __init__(self):
        self.robot, self._computer = os.openpty()
        tty.setraw(self._computer)
        self.name = os.ttyname(self._computer)

    def close(self):
        os.close(self.robot)
        os.close(self._computer)


class Recorder:
    """Stands in for a pilot: it keeps what arrives, and sends the number of each decision."""

    def __init__(self, fails_at=None, slow_at=None, slow_s=3.5 * PERIOD_S):
        self.received, self.datagrams, self.decisions, self.withdrawn = b"", [], 0, 0
        self.fails_at, self.slow_at, self.slow_s = fails_at, slow_at, slow_s

    def on_bytes(self, now, data):
        self.received += data

    def on_datagram(self, now, data):
        self.datagrams.append(data)

    def tick(self, now):
        self.decisions += 1
        if self.decisions == self.fails_at:
            raise RuntimeError("a fault of its own")
        if self.decisions == self.slow_at:
            time.sleep(self.slow_s)
        return f"{self.decisions} ".encode()

    def withdraw(self):
        self.withdrawn += 1

    def restart(self):
        self.received = b""

    def last_frame(self):
        return b"end"


@pytest.fixture
def terminal():
    made = Terminal()
    yield made
    made.close()


@pytest.fixture
def camera():
    port = DatagramPort("127.0.0.1:0")
    yield port
    port.close()


def test_bytes_and_datagrams_arrive_and_the_last_frame_ends_the_fire(terminal, camera):
    pilot = Recorder()
    os.write(terminal.robot, b"before the port was opened")
    loop = RobotLoop(pilot, lambda: SerialPort(terminal.name), camera, PERIOD_S)
    os.write(terminal.robot, b"report")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b"plate", ("127.0.0.1", camera.number))
    timing = loop.run(lambda: pilot.decisions >= 5)
    assert pilot.received.endswith(b"report")
    assert pilot.datagrams == [b"plate"]
    assert os.read(terminal.robot, 1000).endswith(b"end")
    assert len(timing.work) == len(timing.lateness) == 5
    assert "5 decisions" in timing.table().note


def test_whatever_ends_the_loop_the_last_frame_is_sent(terminal, camera):
    with pytest.raises(RuntimeError, match="a fault of its own"):
        RobotLoop(Recorder(fails_at=3), lambda: SerialPort(terminal.name), camera, PERIOD_S).run(lambda: False)
    assert os.read(terminal.robot, 1000).endswith(b"end")


class SlowPort:
    """A line that takes its time for each frame, and remembers them."""

    def __init__(self):
        self.written, self.is_open = [], True

    def read(self):
        time.sleep(0.01)
        return b""

    def write(self, data):
        time.sleep(0.03)
        assert self.is_open
        self.written.append(data)

    def close(self):
        self.is_open = False


def test_a_slow_line_gets_the_newest_frames_and_the_last_one(camera):
    pilot, port = Recorder(), SlowPort()
    timing = RobotLoop(pilot, lambda: port, camera, PERIOD_S).run(lambda: pilot.decisions >= 6)
    assert port.written[-1] == b"end"
    assert timing.withdrawn == pilot.withdrawn > 0


def test_a_flood_of_datagrams_does_not_keep_it_from_deciding(camera):
    pilot, is_flooded = Recorder(), threading.Event()

    def flood():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not is_flooded.is_set():
                sender.sendto(60_000 * b"x", ("127.0.0.1", camera.number))

    threading.Thread(target=flood, daemon=True).start()
    RobotLoop(pilot, SlowPort, camera, PERIOD_S).run(lambda: pilot.decisions >= 5, 20)
    is_flooded.set()
    assert pilot.decisions >= 5


def test_deadlines_that_passed_are_left_out(terminal, camera):
    pilot = Recorder(slow_at=2)
    timing = RobotLoop(pilot, lambda: SerialPort(terminal.name), camera, PERIOD_S).run(lambda: pilot.decisions >= 4)
    assert timing.missed >= 3
    assert b"2 " not in os.read(terminal.robot, 1000)  # what it knew was old by then
    assert pilot.withdrawn >= 1


def test_a_decision_that_hangs_lets_the_gimbal_go(camera):
    pilot, port = Recorder(slow_at=3, slow_s=0.5), SlowPort()
    RobotLoop(pilot, lambda: port, camera, PERIOD_S).run(lambda: pilot.decisions >= 6)
    assert b"end" in port.written[:-1]
    assert b"3 " not in port.written


def test_a_signal_long_after_the_first_interrupts(monkeypatch):
    monkeypatch.setattr("archerfish.studies.deploy._PATIENCE_S", 0.0)
    with stop_flag() as is_stopped:
        os.kill(os.getpid(), signal.SIGTERM)
        assert is_stopped()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)


def test_a_port_that_has_gone_is_opened_again(camera):
    terminals, pilot = [Terminal()], Recorder()

    def open_port():
        return SerialPort(terminals[-1].name)

    def exchange():
        time.sleep(0.2)
        terminals[-1].close()
        time.sleep(0.3)
        terminals.append(Terminal())
        os.write(terminals[-1].robot, b"early")
        while b"late" not in pilot.received:
            os.write(terminals[-1].robot, b"late")
            time.sleep(0.02)

    loop = RobotLoop(pilot, open_port, camera, PERIOD_S)
    threading.Thread(target=exchange, daemon=True).start()
    timing = loop.run(lambda: b"late" in pilot.received, 5)
    assert (timing.lost, b"late" in pilot.received) == (1, True)
    assert os.read(terminals[-1].robot, 10_000).endswith(b"end")
    terminals[-1].close()


class Epochs(Recorder):
    """Sends how often it was restarted."""

    epoch = 0

    def tick(self, now):
        self.decisions += 1
        return b"%d" % self.epoch

    def restart(self):
        self.epoch += 1


class FailingPort(SlowPort):
    """A line whose driver fails in some way at its fifteenth read."""

    reads = 0

    def read(self):
        self.reads += 1
        if self.reads == 15:
            raise TypeError("in the driver")
        return super().read()

    def write(self, data):
        self.written.append(data)


def test_whatever_a_driver_raises_the_port_is_opened_again_and_gets_no_command_of_before(camera):
    pilot, ports = Epochs(), []

    def open_port():
        ports.append(FailingPort() if len(ports) < 2 else SlowPort())
        return ports[-1]

    timing = RobotLoop(pilot, open_port, camera, PERIOD_S).run(lambda: len(ports) == 3 and len(ports[2].written) > 3, 9)
    assert (timing.lost, pilot.epoch) == (2, 2)
    assert [set(port.written) - {b"end"} for port in ports] == [{b"0"}, {b"1"}, {b"2"}]


def test_after_a_stall_what_arrived_meanwhile_is_discarded(camera):
    class Full(SlowPort):
        def read(self):
            time.sleep(0.001)
            return b"x"

    pilot, seen = Recorder(), []

    def is_stopped():
        seen.append(len(pilot.received))
        if pilot.decisions == 3:  # the computer stands still
            time.sleep(0.2)
        return pilot.decisions >= 5

    timing = RobotLoop(pilot, Full, camera, PERIOD_S).run(is_stopped)
    assert timing.stalls == 1
    assert np.diff(seen)[3] < 100  # of some two hundred


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP"])
def test_a_signal_to_stop_sets_a_flag_alone(name):
    number = getattr(signal, name)
    before = signal.getsignal(number)
    with stop_flag() as is_stopped:
        assert not is_stopped()
        os.kill(os.getpid(), number)
        assert is_stopped()
    assert signal.getsignal(number) == before


def test_a_terminal_that_stands_still_does_not_keep_the_loop(monkeypatch):
    class Stopped:
        def write(self, text):
            threading.Event().wait()

    class Talkative(Recorder):
        verdict, has_switch = None, True

        @property
        def state_text(self):
            self.decisions += 1
            return f"state {self.decisions}"

    monkeypatch.setattr(sys, "stderr", Stopped())
    watch, pilot, begun = StateDisplay(), Talkative(), time.monotonic()
    for _ in range(50):
        assert not watch(pilot)
    assert time.monotonic() - begun < 5.0


def test_durations_are_counted_in_a_fixed_amount_of_memory():
    durations = Durations()
    assert durations.quantile(0.5) == 0.0
    for number in range(1, 1001):
        durations.add(1e-5 * number)
    assert durations.quantile(0.5) == pytest.approx(5e-3, rel=0.06)
    assert durations.quantile(0.99) == pytest.approx(9.9e-3, rel=0.06)
    durations.add(1e9)
    assert durations.quantile(1.0) == 100.0

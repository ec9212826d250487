"""What must not go wrong around the gate: withdrawn frames, wrong reports, heat, a team's own wire and controller."""

import struct
from pathlib import Path

import numpy as np
import pytest

from archerfish.codegen.library import find_compiler
from archerfish.controllers.registry import make_controller
from archerfish.protocols import aim
from archerfish.robot import Robot
from archerfish.runtime import Pilot
from archerfish.runtime.deciders import make_decider
from archerfish.safety.gate import Mode
from archerfish.safety.rules import GateConfig
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.wires import Stream, load_wire

INFANTRY, TASK = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
WIRE, LATENCY = load_wire("sp_vision_25"), INFANTRY.sensing.camera.latency


class Asks:
    """A controller that asks for pitch 0.1 and yaw 0, and fires as given."""

    def __init__(self, fire=None):
        self.fire = fire

    def reset(self, seen, truth=None):
        return np.zeros(1)

    def step(self, state, seen):
        command = aim(np.array([[0.1, 0.0]]))
        if isinstance(self.fire, BaseException):
            raise self.fire
        return state, command if self.fire is None else command._replace(fire=self.fire)


class Run:
    """A pilot with its messages: reports each 2 ms, a plate each decision; what it sends is kept."""

    def __init__(self, controller=None, wire=WIRE, in_c=False):
        decider = make_decider("own", controller or Asks(), INFANTRY, TASK, GateConfig(), in_c=in_c)
        self.pilot, self.wire, self.tick, self.sent = Pilot(decider, INFANTRY, TASK, wire), wire, 0, []

    @property
    def now(self):
        return 100.0 + 2e-3 * self.tick

    @property
    def mode(self):
        return Mode(int(self.pilot.verdict.mode))

    def report(self, on, yaw=0.0, pitch=0.1):
        values = {"mode": on, "yaw": yaw, "pitch": pitch, "quaternion": [self.tick] * 4}
        return self.wire.layouts["feedback"].encode(values)

    def decide(self, count, *, on=True, silent=False, withdrawn=False, last=None, yaw=0.0, pitch=0.1):
        """Decide some times; `last` are bytes just before each decision."""
        modes = []
        for _ in range(count):
            for _ in range(10):
                self.tick += 1
                if not silent:
                    self.pilot.on_bytes(self.now, self.report(on, yaw, pitch))
            line = f'{{"stamp": {self.now - LATENCY}, "plates": [[3.0, 0.0, 0.0]]}}'
            self.pilot.on_datagram(self.now, line.encode())
            if last:
                self.pilot.on_bytes(self.now, last)
            frames = Stream([self.wire.layouts["command"]]).feed(self.pilot.tick(self.now))
            self.sent += [frame.layout.decode(frame.data) for frame in frames]
            modes.append(self.mode)
            if withdrawn:
                self.pilot.withdraw()
        return modes

    def armed(self):
        """Arm, and wait until it shoots."""
        self.decide(30, on=False)
        self.decide(20)
        assert self.sent[-1]["mode"] == 2
        return self


@pytest.mark.parametrize("in_c", [False, True])
def test_a_switch_that_is_on_at_the_start_does_not_arm_where_first_frames_are_withdrawn(in_c):
    if in_c and find_compiler() is None:
        pytest.skip("no C compiler is at hand")
    run = Run(make_controller("no-lead", INFANTRY, TASK), in_c=in_c)
    assert run.pilot.decider.language == ("C" if in_c else "NumPy")
    run.decide(2, withdrawn=True)
    assert set(run.decide(60)) == {Mode.DISARMED}
    run.pilot.restart()
    run.decide(2, withdrawn=True)
    assert set(run.decide(60)) == {Mode.DISARMED}


def test_a_fault_stays_where_frames_are_withdrawn_and_the_command_goes_on_from_rest():
    run = Run().armed()
    assert run.decide(15, silent=True, withdrawn=True)[-1] == Mode.FAULT
    assert set(run.decide(20)) == {Mode.FAULT}
    run = Run().armed()
    run.decide(4, withdrawn=True)
    assert np.all(run.pilot.decider.gate.rate == 0.0)
    assert set(run.decide(20)) == {Mode.ARMED}


def test_a_gimbal_that_has_fallen_while_nothing_was_sent_is_not_thrown_back():
    run = Run().armed()
    run.decide(20, withdrawn=True, pitch=0.08)
    assert run.decide(3, pitch=0.08)[-1] == Mode.FAULT
    assert {frame["mode"] for frame in run.sent[-3:]} == {1}
    assert run.sent[-1]["pitch"] == pytest.approx(0.08, abs=1e-6)
    run.decide(30, on=False, pitch=0.08)
    assert run.decide(1, pitch=0.08) == [Mode.ARMED]


def test_withdrawn_frames_do_not_hide_a_gimbal_that_is_stuck():
    run = Run().armed()
    modes = []
    for _ in range(6):
        modes += run.decide(9, pitch=-0.1)
        modes += run.decide(1, pitch=-0.1, withdrawn=True)
    assert modes[-1] == Mode.FAULT


def test_dry_shots_are_given_back_by_the_next_report_of_heat():
    wire = load_wire("sp_vision_25", "referee")
    run = Run(wire=wire)
    run.pilot.on_bytes(run.now, wire.layouts["heat"].encode({"shots_left": 3.0}))
    run.decide(30, on=False)
    run.decide(30)
    fired = [frame["mode"] for frame in run.sent].count(2)
    run.pilot.on_bytes(run.now, wire.layouts["heat"].encode({"shots_left": 3.0, "sequence": 1.0}))
    run.decide(10)
    assert (fired, [frame["mode"] for frame in run.sent].count(2)) == (3, 6)


@pytest.mark.parametrize("yaw", [7.0, 445.0, 1.0])
def test_a_report_that_jumps_changes_nothing_and_a_gimbal_that_is_elsewhere_is_believed(yaw):
    run = Run().armed()
    jump = run.report(True, yaw)
    run.decide(1, last=jump)
    assert (run.sent[-1]["mode"], run.pilot.counts["reports that jump"]) == (2, 1)
    assert abs(run.sent[-1]["yaw"]) < 0.01
    assert run.decide(8, yaw=yaw)[-1] in (Mode.HOLD, Mode.FAULT)


def test_heat_that_is_reported_after_a_shot_that_was_withdrawn_counts_and_is_forgotten_with_the_port():
    wire = load_wire("sp_vision_25", "referee")
    run = Run(wire=wire)
    heat = wire.layouts["heat"].encode({"shots_left": 9.0})
    run.pilot.on_bytes(run.now, heat)
    run.decide(30, on=False)
    run.decide(16, withdrawn=True)
    assert run.pilot._allowed - len(run.pilot._fired_s) == 9.0
    run.decide(1)
    run.pilot.on_bytes(run.now, wire.layouts["heat"].encode({"shots_left": 0.0}))
    run.decide(1)
    run.pilot.withdraw()
    assert run.pilot._allowed - len(run.pilot._fired_s) <= 0.0
    run.pilot.restart()
    run.decide(30, on=False)
    assert {frame["mode"] for frame in run.sent[-1:]} == {0}
    run.decide(20)
    assert 2 not in {frame["mode"] for frame in run.sent[-20:]}
    assert run.pilot._allowed == 0.0


class OwnWire:
    """A wire of a team's own that fails as it is asked to."""

    def __init__(self):
        self.received, self.layouts, self.decodes, self.encodes = WIRE.received, WIRE.layouts, True, True
        self.bad = 0  # bad frames that come

    def decode(self, frames):
        if not self.decodes or (self.bad and len(frames) > 1):
            raise ValueError("a byte of mine")
        if self.bad:
            self.bad -= 1
            raise ValueError("a bad frame")
        return WIRE.decode(frames)

    def encode(self, command):
        if not self.encodes:
            raise struct.error("short format")
        return WIRE.encode(command)


def test_a_wire_that_raises_ends_nothing_and_is_named():
    wire = OwnWire()
    run = Run(wire=wire).armed()
    wire.bad = 1  # of the frames in one read, which are decoded one by one then
    run.pilot.on_bytes(run.now, b"".join(run.report(True, 1e-4 * number) for number in range(5)))
    assert run.pilot.counts["frames that the wire can't decode"] == 1
    wire.encodes = False
    run.decide(3)
    assert "the wire raised error: short format" in run.pilot.state_text
    assert run.pilot.counts["commands that the wire can't carry"] == 3
    assert run.pilot.last_frame() == b""
    wire.encodes, wire.decodes = True, False
    assert run.decide(12)[-1] == Mode.FAULT
    assert "the wire raised ValueError: a byte of mine (test_pilot_faults.py:" in run.pilot.state_text


@pytest.mark.parametrize("fire", [np.array([[True]]), np.array([1]), True, np.array([1.0])])
def test_fire_of_any_type_fires(fire):
    Run(Asks(fire)).armed()


@pytest.mark.parametrize("error", [SystemExit(3), RuntimeError("boom")])
def test_a_controller_that_raises_holds_and_is_named(error):
    run = Run(controller := Asks()).armed()
    controller.fire = error
    assert run.decide(8)[-1] == Mode.FAULT
    assert f"{type(error).__name__}: " in run.pilot.state_text
    assert "(test_pilot_faults.py:" in run.pilot.decider.fault


def test_a_fault_is_left_by_the_switch_also_where_the_gimbal_was_moved_by_hand():
    run = Run().armed()
    run.decide(10, silent=True)
    assert run.mode == Mode.FAULT
    run.decide(60, on=False, yaw=0.25)
    assert run.pilot.state_text == "disarmed: switch off"
    run.decide(1, yaw=0.25)
    assert run.mode == Mode.ARMED


def test_a_yaw_at_the_end_of_the_wire_s_numbers_is_sent_a_turn_from_there(tmp_path):
    text = """[feedback]
fields = ["= A5", "mode u8", "quaternion f32 x4", "yaw f32", "pitch f32", "pitch_rate f32", "yaw_rate f32",
"crc mcrf4xx"]
switch_on = { mode = 1 }
[command]
fields = ["= 5A", "mode u8", "pitch i16 *0.0001", "yaw i16 *0.0001", "crc mcrf4xx"]
sent.idle = { mode = 0 }
sent.control = { mode = 1 }
sent.fire = { mode = 2 }
"""
    (tmp_path / "narrow.toml").write_text(text)
    run = Run(wire=load_wire(tmp_path / "narrow.toml"))
    run.decide(2, on=False)
    frame = run.pilot._encoded(np.array([0.1, 3.3]), True, True)
    sent = run.wire.layouts["command"].decode(frame)
    assert sent["yaw"] == pytest.approx(3.3 - 2.0 * np.pi, abs=1e-4)


def test_a_line_that_was_kept_back_is_no_other_clock():
    clock = ClockOffset(0.03)
    for number in range(100):
        assert clock.own_time(0.0125 * number, 0.0125 * number + 0.53) is not None
    before = clock.own_time(1.25, 1.78)
    for number in range(101, 130):  # 0.36 s of frames, all received at once
        found = clock.own_time(0.0125 * number, 2.3)
        assert np.isnan(found) or found == pytest.approx(0.0125 * number + 0.5, abs=1e-6)
    assert before == pytest.approx(1.75)

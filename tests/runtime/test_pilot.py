"""The pilot: where it places plates, what it sends, and that it shoots through bytes on the virtual robot."""

import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from archerfish.controllers.registry import make_controller
from archerfish.dynamics.linear_axis import advance, gimbal_angle, rest_state
from archerfish.protocols import aim
from archerfish.robot import Robot
from archerfish.runtime import Pilot
from archerfish.runtime.deciders import make_decider
from archerfish.safety.rules import GateConfig
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.virtual_robot.monitor import CommandMonitor
from archerfish.wires import Stream, load_wire

INFANTRY, TASK = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
WIRE, LATENCY = load_wire("sp_vision_25"), INFANTRY.sensing.camera.latency


class Asks:
    """A controller that asks for one angle, and keeps what it sees."""

    def __init__(self, *angle):
        self.angle, self.seen = np.array([angle]), []

    def reset(self, seen, truth=None):
        return np.zeros(1)

    def step(self, state, seen):
        self.seen.append(seen)
        return state + 1, aim(self.angle)


def piloted(controller, wire=WIRE, robot=INFANTRY, **options):
    """Return a pilot that decides by a controller in NumPy."""
    return Pilot(make_decider("own", controller, robot, TASK, GateConfig()), robot, TASK, wire, **options)


def report(time, yaw, *, on=True, pitch=0.1):
    """Return a report that arrives at a time; the time in it makes each differ."""
    return WIRE.layouts["feedback"].encode({"mode": on, "yaw": yaw, "pitch": pitch, "quaternion": [time] * 4})


def sent(pilot, now):
    [frame] = Stream([WIRE.layouts["command"]]).feed(pilot.tick(now))
    values = frame.layout.decode(frame.data)
    return values["mode"], values["pitch"], values["yaw"]


def run(pilot, decisions, *, yaw=lambda time: 0.0, on=lambda time: time > 0.59, plate=None, begin=100.0, follows=False):
    """Let reports come each 2 ms and a frame each decision; return what was sent.

    The operator's switch goes on after half a second of good input. A gimbal that follows does as its plant says.
    """
    commands, model = [], INFANTRY.gimbal(0.02)
    pose, plant = {"yaw": 0.0}, rest_state(model, np.array([0.1, 0.0]))
    for tick in range(1, 10 * decisions + 1):
        now = begin + 2e-3 * tick
        if not follows:
            pose = {"yaw": yaw(now - 100.0)}
        pilot.on_bytes(now, report(now, on=on(now - 100.0), **pose))
        if tick % 10 == 0:
            if plate:
                stamp, place, frame = plate(now - LATENCY - 100.0)
                pilot.on_datagram(now, json.dumps({"stamp": stamp, "plates": [place], "frame": frame}).encode())
            commands.append(sent(pilot, now))
            if follows and commands[-1][0] > 0:
                plant = advance(model, plant, np.array(commands[-1][1:]))
                pose = dict(zip(("pitch", "yaw"), gimbal_angle(model, plant).tolist(), strict=True))
    return np.array(commands)


@pytest.mark.parametrize("frame", ["camera", "gimbal", "world"])
def test_a_plate_is_placed_by_the_gimbal_at_its_exposure_whatever_the_clock_of_the_camera(frame):
    controller, latency, true = Asks(0.1, 0.0), INFANTRY.sensing.link.feedback_latency, np.array([3.0, 0.4, 0.5])

    def turned(exposed):  # reports are late by their latency
        angle = 2.0 * (exposed + latency)
        level = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]) @ true
        up = np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])
        place = true if frame == "world" else up @ level - [0.05 * (frame == "camera"), 0, 0]
        return exposed + 7e5, place.tolist(), frame

    pilot = piloted(controller, camera_m=(0.05, 0.0, 0.0))
    run(pilot, 10, yaw=lambda time: 2.0 * time, plate=turned)
    for seen in controller.seen[3:]:
        assert seen.frames.found.all()
        np.testing.assert_allclose(seen.frames.position[0, 0, 0], true, atol=3e-3)
        np.testing.assert_allclose(seen.frames.age, LATENCY, atol=1e-4)
    np.testing.assert_allclose([seen.elapsed[0] for seen in controller.seen[-3:]], 0.02, rtol=1e-3)


def ahead(exposed):
    return exposed, [3.0, 0.0, 0.0], "camera"


def test_the_gimbal_idles_until_the_switch_is_on_then_moves_within_its_limits():
    commands = run(piloted(Asks(-0.1, 0.5)), 90, plate=ahead, follows=True)
    modes, moved = commands[:, 0], np.diff(commands[29:, 1:], axis=0)
    assert set(modes[:29]) == {0}
    assert (set(modes[29:33]), set(modes[-20:])) == ({1}, {2})  # limited commands are not fired
    np.testing.assert_allclose(commands[29, 1:], [0.1, 0.0], atol=1e-7)
    np.testing.assert_allclose(commands[-1, 1:], [-0.1, 0.5], atol=1e-6)
    for axis, limits in enumerate((INFANTRY.limits.pitch, INFANTRY.limits.yaw)):
        assert np.abs(np.diff(moved[:, axis])).max() <= limits.max_acceleration * 0.02**2 * 1.001
    assert set(run(piloted(Asks(math.nan, 0.5)), 40, plate=ahead)[:, 0]) == {0}


def test_yaw_is_sent_in_the_turn_of_the_last_report():
    yaw = lambda time: (2.4 + time + np.pi) % (2 * np.pi) - np.pi  # noqa: E731
    wide = INFANTRY.limits.replace(yaw=INFANTRY.limits.yaw.replace(low=-50.0, high=50.0))
    commands = run(piloted(Asks(0.1, 3.3), robot=INFANTRY.replace(limits=wide)), 90, yaw=yaw, plate=ahead)
    assert yaw(1.8) < 0.0
    raw = np.array([yaw(0.02 * number) for number in range(1, 91)])
    assert np.abs(commands[29:, 2] - raw[29:]).max() < 1.5
    assert np.abs(np.diff(np.unwrap(commands[29:, 2]))).max() < 0.2


def test_the_yaw_of_a_chassis_that_turns_goes_on_without_jumps_and_the_encoder_is_the_difference():
    wire, controller = load_wire("roborts"), Asks(0.1, 0.5)
    pilot = piloted(controller, wire)
    for number in range(1, 201):
        base, encoder = 2.5 + 0.02 * number, 0.9 * math.sin(0.1 * number)
        yaw = (base + encoder + math.pi) % (2.0 * math.pi) - math.pi
        values = {"yaw": yaw, "yaw_encoder": encoder, "pitch": 0.1, "pitch_rate": 1e-3 * number}
        pilot.on_bytes(100.0 + 0.02 * number, wire.layouts[wire.report].encode(values))
        pilot.tick(100.0 + 0.02 * number)
    found = np.array([seen.base.yaw[0] for seen in controller.seen])
    first = 2.0 * math.pi * round((found[0] - 2.52) / (2.0 * math.pi))
    np.testing.assert_allclose(found - first, 2.5 + 0.02 * np.arange(1, 201), atol=0.01)
    angles = np.array([seen.gimbal.angle[0, 1] for seen in controller.seen])
    np.testing.assert_allclose(angles - found, 0.9 * np.sin(0.1 * np.arange(1, 201)), atol=0.01)


def test_damaged_messages_are_counted_and_change_nothing():
    controller, rng = Asks(0.1, 0.0), np.random.default_rng(0)
    pilot = piloted(controller)
    run(pilot, 50, plate=ahead)
    bad = [b"{", b'{"stamp": NaN, "plates": []}', b'{"stamp": 1, "plates": [[1e9, 0, 0]]}', b"[" * 100_000, b"\xff"]
    bad += [b'{"stamp": 1e400, "plates": []}', b'{"stamp": 1, "plates": [[1, 0]]}', *map(rng.bytes, range(200))]
    for data in bad:
        pilot.on_datagram(101.01, data)
        pilot.on_bytes(101.01, data)
    pilot.on_bytes(101.01, report(1.0, math.nan) + report(1.0, 0.0) + report(1.0, 0.0) + report(2.0, 1e4))
    assert sent(pilot, 101.02)[0] == 2
    np.testing.assert_allclose(controller.seen[-1].gimbal.angle, [[0.1, 0.0]], atol=1e-7)
    expected = {"refused datagrams": len(bad) - 1, "reports out of range": 2, "repeated frames": 1}
    assert {name: pilot.counts[name] for name in expected} == expected  # of no bytes there are no lines


def test_a_repeated_or_an_older_detection_is_no_news():
    controller = Asks(0.1, 0.0)
    pilot = piloted(controller)
    run(pilot, 40, plate=lambda exposed: (exposed, [3.0, 0.0, 0.0], "world"))
    for number in range(1, 31):
        now = 100.8 + 0.02 * number
        pilot.on_bytes(now, report(now, 0.0))
        pilot.on_datagram(now, json.dumps({"stamp": 0.7, "plates": [[3.0, 1.0, 0.0]], "frame": "world"}).encode())
        mode, _, _ = sent(pilot, now)
    assert mode == 1  # its last plate is 0.6 s old, so that nothing is fired
    assert not any(seen.frames.found.any() for seen in controller.seen[-20:])


def test_a_wire_with_heat_fires_what_it_allows():
    wire, shots = load_wire("sp_vision_25", "referee"), []
    pilot = piloted(Asks(0.1, 0.0), wire)
    for number in range(1, 101):
        now = 100.0 + 0.02 * number
        pilot.on_bytes(now, report(now, 0.0, on=number > 30))
        if number == 60:
            pilot.on_bytes(now, wire.layouts["heat"].encode({"shots_left": 3.0}))
        pilot.on_datagram(now, json.dumps({"stamp": now - LATENCY, "plates": [[3.0, 0.0, 0.0]]}).encode())
        shots.append(sent(pilot, now)[0] == 2)
    assert (sum(shots[:59]), sum(shots)) == (0, 3)


def test_a_gimbal_that_does_not_do_what_its_plant_says_is_held():
    pilot = piloted(Asks(0.1, 0.5))
    run(pilot, 90, plate=ahead)  # it stands, whatever is commanded
    assert pilot.state_text == "fault: implausible"


def test_it_says_why_it_is_not_armed_and_a_command_that_was_not_sent_does_not_count():
    pilot = piloted(Asks(0.1, 0.5))
    assert (pilot.state_text, pilot.tick(99.0), pilot.last_frame()) == ("waiting for the first report", b"", b"")
    run(pilot, 35, on=lambda time: True, plate=ahead)
    assert pilot.state_text == "disarmed: switch on at start"
    run(pilot, 30, on=lambda time: False, plate=ahead, begin=100.7)
    assert pilot.state_text == "disarmed: switch off"
    run(pilot, 5, on=lambda time: True, plate=ahead, begin=101.3)
    assert pilot.state_text == "armed"
    before = sent(pilot, 101.42)[2]
    pilot.withdraw()
    pilot.on_bytes(101.439, report(2.0, 0.0, on=True))
    assert sent(pilot, 101.44)[2] <= before + 1e-6  # twice the time has passed, in which the command stood still
    assert [
        frame.layout.decode(frame.data)["mode"] for frame in Stream([WIRE.layouts["command"]]).feed(pilot.last_frame())
    ] == [1, 0]


def test_a_pilot_needs_a_camera_of_known_latency_and_a_wire_of_two_directions(refused):
    refused("no latency of its camera", piloted, Asks(0, 0), robot=INFANTRY.replace(sensing=None))
    refused("rm_vision: frame feedback has no pitch_rate, yaw_rate; add", piloted, Asks(0, 0), load_wire("rm_vision"))


def test_stamps_of_a_clock_that_drifts_and_one_that_jumps():
    rng, clock, errors = np.random.default_rng(0), ClockOffset(0.035), []
    for number in range(2000):
        true = number / 80
        late = 0.5 if rng.random() < 0.02 else rng.uniform(0.03, 0.04)
        jump = 3600.0 if number >= 1500 else 0.0
        errors.append(clock.own_time(true * (1 + 50e-6) + 1234.5 + jump, true + late) - true)
    errors = np.array(errors)
    assert np.isnan(errors[:1500]).mean() == pytest.approx(0.02, abs=0.01)
    assert np.nanmax(np.abs(errors[[*range(200, 1500), *range(1700, 2000)]])) < 1.5e-3
    assert (np.isnan(errors[1500:1504]).all(), np.isfinite(errors[1504])) == (True, True)


def test_the_monitor_finds_each_violation():
    limits = INFANTRY.limits
    for place, angle, kind in [
        (0, 1.0, "rate"),
        (0, 0.2, "acceleration"),
        (1, -9.0, "range"),
        (1, math.nan, "not finite"),
    ]:
        monitor, command = CommandMonitor(limits, 0.02), [0.0, 0.0]
        for _ in range(5):
            monitor.command([*command])
        assert not +monitor.violations
        command[place] = angle
        monitor.command(command)
        monitor.fire(0.1, 0.09, True)
        assert kind in +monitor.violations
        assert not {name for name in +monitor.violations if "fire" in name}
        monitor.fire(0.2, 0.09, False)
        assert {name for name in +monitor.violations if "fire" in name} == {
            "fire while the switch is off",
            "fire on old feedback",
        }


class Swing(NamedTuple):
    def position(self, time):
        return np.stack([3.0 + 0.0 * time, 0.4 * np.sin(0.5 * np.pi * time), 0.1 + 0.0 * time], axis=-1)


def shot_through_bytes(wire, *faults):
    """Return the emulator and the pilot after 3 s."""
    emulator = pytest.importorskip("archerfish.virtual_robot.emulator")
    from archerfish.virtual_robot.virtual_robot import VirtualRobot

    pytest.importorskip("mujoco")
    robot = VirtualRobot.load("infantry").description
    faults = [emulator.Fault(*fault) for fault in faults]
    emulated = emulator.Emulator(robot, INFANTRY.limits, load_wire(wire), Swing(), 0.02, seed=1, faults=faults)
    pilot = piloted(make_controller("kalman", INFANTRY, TASK), load_wire(wire))
    for _ in range(150):
        for arrival in emulated.advance(20):
            take = pilot.on_datagram if arrival.is_datagram else pilot.on_bytes
            take(1000.0 + arrival.time_s, arrival.data)
        if wire == "roborts":  # which has no switch
            pilot.switch = emulated.time >= 1.0
        emulated.on_bytes(pilot.tick(1000.0 + emulated.time))
    return emulated, pilot


@pytest.mark.parametrize("wire", ["sp_vision_25", "roborts"])
def test_through_bytes_the_virtual_robot_is_aimed_and_hits(wire):
    emulated, pilot = shot_through_bytes(wire)
    assert len(emulated.hits) == pytest.approx(85, abs=4)  # in 1.7 s, from 0.3 s after it was armed
    assert sum(hit for _, hit in emulated.hits) > 70
    assert (+emulated.monitor.violations, pilot.counts["rejected heads"]) == ({}, 0)


def test_faults_are_seeded_and_damaged_frames_are_rejected(refused):
    faults = [("flip", 1.2, 1.5), ("triple", 1.5, 1.6), ("nan", 1.6, 1.7), ("burst", 1.8, 1.9), ("garbage", 2.0, 2.3)]
    runs = [
        shot_through_bytes("sp_vision_25", *faults, ("camera-clock", 2.5, 9.0), ("blind", 2.7, 2.8)) for _ in (1, 2)
    ]
    assert runs[0][0].hits == runs[1][0].hits
    assert runs[0][1].counts == runs[1][1].counts
    counts = runs[0][1].counts
    assert counts["rejected heads"] > 300
    assert counts["repeated frames"] > 190
    assert counts["reports out of range"] == pytest.approx(100, abs=2)
    refused("perhaps you meant flip", shot_through_bytes, "sp_vision_25", ("flap", 0, 1))

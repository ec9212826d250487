"""An emulated robot: its operator, its camera, what its wire has room for, and times that begin again."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from archerfish.records.limits import UNLIMITED
from archerfish.robot import Robot
from archerfish.studies.rehearse import SwingingPlate, emulated_robot, rehearse, switch_times
from archerfish.task import Task
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Fault
from archerfish.virtual_robot.emulator_port import EmulatorPort

RECORDS = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
DEGREE = math.pi / 180.0


def emulated(virtual="identified", wires=("sp_vision_25",), robot=RECORDS[0], **options):
    return emulated_robot(virtual, robot, RECORDS[1], wires, SwingingPlate(), **options)


def test_the_operator_switches_off_and_on_after_each_fault():
    assert switch_times([]) == [(1.0, math.inf)]
    found = switch_times([Fault("blind", 9.0, 9.5), Fault("silence", 3.0, 4.0)])
    assert found == [(1.0, 4.5), (5.5, 10.0), (11.0, math.inf)]
    overlapping = [Fault("silence", 3.0, 4.0), Fault("flip", 3.5, 6.0), Fault("nan", 2.0, 6.0)]
    assert switch_times(overlapping) == [(1.0, 6.5), (7.5, math.inf)]
    near = [Fault("silence", 3.0, 4.0), Fault("flip", 4.2, 4.4)]
    assert switch_times(near) == [(1.0, 4.5), (4.9 + 1.0, math.inf)]
    assert switch_times([Fault("flip", 0.1, 0.2), Fault("hidden", 3.0, math.inf)]) == [(0.2 + 0.5 + 1.0, math.inf)]


@pytest.mark.parametrize("wire", ["sp_vision_25", "roborts"])
def test_after_a_fault_that_needs_the_switch_the_robot_shoots_again(wire):
    faults = [Fault("silence", 2.5, 3.0)]
    found = rehearse("no-lead", *RECORDS, virtual="identified", wire=wire, seconds=5, tuning="start", faults=faults)
    before, *_, last = found.fired
    assert before > 45, "until the fault"
    assert last > 45, "after the switch was off and on"
    assert found.violations == {}
    kept_on = rehearse(
        "no-lead",
        *RECORDS,
        virtual="identified",
        wire=wire,
        seconds=5,
        tuning="start",
        faults=faults,
        switch_on_s=[(1.0, math.inf)],
    )
    assert kept_on.fired[2:] == (0, 0, 0)


@pytest.mark.parametrize("virtual", ["infantry", "identified"])
def test_the_camera_is_where_the_computer_has_it(virtual):
    if virtual == "infantry":
        pytest.importorskip("mujoco")
    far, near = (
        [
            json.loads(delivery.data)["plates"][0]
            for delivery in emulated(virtual, camera_m=camera_m).advance(1000)
            if delivery.is_datagram and json.loads(delivery.data)["plates"]
        ]
        for camera_m in ((0.0, 0.0, 0.0), (0.5, 0.1, 0.05))
    )
    difference = np.median(far, axis=0) - np.median(near, axis=0)
    np.testing.assert_allclose(difference, [0.5, 0.1, 0.05], atol=0.04)  # noise along the line of sight: 6 %


def test_the_task_has_the_radius_of_a_hit():
    pytest.importorskip("mujoco")
    options = {"virtual": "infantry", "seconds": 2, "tuning": "start"}
    small = rehearse("no-lead", RECORDS[0], RECORDS[1].replace(hit_radius_m=0.001), **options)
    assert (sum(small.hits), small.hit_radius_m) == (0, 0.001)


def wire_with(tmp_path, **types):
    """Return a wire whose report has some fields of another type."""
    usual = {"pitch": "f32", "yaw": "f32", "pitch_rate": "f32", "yaw_rate": "f32", "yaw_encoder": "f32"}
    fields = ["= 53 50", "mode u8", *(f"{name} {kind}" for name, kind in (usual | types).items())]
    command = ["= 53 51", "mode u8", "yaw f32", "pitch f32"]
    states = "".join(f"sent.{state} = {{ mode = {mode} }}\n" for mode, state in enumerate(("idle", "control", "fire")))
    path = tmp_path / "own.toml"
    path.write_text(
        f"[feedback]\nfields = {json.dumps(fields)}\nswitch_on = {{ mode = 1 }}\n"
        f"[command]\nfields = {json.dumps(command)}\n{states}"
    )
    return [path]


def test_a_report_without_room_for_the_limits_is_refused_at_the_start(tmp_path, refused):
    small = f"i16 *{0.01 * DEGREE}"  # up to 327°/s
    problem = "frame feedback: field yaw_rate: it has no room for 12 rad/s, which limits.json allows; give it a wider"
    refused(problem, emulated, wires=wire_with(tmp_path, yaw_rate=small))
    assert emulated(wires=wire_with(tmp_path, yaw_rate=f"i16 *{0.1 * DEGREE}")).time == 0.0
    refused("field pitch: .* no room for -0.43", emulated, wires=wire_with(tmp_path, pitch=f"u16 *{0.01 * DEGREE}"))
    refused("field yaw_encoder: .* 1.30", emulated, wires=wire_with(tmp_path, yaw_encoder=f"i8 *{0.1 * DEGREE}"))
    robot = RECORDS[0]
    turning = robot.limits.yaw.replace(low=None, high=None, max_rate=UNLIMITED)
    robot = robot.replace(limits=robot.limits.replace(yaw=turning))
    assert emulated(robot=robot, wires=wire_with(tmp_path, yaw=small, yaw_rate=small)).time == 0.0


class Clock:
    """A robot that does nothing but note since when its times count."""

    time, trial_s = 0.0, 0.0

    def __init__(self):
        self.trials = []

    def advance(self, ticks):
        self.time += ticks * TICK_S
        return []

    def on_bytes(self, _):
        self.trials.append(self.trial_s)


def test_times_begin_again_with_bytes_after_a_second_without_any():
    robot, sent = Clock(), []
    with EmulatorPort(robot, "127.0.0.1:47999") as port:
        computer = os.open(port.name, os.O_RDWR | os.O_NOCTTY)

        def writes():
            """Write at some times, and never stop the robot."""
            for time_s in (0.1, 0.8, 3.0):
                if time_s <= robot.time and time_s not in sent:
                    sent.append(time_s)
                    os.write(computer, b"x")
            return robot.time > 60.0

        port.run(writes, seconds=3.5)
        os.close(computer)
    first, same, again = robot.trials
    assert first == same == port.begun_s
    assert 0.1 <= first < 0.8
    assert again >= 3.0
    assert 3.6 <= robot.time < 60.0, "the seconds count from the very first bytes"

"""Single faults in virtual time, through bytes: when the last shot is fired, what the gate does, and how it is left."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from archerfish.codegen.library import find_compiler
from archerfish.controllers.registry import make_controller
from archerfish.robot import Robot
from archerfish.runtime.deciders import WithFallback, make_decider
from archerfish.runtime.pilot import Pilot
from archerfish.safety.gate import Mode
from archerfish.safety.rules import GateConfig
from archerfish.task import Task
from archerfish.wires import load_wire

pytest.importorskip("mujoco", reason="the virtual robot needs MuJoCo")
from archerfish.studies.rehearse import SwingingPlate, emulated_robot
from archerfish.virtual_robot.emulator import Fault

INFANTRY, TASK = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("any")
BEGIN_S, SWITCH_S, PERIOD_S = 1.6, ((0.8, 3.0), (3.4, 9.0)), 0.02
NEVER_FAULT, LATCHED = "armed again by itself", "armed again by the switch alone"


class Decided(NamedTuple):
    """What became of the decisions."""

    time: np.ndarray
    mode: np.ndarray
    fire: np.ndarray
    violations: dict[str, int]


class Broken:
    """A Kalman filter that fails in some way from a time on."""

    def __init__(self, kind):
        self._kalman, self._kind, self._decisions = make_controller("kalman", INFANTRY, TASK), kind, 0

    def reset(self, seen, truth=None):
        return self._kalman.reset(seen)

    def step(self, state, seen):
        self._decisions += 1
        state, command = self._kalman.step(state, seen)
        if self._decisions * PERIOD_S >= BEGIN_S and self._kind == "raises":
            raise RuntimeError("broken")
        if self._decisions * PERIOD_S >= BEGIN_S:
            command = command._replace(angle=np.full_like(np.asarray(command.angle), self._kind))
        return state, command


def decider(controller):
    return make_decider("own", controller, INFANTRY, TASK, GateConfig())


def kalman():
    return decider(make_controller("kalman", INFANTRY, TASK))


def run(*faults, decider=None, stopped_s=(), seconds=4.2):
    """Shoot through bytes; the operator switches off at 3 s and on again at 3.4 s.

    Args:
      faults: of the robot.
      decider: a Kalman filter if not given.
      stopped_s: begin and end of a time in which the computer does nothing [s].
      seconds: in all.
    """
    emulator = emulated_robot("infantry", INFANTRY, TASK, ["sp_vision_25"], SwingingPlate(), seed=1, faults=faults)
    emulator._switch_times = SWITCH_S
    pilot = Pilot(decider or kalman(), INFANTRY, TASK, load_wire("sp_vision_25"))
    rows, waiting = [], []
    for number in range(1, round(seconds / PERIOD_S) + 1):
        waiting += emulator.advance(20)
        time = number * PERIOD_S
        if stopped_s and stopped_s[0] <= time < stopped_s[1]:
            continue
        for arrival in waiting:
            take = pilot.on_datagram if arrival.is_datagram else pilot.on_bytes
            take(1000.0 + arrival.time_s, arrival.data)
        waiting = []
        emulator.on_bytes(pilot.tick(1000.0 + time))
        if pilot.verdict is not None:
            rows.append((time, int(pilot.verdict.mode), bool(pilot.verdict.fire)))
    time, mode, fire = np.array(rows).T
    return Decided(time, mode, fire > 0, dict(+emulator.monitor.violations))


FAULTS = {
    "nothing": ((), None, NEVER_FAULT),
    "silence": ((Fault("silence", BEGIN_S, 2.2),), 0.06, LATCHED),
    "short silence": ((Fault("silence", BEGIN_S, BEGIN_S + 0.03),), None, NEVER_FAULT),
    "garbage and cut frames": ((Fault("garbage", BEGIN_S, 2.2),), None, NEVER_FAULT),
    "a bit of each frame": ((Fault("flip", BEGIN_S, 2.2),), 0.06, LATCHED),
    "NaN with a good checksum": ((Fault("nan", BEGIN_S, 2.2),), 0.06, LATCHED),
    "one frame again and again": ((Fault("frozen", BEGIN_S, 2.2),), 0.06, LATCHED),
    "all frames at the end": ((Fault("burst", BEGIN_S, 2.2),), 0.06, LATCHED),
    "frames 0.2 s late": ((Fault("late", BEGIN_S, 2.2),), 0.06, LATCHED),
    "frames three times": ((Fault("triple", BEGIN_S, 2.2),), None, NEVER_FAULT),
    "another clock of the camera": ((Fault("camera-clock", BEGIN_S, 9.0),), None, NEVER_FAULT),
    "no detections": ((Fault("blind", BEGIN_S, 2.2),), 0.3, NEVER_FAULT),
    "NaN detections": ((Fault("nan-detections", BEGIN_S, 2.2),), 0.3, NEVER_FAULT),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_the_link_or_the_camera_ends_the_fire_in_time(name):
    faults, last_fire_s, ending = FAULTS[name]
    found = run(*faults)
    assert found.violations == {}
    during = (found.time > BEGIN_S) & (found.time <= 2.2)
    assert found.fire[during].any() if last_fire_s is None else True
    if last_fire_s is not None:
        assert not found.fire[during & (found.time > BEGIN_S + last_fire_s)].any()
    before_the_switch = found.mode[(found.time > 2.6) & (found.time < 3.0)]
    assert set(before_the_switch) == {Mode.FAULT if ending == LATCHED else Mode.ARMED}
    after = found.time > 3.6
    assert set(found.mode[after]) == {Mode.ARMED}
    assert found.fire[after].mean() > 0.7


def test_a_computer_that_stopped_fires_nothing_and_needs_the_switch():
    found = run(stopped_s=(BEGIN_S, BEGIN_S + 0.3))
    assert found.violations == {}
    assert set(found.mode[(found.time > BEGIN_S + 0.4) & (found.time < 3.0)]) == {Mode.FAULT}
    assert found.mode[-1] == Mode.ARMED


@pytest.mark.parametrize("kind", ["raises", np.nan, 1e9])
def test_a_broken_controller_is_replaced_without_a_lost_shot(kind):
    both = WithFallback(decider(Broken(kind)), kalman(), 1.0)
    found = run(decider=both)
    assert (found.violations, bool(both.fault)) == ({}, True)
    assert set(found.mode[(found.time > BEGIN_S) & (found.time < 3.0)]) == {Mode.ARMED}
    assert found.fire[(found.time > BEGIN_S) & (found.time < 2.9)].mean() > 0.7


def test_a_controller_without_a_number_holds_and_is_a_fault():
    found = run(decider=decider(Broken(np.nan)))
    assert found.violations == {}
    assert not found.fire[found.time > BEGIN_S].any()
    assert found.mode[-1] == Mode.FAULT


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler is at hand")
@pytest.mark.parametrize(
    ("wire", "fault"), [("sp_vision_25", "silence"), ("sp_vision_25", "flip"), ("roborts", "burst")]
)
def test_c_sends_what_numpy_sends(wire, fault):
    kalman = make_controller("kalman", INFANTRY, TASK)
    pilots = [
        Pilot(make_decider("kalman", kalman, INFANTRY, TASK, GateConfig(), in_c=in_c), INFANTRY, TASK, load_wire(wire))
        for in_c in (True, False)
    ]
    faults = [Fault(fault, BEGIN_S, 2.2)]
    emulator = emulated_robot("infantry", INFANTRY, TASK, [wire], SwingingPlate(), seed=1, faults=faults)
    sent = []
    for number in range(1, round(3.0 / PERIOD_S)):
        arrivals = emulator.advance(20)
        for pilot in pilots:
            pilot.switch = pilot.switch if emulator.has_switch else emulator.is_switch_on
            for arrival in arrivals:
                take = pilot.on_datagram if arrival.is_datagram else pilot.on_bytes
                take(1000.0 + arrival.time_s, arrival.data)
        sent.append([pilot.tick(1000.0 + number * PERIOD_S) for pilot in pilots])
        emulator.on_bytes(sent[-1][0])
        one, other = (pilot.verdict for pilot in pilots)
        assert [float(code) for code in one[1:]] == [float(code) for code in other[1:]]
        np.testing.assert_allclose(one.angle, other.angle, atol=1e-6)
    differing = sum(one != other for one, other in sent)
    assert differing == 0 if wire == "roborts" else differing < len(sent)  # a float32 shows the last place

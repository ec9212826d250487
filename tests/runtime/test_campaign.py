"""Faults in virtual time, through bytes: when the last shot is fired, what the gate does, and how it is left."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from archerfish.codegen.library import find_compiler
from archerfish.controllers.registry import make_controller
from archerfish.robot import Robot
from archerfish.runtime.deciders import make_decider
from archerfish.runtime.pilot import Pilot
from archerfish.safety.gate import Mode
from archerfish.safety.rules import GateConfig
from archerfish.task import Task
from archerfish.wires import load_wire

pytest.importorskip("mujoco", reason="the virtual robot needs MuJoCo")
from archerfish.studies.rehearse import SwingingPlate, emulated_robot
from archerfish.virtual_robot.emulator import Fault

ROOT = Path(__file__).parents[2]
CAMPAIGN = runpy.run_path(str(ROOT / "benchmarks" / "campaign.py"))
RECORDS = Robot.load(ROOT / "tests" / "infantry"), Task.load("any")
BEGIN_S, END_S, SWITCH_S = 1.6, 2.2, ((0.8, 3.0), (3.4, 9.0))
NEVER_FAULT, LATCHED = "armed again by itself", "armed again by the switch alone"


def run(*faults, **options):
    """Shoot through bytes; the operator switches off at 3 s and on again at 3.4 s."""
    return CAMPAIGN["run"](faults, switch_on_s=SWITCH_S, seconds=4.2, records=RECORDS, **options)


FAULTS = {
    "nothing": ((), None, NEVER_FAULT),
    "silence": ((Fault("silence", BEGIN_S, END_S),), 0.06, LATCHED),
    "short silence": ((Fault("silence", BEGIN_S, BEGIN_S + 0.03),), None, NEVER_FAULT),
    "garbage and cut frames": ((Fault("garbage", BEGIN_S, END_S),), None, NEVER_FAULT),
    "a bit of each frame": ((Fault("flip", BEGIN_S, END_S),), 0.06, LATCHED),
    "NaN with a good checksum": ((Fault("nan", BEGIN_S, END_S),), 0.06, LATCHED),
    "one frame again and again": ((Fault("frozen", BEGIN_S, END_S),), 0.06, LATCHED),
    "all frames at the end": ((Fault("burst", BEGIN_S, END_S),), 0.06, LATCHED),
    "frames 0.2 s late": ((Fault("late", BEGIN_S, END_S),), 0.06, LATCHED),
    "frames three times": ((Fault("triple", BEGIN_S, END_S),), None, NEVER_FAULT),
    "another clock of the camera": ((Fault("camera-clock", BEGIN_S, 9.0),), None, NEVER_FAULT),
    "no detections": ((Fault("blind", BEGIN_S, END_S),), 0.3, NEVER_FAULT),
    "NaN detections": ((Fault("nan-detections", BEGIN_S, END_S),), 0.3, NEVER_FAULT),
    "a hidden plate": ((Fault("hidden", BEGIN_S, END_S),), 0.3, NEVER_FAULT),
    "silence, then garbage": ((Fault("silence", BEGIN_S, 2.0), Fault("garbage", 1.9, END_S)), 0.06, LATCHED),
    "flips of frames that come at once": ((Fault("burst", BEGIN_S, END_S), Fault("flip", 1.7, 2.0)), 0.06, LATCHED),
    "a computer that stops": ((Fault("stopped", BEGIN_S, END_S),), 0.0, LATCHED),
    "a controller that raises": ((Fault("raises", BEGIN_S, END_S),), None, NEVER_FAULT),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_ends_the_fire_in_time(name):
    faults, last_fire_s, ending = FAULTS[name]
    found = run(*faults)
    assert CAMPAIGN["broken_rules"](found, shoots_again_s=3.6) == {}
    during = (found.time > BEGIN_S) & (found.time <= END_S)
    if last_fire_s is None:
        assert found.fire[during].any()
    else:
        assert not found.fire[during & (found.time > BEGIN_S + last_fire_s)].any()
    before_the_switch = found.mode[(found.time > 2.6) & (found.time < 3.0)]
    assert set(before_the_switch) == {Mode.FAULT if ending == LATCHED else Mode.ARMED}
    assert found.fire[found.time > 3.6].mean() > 0.7


@pytest.mark.parametrize("number", [np.nan, 1e9])
def test_a_controller_without_a_number_is_replaced_without_a_lost_shot(number):
    found = run(Fault("no number", BEGIN_S, END_S), number=number)
    assert CAMPAIGN["broken_rules"](found, shoots_again_s=3.6) == {}
    assert set(found.mode[(found.time > BEGIN_S) & (found.time < 3.0)]) == {Mode.ARMED}
    assert found.fire[(found.time > BEGIN_S) & (found.time < 2.9)].mean() > 0.7


def test_without_a_fallback_it_holds_and_is_a_fault():
    found = run(Fault("no number", BEGIN_S, 9.0), fallback=False)
    assert found.violations == {}
    assert not found.fire[found.time > BEGIN_S].any()
    assert found.mode[-1] == Mode.FAULT


def test_on_the_line_nothing_overtakes_and_what_arrives_late_is_known_to_be_old(refused):
    robot, task = RECORDS
    faults = [
        Fault("late", 0.3, 0.4),
        Fault("burst", 0.7, 0.8),
        Fault("silence", 0.35, 0.37),
        Fault("flip", 0.35, 0.36),
    ]
    emulator = emulated_robot("infantry", robot, task, ["sp_vision_25"], SwingingPlate(), faults=faults)
    ages, last_s = [], -1.0
    for _ in range(500):
        arrived = [delivery for delivery in emulator.advance(2) if not delivery.is_datagram and delivery.data]
        times = [last_s, *(delivery.time_s for delivery in arrived)]
        assert times == sorted(times)
        last_s = times[-1]
        ages.append(emulator.time - emulator.informed_s)
    ages = dict(zip(range(2, 1002, 2), ages, strict=True))
    assert (ages[298], ages[604], ages[802]) == pytest.approx((0.0, 0.0, 0.0), abs=0.003)
    assert ages[498] == pytest.approx(0.2, abs=0.004)
    assert ages[550] == pytest.approx(0.2, abs=0.004)  # of the first late one, and so on
    assert ages[796] == pytest.approx(0.096, abs=0.004)
    nan = [Fault("nan", 1.0, 2.0)]
    refused("fault nan: the angles of this wire", emulated_robot, "infantry", *RECORDS, ["roborts"], None, faults=nan)


def test_the_rules_of_the_campaign_find_what_breaks_them():
    found = run(Fault("silence", BEGIN_S, END_S))
    found.mode[:] = Mode.ARMED
    broken = CAMPAIGN["broken_rules"](found, shoots_again_s=3.6)
    assert broken["no fault after 100 ms and a decision"] >= 20
    found.mode[found.time < 1.9] = Mode.FAULT
    broken = CAMPAIGN["broken_rules"](found, shoots_again_s=3.6)
    assert broken["fault left with the switch on"] == broken["fault left before 0.5 s of good input"] == 1


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler is at hand")
@pytest.mark.parametrize(
    ("wire", "fault"), [("sp_vision_25", "silence"), ("sp_vision_25", "flip"), ("roborts", "burst")]
)
def test_c_sends_what_numpy_sends(wire, fault):
    kalman = make_controller("kalman", *RECORDS)
    pilots = [
        Pilot(make_decider("kalman", kalman, *RECORDS, GateConfig(), in_c=in_c), *RECORDS, load_wire(wire))
        for in_c in (True, False)
    ]
    faults = [Fault(fault, BEGIN_S, END_S)]
    emulator = emulated_robot("infantry", *RECORDS, [wire], SwingingPlate(), seed=1, faults=faults)
    sent = []
    for number in range(1, round(3.0 / 0.02)):
        arrivals = emulator.advance(20)
        for pilot in pilots:
            pilot.switch = pilot.switch if emulator.has_switch else emulator.is_switch_on
            for arrival in arrivals:
                take = pilot.on_datagram if arrival.is_datagram else pilot.on_bytes
                take(1000.0 + arrival.time_s, arrival.data)
        sent.append([pilot.tick(1000.0 + number * 0.02) for pilot in pilots])
        emulator.on_bytes(sent[-1][0])
        one, other = (pilot.verdict for pilot in pilots)
        assert [float(code) for code in one[1:]] == [float(code) for code in other[1:]]
        np.testing.assert_allclose(one.angle, other.angle, atol=1e-6)
    differing = sum(one != other for one, other in sent)
    assert differing == 0 if wire == "roborts" else differing < len(sent)  # a float32 shows the last place

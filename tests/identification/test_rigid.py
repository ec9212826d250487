"""A rigid axis: parameters from simulated logs of known truth, friction, coverage, and rates that contradict angles."""

import functools
import math
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.logs.recording import Recording

identify_rigid = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "rigid_axis_fit.py"))["identify_rigid"]

ROOT = Path(__file__).parents[2]
PERIOD, COUNT = 0.02, 300
INERTIA, DAMPING, MOMENT, PHASE, OFFSET = 0.02, 0.05, 0.4, -1.2, 0.03
TRUTH = {
    "yaw": {"inertia": INERTIA, "damping": DAMPING, "torque_offset": OFFSET},
    "pitch": {"inertia": INERTIA, "damping": DAMPING, "gravity_moment": MOMENT, "gravity_phase": PHASE},
}


@functools.cache
def simulated(kind, friction=0.0, fine=200):
    """Torque (N,) of a sweep and a square wave, and angle and rate (N, 2) of an axis that sticks and slides."""
    moment, offset = (0.0, OFFSET) if kind == "yaw" else (MOMENT, 0.0)
    time, angle, rate, states, step = PERIOD * np.arange(COUNT), -1.0, 0.0, [], PERIOD / fine
    torque = 0.3 * (np.sin(2 * np.pi * (0.3 * time + 0.225 * time**2)) + 0.5 * np.sign(np.sin(2.3 * time)))
    torque *= 1.6 if friction and kind == "pitch" else 1.0
    for push in torque.tolist():
        states.append((angle, rate))
        for _ in range(fine):
            net = push + offset - DAMPING * rate - moment * math.sin(angle - PHASE)
            if rate or abs(net) > friction:
                faster = rate + step * (net - math.copysign(friction, rate or net)) / INERTIA
                faster = 0.0 if friction and rate * faster < 0 else faster
                angle, rate = angle + step * (rate + faster) / 2, faster
    return torque, np.array(states)


def recording(kind, *, seed=0, rho=0.0, scale=1.0, names=("angle", "gyro")):
    torque, states = simulated(kind)
    white = np.random.default_rng(seed).standard_normal((COUNT + 200, 2))
    noise = lfilter([np.sqrt(1 - rho**2)], [1, -rho], white, axis=0)[200:]
    return Recording.from_arrays(torque / scale, states + noise * [0.01, 0.1], PERIOD, output_names=names, source="log")


@pytest.mark.parametrize("kind", TRUTH)
def test_a_clean_log_gives_the_parameters_back(kind):
    torque, states = simulated(kind)
    result = identify_rigid([Recording.from_arrays(torque, states[:, 0], PERIOD)], kind, friction="none")
    assert {name: each.value for name, each in result.estimates.items()} == pytest.approx(TRUTH[kind], rel=1e-3)
    assert (result.fits[0][1] > 99.9, result.report.usable) == (True, True)


@pytest.mark.parametrize("kind", TRUTH)
def test_friction_is_found_and_does_not_pass_for_damping(kind):
    torque, states = simulated(kind, 0.06)
    angle = states[:, 0] + 0.005 * np.random.default_rng(0).standard_normal(COUNT)
    log = Recording.from_arrays(torque, angle, PERIOD)
    found = {name: each.value for name, each in identify_rigid([log], kind, segment_s=1.0).estimates.items()}
    assert found["friction"] == pytest.approx(0.06, rel=0.05)
    assert (found["damping"], found["inertia"]) == (pytest.approx(DAMPING, rel=0.03), pytest.approx(INERTIA, rel=0.01))
    assert identify_rigid([log], kind, friction="none").estimates["damping"].value > 1.2 * DAMPING


REFUSED = {
    "log: angle does not accelerate with the torque; check columns, .*sign": ((1, 1), {"torque_per_unit": -1.0}),
    "segment_s ≥ 0.05, 50 samples of each log, got 1, 0, 300": ((1, 1), {"segment_s": 0.0}),
    "expected an output rate, got angle, gyro; name the rate": ((1, 1), {"rate": "rate"}),
    "is -1.* times the derivative of the angle, expected 1: its sign is turned": ((1, -1), {"rate": "gyro"}),
    "is 57.* expected 1: its unit is another one, as degrees for 57.3": ((1, 180 / np.pi), {"rate": "gyro"}),
    "is 0.00076.* its unit is another one": ((4096 / np.pi, 1), {"rate": "gyro"}),
    "it is of another axis": ((1, 0), {"rate": "gyro"}),
}


@pytest.mark.parametrize("complaint", REFUSED)
def test_what_can_not_be_used_and_a_rate_that_contradicts_the_angle_are_refused(complaint, refused):
    log, (factors, options) = recording("yaw"), REFUSED[complaint]
    outputs = log.outputs * factors + [0.0, not factors[1]] * np.cos(5 * log.time)[:, None]
    refused(complaint, identify_rigid, [replace(log, outputs=outputs)], "yaw", **options)


def test_the_example_gives_the_parameters_of_its_axis():
    sys.path.insert(0, str(ROOT / "examples"))
    example = runpy.run_path(str(ROOT / "examples" / "rigid_axis.py"))
    log, axis = example["simulated_log"](6.0), example["AXIS"]
    found = identify_rigid([log], "pitch", friction="coulomb", segment_s=1.0).estimates
    expected = axis.mass * axis.length**2, axis.damping, axis.mass * axis.length * axis.gravity, example["FRICTION"]
    places = "inertia", "damping", "gravity_moment", "friction"
    assert [found[name].value for name in places] == pytest.approx(expected, rel=0.01)

"""Coulomb friction: found where it is, left out where it is not, and no longer taken for damping."""

import functools

import numpy as np
import pytest

from archerfish.identification.rigid.fit import identify_rigid_axis
from archerfish.records.recording import make_recording

PERIOD, COUNT, FINE = 0.02, 300, 40
INERTIA, DAMPING, MOMENT, PHASE, OFFSET = 0.02, 0.05, 0.4, -1.2, 0.03


@functools.cache
def rig(kind, friction):
    """Torque and angle of a rig that sticks and slides, in steps of half a millisecond."""
    time = np.arange(COUNT) * PERIOD
    slow = np.sign(np.sin(2 * np.pi * 0.37 * time))
    size = 0.3 if kind == "yaw" else 0.5
    torque = size * (np.sin(2 * np.pi * (0.3 * time + 1.35 * time**2 / time[-1])) + 0.5 * slow)
    moment, offset = (0.0, OFFSET) if kind == "yaw" else (MOMENT, 0.0)
    angle, rate, angles, step = -1.0, 0.0, [], PERIOD / FINE
    for push in torque:
        angles.append(angle)
        for _ in range(FINE):
            net = push + offset - DAMPING * rate - moment * np.sin(angle - PHASE)
            if rate == 0 and abs(net) <= friction:
                continue
            way = np.sign(rate) if rate else np.sign(net)
            faster = rate + step * (net - way * friction) / INERTIA
            faster = 0.0 if rate * faster < 0 else faster
            angle += step * (rate + faster) / 2
            rate = faster
    return torque, np.array(angles)


def identified(kind, dry, *, noise=0.005, **options):
    torque, angle = rig(kind, dry)
    measured = angle + noise * np.random.default_rng(0).standard_normal(COUNT)
    return identify_rigid_axis([make_recording(torque, measured, PERIOD)], kind, **options)


@pytest.mark.parametrize("kind", ["yaw", "pitch"])
def test_friction_is_found_and_the_damping_is_not_biased(kind):
    result = identified(kind, 0.06)
    assert result.record.friction == pytest.approx(0.06, rel=0.06)
    assert result.record.damping == pytest.approx(DAMPING, rel=0.03)
    assert result.record.inertia == pytest.approx(INERTIA, rel=0.01)
    low, high = result.record.intervals["friction"]
    assert 0.05 < low < result.record.friction < high < 0.07
    assert result.record.standard_errors["friction"] == pytest.approx((high - low) / 3.92, rel=1e-3)
    assert result.fit_percent[0] > 99


def test_left_out_on_demand_it_passes_for_damping():
    record = identified("yaw", 0.06, friction="none").record
    assert record.friction == 0.0
    assert "friction" not in record.intervals
    assert record.damping > 1.2 * DAMPING


@pytest.mark.parametrize("kind", ["yaw", "pitch"])
def test_where_there_is_none_none_is_estimated(kind):
    record = identified(kind, 0.0).record
    assert record.friction == 0.0
    assert "friction" not in record.intervals


def test_on_demand_it_is_estimated_where_there_is_none():
    record = identified("yaw", 0.0, friction="coulomb").record
    low, high = record.intervals["friction"]
    assert low < 0.002
    assert high < 0.005


def test_noise_that_hides_friction_keeps_it_out():
    assert "friction" not in identified("yaw", 0.002, noise=0.1).record.intervals

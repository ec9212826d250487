import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.arrays import single_precision
from archerfish2.dynamics.command_limits import limit_command, named_limits
from archerfish2.dynamics.slew import approach
from archerfish2.paper.gimbal import gate_limits

PERIOD = np.float32(0.02)
LOW, HIGH = (np.radians(each).astype(np.float32) for each in ([-25.0, -75.0], [10.0, 75.0]))
GATE, BOX, LEAD = (single_precision(named_limits(name, gate_limits())) for name in ("gate", "box", "los-2deg"))


def commands(limits, desired):
    """Return the commands that come of desired ones, from rest at zero, two zeros first."""
    found = [np.zeros(desired.shape[1:], np.float32)] * 2
    for each in desired.astype(np.float32):
        found.append(limit_command(limits, each, found[-1], (found[-1] - found[-2]) / PERIOD, 0.0 * each, PERIOD))
    return np.array(found)


def test_the_gate_keeps_range_rate_and_acceleration_whatever_is_asked_and_uses_them_all():
    jumps = np.random.default_rng(13).uniform(-3.0, 3.0, (150, 50, 2))
    ends = np.where(np.arange(150)[:, None, None] < 75, -3.0, 3.0) + 0.0 * jumps
    for desired in (jumps, np.repeat(jumps[:10] / 2, 15, axis=0), np.cumsum(0.05 * jumps, axis=0), ends):
        found = commands(GATE, desired)
        rate = np.diff(found.astype(float), axis=0) / PERIOD
        acceleration = np.abs(np.diff(rate, axis=0) / PERIOD).max((0, 1))
        assert np.all((found >= LOW) & (found <= HIGH))
        assert np.all(np.abs(rate) <= GATE.max_rate + 5e-3)
        assert np.all(acceleration <= GATE.max_acceleration * 1.005)
    assert_allclose([found[76, 0], found[-1, 0], acceleration], [LOW, HIGH, GATE.max_acceleration], rtol=5e-3)
    assert np.abs(rate[..., 1]).max() == pytest.approx(12.0, rel=1e-4)  # without a limit 13 rad/s halfway


def test_what_no_limit_touches_passes_unchanged_and_the_box_only_clips():
    phase = 0.02 * np.arange(200)[:, None] * [5.0, 10.0]
    smooth = np.float32([-0.1, 0.1]) * (1.0 - np.cos(phase)).astype(np.float32)
    assert np.array_equal(commands(GATE, smooth)[2:], smooth)
    jumps = np.random.default_rng(14).uniform(-3.0, 3.0, (50, 10, 2)).astype(np.float32)
    assert np.array_equal(commands(BOX, jumps)[2:], np.clip(jumps, LOW, HIGH))


@pytest.mark.parametrize(("target", "expected"), [(17.0, 19.0), (80.0, 75.0)])
def test_a_limited_lead_holds_yaw_near_the_line_of_sight_and_in_its_range(target, expected):
    zero, degrees = np.zeros(2), np.radians([[-10.0, 80.0], [3.0, target], [-10.0, expected]])
    assert_allclose(limit_command(LEAD, degrees[0], zero, zero, degrees[1], 0.02), degrees[2], rtol=1e-6)


def test_a_slew_takes_the_gate_to_its_aim_in_the_shortest_time_and_stops_there():
    aim, found = np.array([0.1, -1.2], np.float32), [np.zeros(2, np.float32)] * 2
    for _ in range(20):
        rate = (found[-1] - found[-2]) / PERIOD
        found.append(limit_command(GATE, approach(GATE, aim, found[-1], PERIOD), found[-1], rate, aim, PERIOD))
    yaw = np.array(found)[1:, 1]
    assert np.all(yaw >= aim[1] - 1e-6)
    assert np.argmax(yaw == aim[1]) <= math.ceil(2.0 * math.sqrt(1.2 / GATE.max_acceleration[1]) / 0.02) + 1
    assert np.array_equal(found[-1], aim)

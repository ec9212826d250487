import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.command_limits import (
    CommandLimits,
    box_limits,
    fastest_approach,
    gate_limits,
    limit_command,
    line_of_sight_limits,
    named_limits,
)
from archerfish.paper.gimbal import gate_limits as gate_record
from archerfish.records.errors import InputError

PERIOD = 0.02
RECORD = gate_record()
GATE = gate_limits(RECORD)
LOW = np.radians([-25.0, -75.0])
HIGH = np.radians([10.0, 75.0])


def command_series(limits: CommandLimits, wishes: np.ndarray, dtype: type = np.float64) -> np.ndarray:
    """Commands that come of a series of wishes from rest at zero, shape (T, ..., 2)."""
    limits = CommandLimits(*(each.astype(dtype) for each in limits))
    period = np.asarray(PERIOD, dtype)
    previous = rate = np.zeros(wishes.shape[1:], dtype)
    commands = []
    for wish in wishes.astype(dtype):
        command = limit_command(limits, wish, previous, rate, 0.0 * wish, period)
        assert command.dtype == dtype
        previous, rate = command, (command - previous) / period
        commands.append(command)
    return np.array(commands, np.float64)


@pytest.mark.parametrize(("dtype", "slack"), [(np.float64, 1e-9), (np.float32, 5e-3)])
def test_the_gate_keeps_range_rate_and_acceleration_whatever_is_asked(dtype, slack) -> None:
    rng = np.random.default_rng(13)
    # Wild jumps, slow drifts and long holds at and beyond the ends of the range.
    jumps = rng.uniform(-3.0, 3.0, (150, 200, 2))
    holds = np.repeat(rng.uniform(-1.6, 1.6, (10, 200, 2)), 15, axis=0)
    for wishes in (jumps, holds, np.cumsum(0.05 * jumps, axis=0)):
        commands = command_series(GATE, wishes, dtype)
        path = np.concatenate([np.zeros((2, 200, 2)), commands])
        rate = np.diff(path, axis=0) / PERIOD
        acceleration = np.diff(rate, axis=0) / PERIOD
        assert np.all(commands >= LOW.astype(dtype))
        assert np.all(commands <= HIGH.astype(dtype))
        assert np.all(np.abs(rate) <= GATE.max_rate + slack)
        assert np.all(np.abs(acceleration) <= GATE.max_acceleration * (1.0 + slack))


def test_the_gates_limits_are_all_reached() -> None:
    commands = command_series(GATE, np.concatenate([np.full((60, 2), -3.0), np.full((60, 2), 3.0)]))
    acceleration = np.diff(commands, n=2, axis=0) / PERIOD**2
    assert_allclose(np.max(np.abs(acceleration), axis=0), GATE.max_acceleration)
    assert_allclose(commands[59], LOW)
    assert_allclose(commands[-1], HIGH)
    fast = np.max(np.abs(np.diff(commands[:, 1]))) / PERIOD
    # 2.6 rad at 67 rad/s² would reach 13 rad/s halfway: the rate limit of 12 acts.
    assert fast == pytest.approx(12.0)


def test_a_feasible_command_passes_unchanged() -> None:
    time = np.arange(200) * PERIOD
    # Peak rate 1 rad/s and acceleration 10 rad/s², well inside; it starts from rest as 1 − cos.
    wish = np.stack([-0.1 * (1.0 - np.cos(5.0 * time)), 0.1 * (1.0 - np.cos(10.0 * time))], axis=-1)
    for dtype in (np.float64, np.float32):
        assert np.array_equal(command_series(GATE, wish, dtype), wish.astype(dtype))


@pytest.mark.parametrize("limits", [box_limits(RECORD), line_of_sight_limits(RECORD, math.pi)])
def test_the_box_only_clips(limits) -> None:
    wishes = np.random.default_rng(14).uniform(-3.0, 3.0, (50, 10, 2)).astype(np.float32)
    found = command_series(limits, wishes, np.float32)
    assert np.array_equal(found, np.clip(wishes, LOW.astype(np.float32), HIGH.astype(np.float32)))


def test_a_limited_lead_holds_yaw_near_the_line_of_sight() -> None:
    limits = line_of_sight_limits(RECORD, math.radians(2.0))
    sight = np.array([0.05, 0.3])
    found = limit_command(limits, np.array([-0.2, 1.0]), np.zeros(2), np.zeros(2), sight, PERIOD)
    assert_allclose(found, [-0.2, 0.3 + math.radians(2.0)])  # pitch is free


def test_a_limited_lead_never_leaves_the_range() -> None:
    limits = line_of_sight_limits(RECORD, math.radians(2.0))
    sight = np.array([0.0, math.radians(80.0)])
    found = limit_command(limits, np.array([0.0, 1.4]), np.zeros(2), np.zeros(2), sight, PERIOD)
    assert found[1] == HIGH[1]


@pytest.mark.parametrize(("name", "limits"), [("box", box_limits(RECORD)), ("gate", GATE)])
def test_limits_have_names(name, limits) -> None:
    for found, expected in zip(named_limits(name, RECORD, 0.03), limits, strict=True):
        assert np.array_equal(found, expected)
    assert named_limits("los-2deg", RECORD, 0.03).max_lead[1] == 0.03


def test_an_unknown_limit_is_refused() -> None:
    with pytest.raises(InputError, match="one of box, gate, los-2deg, got 'fence'"):
        named_limits("fence", RECORD, 0.03)


def braking_distance(rate: float, max_acceleration: float) -> float:
    way = 0.0
    while rate > 0.0:
        way += rate * PERIOD
        rate -= max_acceleration * PERIOD
    return way


@given(st.floats(1e-6, 3.0), st.floats(1.0, 500.0))
def test_the_fastest_approach_is_the_fastest_that_can_stop(distance, max_acceleration) -> None:
    found = float(fastest_approach(np.asarray(distance), np.asarray(max_acceleration), PERIOD))
    assert braking_distance(found * (1.0 - 1e-9), max_acceleration) <= distance * (1.0 + 1e-9)
    assert braking_distance(found * (1.0 + 1e-6), max_acceleration) > distance


def test_no_way_left_allows_no_rate() -> None:
    assert_allclose(fastest_approach(np.array([0.0, -0.1]), np.full(2, 67.0), PERIOD), 0.0)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
@pytest.mark.parametrize("limits", [GATE, line_of_sight_limits(RECORD, 0.035)])
def test_numpy_and_jax_agree(shape, limits, agree_in_jax) -> None:
    rng = np.random.default_rng(15)
    desired, previous, sight = rng.uniform(-0.4, 0.4, (3, *shape, 2))
    rate = rng.uniform(-1.0, 1.0, (*shape, 2))
    found = agree_in_jax(limit_command, limits, desired, previous, rate, sight, np.asarray(PERIOD))
    assert found.shape == (*shape, 2)


def test_limits_survive_single_precision() -> None:
    assert all(each.dtype == np.float32 for each in single_precision(GATE))

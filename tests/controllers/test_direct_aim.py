import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.controllers.direct_aim import approach
from archerfish.controllers.roster import make_controller
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.command_limits import gate_limits, limit_command
from archerfish.paper.gimbal import gate_limits as gate_record

PERIOD = 0.02
GATE = gate_limits(gate_record())


def way_to(aim: np.ndarray, steps: int = 80) -> np.ndarray:
    """Commands from rest at zero on the way to an aim, through the gate."""
    command = rate = np.zeros_like(aim)
    series = [command]
    for _ in range(steps):
        wanted = approach(GATE, aim, command, PERIOD)
        allowed = limit_command(GATE, wanted, command, rate, aim, PERIOD)
        command, rate = allowed, (allowed - command) / PERIOD
        series.append(command)
    return np.array(series)


def test_the_way_to_an_aim_stops_there_without_overshoot() -> None:
    low, high = GATE.low, GATE.high
    aims = np.random.default_rng(71).uniform(low, high, (100, 2))
    series = way_to(aims)
    assert np.all(np.abs(series) <= np.abs(aims) * (1.0 + 1e-9))
    assert np.all(np.diff(np.abs(series), axis=0) >= -1e-12)
    assert_allclose(series[-1], aims, rtol=1e-9)


def test_the_gate_takes_nothing_from_the_way_while_braking() -> None:
    aim = np.array([0.1, 1.2])
    command = rate = np.zeros(2)
    for _ in range(80):
        wanted = approach(GATE, aim, command, PERIOD)
        allowed = limit_command(GATE, wanted, command, rate, aim, PERIOD)
        braking = np.abs(wanted - command) / PERIOD < np.abs(rate)
        assert_allclose(allowed[braking], wanted[braking], atol=1e-9)
        command, rate = allowed, (allowed - command) / PERIOD


def test_no_way_within_the_limits_is_faster() -> None:
    # By hand: rates of 1, 2 … 2, 1 times 67 · 0.02 rad/s cover 42 · 0.0268 = 1.13 rad in 12 periods, 1.31 rad in 13.
    series = way_to(np.array([0.0, 1.2]))
    assert np.argmax(series[:, 1] > 1.2 - 1e-9) == 13


def test_an_aim_within_reach_is_taken_exactly() -> None:
    aim = np.array([0.01, -0.005], np.float32)
    assert np.array_equal(approach(GATE, aim, np.zeros(2, np.float32), PERIOD), aim)


def test_the_kalman_baseline_settles_on_a_static_target(bench, fight) -> None:
    duel = fight(make_controller("kalman", bench("gate")), static_share=1.0)
    for plate, command in zip(duel.seen.plate[-1, :, 0], duel.allowed[-1], strict=True):
        assert_allclose(command, aim_at(plate.astype(np.float64), bench("gate").muzzle).angle, atol=1e-5)


def test_the_kalman_baseline_commands_the_lead_of_a_moving_target(bench, fight) -> None:
    duel = fight(make_controller("kalman", bench("box")), "box", static_share=0.0)
    motion = duel.truth.motion
    # Far from a turn the target keeps its velocity, and the command points at where pellet and target meet.
    for moment in range(20, 50):
        fired = np.float32(moment * PERIOD + PERIOD)
        later = motion.position(fired + np.linalg.norm(motion.vertex, axis=-1) / 17.5)
        yaw = np.arctan2(later[:, 1], later[:, 0])
        straight = np.abs(later[:, 1] - motion.vertex[:, 1]) < 0.02
        assert np.all(np.abs(duel.command[moment, :, 1] - yaw)[straight] < 0.01)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    aim, command = np.random.default_rng(72).uniform(-0.5, 0.5, (2, *shape, 2))
    found = agree_in_jax(lambda *each: approach(*each), GATE, aim, command, np.asarray(PERIOD))
    assert found.shape == (*shape, 2)

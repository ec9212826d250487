import numpy as np
import pytest

from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.firmware import (
    FirmwareState,
    encoder_angle,
    filtered_rate,
    firmware_torque,
    make_gains,
)
from archerfish.virtual_robot.motor import make_motor, motor_torque

from .made_robots import QUIET, changed, resting_robot


def test_the_current_loop_lags_by_its_time_constant() -> None:
    motor = make_motor(changed(gimbal__yaw__current_lag_ms=5.0, gimbal__pitch__current_lag_ms=0.0).gimbal)
    torque = np.zeros((1, 2))
    for _ in range(5):
        torque = motor_torque(motor, torque, np.array([[0.5, 0.5]]), np.zeros((1, 2)))
    np.testing.assert_allclose(torque, [[0.5, 0.5 * (1 - np.exp(-1))]])


def test_the_back_emf_leaves_less_torque_the_faster_it_turns() -> None:
    motor = make_motor(changed(gimbal__yaw__current_lag_ms=0.0, gimbal__yaw__torque_limit_n_m=10.0).gimbal)
    for rate in (0.0, 10.0, 20.0, 32.0):
        torque = motor_torque(motor, np.zeros((1, 2)), np.array([[0.0, 9.0]]), np.array([[0.0, rate]]))
        assert torque[0, 1] == pytest.approx(0.741 * (24.0 - 0.741 * rate) / 3.6)
        braking = motor_torque(motor, np.zeros((1, 2)), np.array([[0.0, -9.0]]), np.array([[0.0, rate]]))
        assert braking[0, 1] == pytest.approx(max(-9.0, 0.741 * (-24.0 - 0.741 * rate) / 3.6))


def test_beyond_the_no_load_speed_the_supply_brakes() -> None:
    motor = make_motor(changed().gimbal)
    torque = motor_torque(motor, np.zeros((1, 2)), np.array([[1.0, 1.0]]), np.full((1, 2), 40.0))
    assert np.all(torque < 0.0)


def test_the_torque_limit_holds_in_any_slew(physics: str) -> None:
    robot = resting_robot(changed(), 4, physics)
    rng = np.random.default_rng(0)
    largest = 0.0
    for _ in range(60):
        robot.send(np.radians(np.stack([rng.uniform(-25, 10, 4), rng.uniform(-75, 75, 4)], axis=1)))
        for _ in range(10):
            robot.advance(1)
            largest = max(largest, float(np.abs(robot.truth().torque).max()))
    assert largest == pytest.approx(1.2)


def test_the_rate_limit_holds_in_a_slew(physics: str) -> None:
    robot = resting_robot(changed(firmware__yaw__rate_limit_rad_per_s=3.0, **QUIET), 1, physics)
    robot.send(np.radians([[0.0, 70.0]]))
    rates = []
    for _ in range(600):
        robot.advance(1)
        rates.append(robot.truth().rate[0, 1])
    # Friction keeps it below; the integral overshoots by a little.
    assert 2.8 < max(rates) < 3.3
    assert np.median(np.array(rates)[150:350]) == pytest.approx(3.0, abs=0.1)


def test_the_voltage_limits_the_speed_of_a_robot_with_a_weak_supply(physics: str) -> None:
    robot = resting_robot(changed(gimbal__yaw__supply_v=3.0), 1, physics)
    robot.send(np.radians([[0.0, 75.0]]))
    rates = []
    for _ in range(400):
        robot.advance(1)
        rates.append(robot.truth().rate[0, 1])
    assert 0.5 * 3.0 / 0.741 < max(rates) < 3.0 / 0.741


def test_the_integral_rests_while_the_motor_is_at_its_limit() -> None:
    gains = make_gains(changed().firmware, changed().gimbal)
    state = FirmwareState(np.array([[0.0, 0.1]]), np.zeros((1, 2)))
    far, near = np.array([[0.0, 1.0]]), np.array([[0.0, 0.01]])
    pushed, torque = firmware_torque(gains, state, far, np.zeros((1, 2)), np.zeros((1, 2)))
    assert torque[0, 1] == 1.2
    assert pushed.integral[0, 1] == 0.1
    grown, torque = firmware_torque(gains, state, near, np.zeros((1, 2)), np.zeros((1, 2)))
    assert torque[0, 1] == pytest.approx(1.1 * 28 * 0.01 + 0.1)
    assert grown.integral[0, 1] == pytest.approx(0.1 + 7.0 * 28 * 0.01 * TICK_S)
    back, torque = firmware_torque(gains, state, -far, np.zeros((1, 2)), np.zeros((1, 2)))
    assert torque[0, 1] == -1.2
    assert back.integral[0, 1] == 0.1


def test_the_integral_never_passes_its_limit() -> None:
    gains = make_gains(changed().firmware, changed().gimbal)
    state = FirmwareState(np.zeros((1, 2)), np.zeros((1, 2)))
    for _ in range(20000):
        state, _ = firmware_torque(gains, state, np.array([[0.01, -0.01]]), np.zeros((1, 2)), np.zeros((1, 2)))
    np.testing.assert_allclose(state.integral, [[0.6, -0.6]])


def test_the_encoder_reads_in_counts_of_a_turn() -> None:
    gains = make_gains(changed().firmware, changed().gimbal)
    angle = np.random.default_rng(0).uniform(-1, 1, (1000, 2))
    counts = encoder_angle(gains, angle) * 8192 / (2 * np.pi)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    error = encoder_angle(gains, angle) - angle / [1.03, 1.0]
    assert np.abs(error).max() <= np.pi / 8192 + 1e-12
    # Uniform rounding errors: sd = quantum/√12; 1000 samples, false-alarm rate below 1e-6 at 15 %.
    assert error.std() == pytest.approx(2 * np.pi / 8192 / np.sqrt(12), rel=0.15)


def test_the_gyros_noise_is_filtered_white_noise() -> None:
    """A first-order filter of gain a leaves a share a/(2 − a) of white noise; correlation (1 − a) from tick to tick."""
    gains = make_gains(changed().firmware, changed().gimbal)
    rng, gyro, read = np.random.default_rng(1), np.zeros((100, 2)), []
    for _ in range(400):
        gyro = filtered_rate(gains, gyro, np.zeros((100, 2)), rng.standard_normal((100, 2)))
        read.append(gyro)
    a = 1 - np.exp(-2 * np.pi * 150 * 1e-3)
    settled = np.array(read[50:])
    # 70,000 correlated samples: the sd is known to 0.4 %; false-alarm rate below 1e-6 at 2 %.
    assert settled.std() == pytest.approx(0.0055 * np.sqrt(a / (2 - a)), rel=0.02)
    neighbours = np.mean(settled[1:] * settled[:-1]) / settled.var()
    assert neighbours == pytest.approx(1 - a, abs=0.03)


def test_the_encoders_ratio_is_the_axis_steady_gain(physics: str) -> None:
    robot = resting_robot(changed(**QUIET, gimbal__pitch__friction_n_m=0.0, gimbal__yaw__friction_n_m=0.0), 1, physics)
    robot.send(np.array([[-0.2, 0.5]]))
    robot.advance(3000)
    gain = robot.truth().angle / robot.truth().command
    np.testing.assert_allclose(gain, [[1.03, 1.0]], rtol=4e-3)


def test_recoil_kicks_by_its_impulse(physics: str) -> None:
    calm = changed(**QUIET, gimbal__pitch__friction_n_m=0.0, gimbal__pitch__recoil_n_m_s=7e-3)
    robots = [resting_robot(calm, 1, physics) for _ in range(2)]
    for robot in robots:
        robot.advance(50)
    robots[0].shoot(np.zeros((1, 3)))
    for robot in robots:
        robot.advance(1)
    kick = robots[0].truth().rate[0, 0] - robots[1].truth().rate[0, 0]
    inertia = 0.001 + 0.0078 + 0.786 * (0.025**2 + 0.01**2)
    assert kick == pytest.approx(7e-3 / inertia, rel=0.02)

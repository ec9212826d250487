"""Firmware, motors, mechanics, pellets and the heat of the barrel, against SciPy, closed forms and hand calculation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from archerfish.virtual_robot.firmware import encoder_angle, filtered_rate, firmware_torque, make_drive, motor_torque
from archerfish.virtual_robot.mujoco_gimbal import MujocoGimbal
from archerfish.virtual_robot.muzzle import LastShot, after_shot, allowed, deficit_at, heat_at, launch
from archerfish.virtual_robot.pellets import fly

GRAVITY, TICK_S, ZERO = 9.81, 1e-3, np.zeros((1, 2))
FAR = {f"gimbal.{axis}.{side}_deg": at for axis in ("pitch", "yaw") for side, at in (("low", -200), ("high", 200))}
SMOOTH = FAR | {f"gimbal.{axis}.friction_n_m": 0 for axis in ("pitch", "yaw")}
UNDAMPED = {f"gimbal.{axis}.damping_n_m_s_per_rad": 0 for axis in ("pitch", "yaw")}


@pytest.fixture
def gimbal(changed_robot):
    return lambda values=None: changed_robot(values).description.gimbal


@pytest.fixture
def drive(changed_robot):
    return lambda values=None, batch=1: make_drive(changed_robot(values, noisy=True).description, batch)


def driven(gimbal, starts, torques, rates=None):
    """Return angles and rates of gimbals after each tick, shape (n, B, 2)."""
    physics, angles, speeds = MujocoGimbal(gimbal, len(starts)), [], []
    physics.reset(starts, rates)
    for torque in torques:
        physics.step(torque)
        angles.append(physics.angle)
        speeds.append(physics.rate)
    return np.array(angles), np.array(speeds)


def yaw_inertia(gimbal, pitch):
    """Return the inertia about the vertical, by the parallel-axis theorem [kg m²], and its slope."""
    body, (sin, cos) = gimbal.pitch_body, (np.sin(pitch), np.cos(pitch))
    reach, slope = body.forward_m * cos - body.up_m * sin, -body.forward_m * sin - body.up_m * cos
    turned = body.roll_inertia_kg_m2 * sin**2 + body.yaw_inertia_kg_m2 * cos**2
    fixed = gimbal.yaw_body.inertia_kg_m2 + gimbal.yaw.armature_kg_m2
    turned_slope = 2.0 * (body.roll_inertia_kg_m2 - body.yaw_inertia_kg_m2) * sin * cos
    return fixed + turned + body.mass_kg * reach**2, turned_slope + 2.0 * body.mass_kg * reach * slope


@pytest.mark.parametrize("values", [SMOOTH, SMOOTH | UNDAMPED], ids=["damped", "undamped"])
def test_a_gimbal_moves_by_the_equations_of_two_rigid_bodies(gimbal, values):
    made = gimbal(values)
    body, torque, times = made.pitch_body, np.array([0.03, 0.02]), TICK_S * np.arange(1, 1001)
    pitch_inertia = made.pitch.armature_kg_m2 + body.pitch_inertia_kg_m2
    pitch_inertia += body.mass_kg * (body.forward_m**2 + body.up_m**2)

    def slope(_, state):
        pitch, _, pitch_rate, yaw_rate = state
        inertia, inertia_slope = yaw_inertia(made, pitch)
        weight = body.mass_kg * GRAVITY * (body.forward_m * np.cos(pitch) - body.up_m * np.sin(pitch))
        pitching = torque[0] - made.pitch.damping_n_m_s_per_rad * pitch_rate - weight + inertia_slope * yaw_rate**2 / 2
        turning = torque[1] - made.yaw.damping_n_m_s_per_rad * yaw_rate - inertia_slope * pitch_rate * yaw_rate
        return pitch_rate, yaw_rate, pitching / pitch_inertia, turning / inertia

    exact = solve_ivp(slope, (0.0, times[-1]), [-0.5, 0.0, 1.0, 1.6], t_eval=times, rtol=1e-9, atol=1e-10).y
    found = driven(made, np.array([[-0.5, 0.0]]), [torque[None]] * len(times), np.array([[1.0, 1.6]]))
    assert np.ptp(exact[0]) > 0.5
    assert_allclose(np.concatenate(found, axis=-1)[:, 0], exact.T, atol=0.03)  # a first-order integrator


def test_friction_alone_stops_a_turn_after_the_time_that_it_takes(gimbal):
    made = gimbal(FAR | UNDAMPED | {"gimbal.pitch_body.forward_m": 0})
    rates = driven(made, ZERO, [ZERO] * 1000, np.array([[0.0, 1.0]]))[1][:, 0, 1]
    expected = yaw_inertia(made, 0.0)[0] / made.yaw.friction_n_m
    assert np.argmax(rates < 0.02) * TICK_S == pytest.approx(expected, rel=0.05)
    assert np.all(np.abs(rates[-100:]) < 1e-4)


def test_the_weight_is_held_and_a_load_below_the_friction_creeps_as_documented(gimbal):
    made, pitch = gimbal(), np.array([0.0, -0.4, 0.1])
    body, physics = made.pitch_body, MujocoGimbal(made, 3)
    physics.reset(np.stack([pitch, [0.3, 0.7, 0.0]], axis=1))
    held, lever = physics.holding_torque(), body.forward_m * np.cos(pitch) - body.up_m * np.sin(pitch)
    assert_allclose(held, np.stack([GRAVITY * body.mass_kg * lever, 0.0 * lever], axis=1), rtol=1e-9, atol=1e-12)
    load = held + [[0.0, share * made.yaw.friction_n_m] for share in (0.25, 0.5, 0.9)]
    for _ in range(500):
        physics.step(load)
    assert_allclose(physics.rate[:, 1], 0.0584 * load[:, 1], rtol=0.05)  # a real joint would stand


def test_stops_hold_against_the_full_torque(gimbal):
    made, pushed = gimbal(), np.array([[1.2, 1.2], [-1.2, -1.2]])
    stops = np.radians([[made.pitch.high_deg, made.yaw.high_deg], [made.pitch.low_deg, made.yaw.low_deg]])
    beyond = np.sign(pushed) * (driven(made, np.zeros((2, 2)), [pushed] * 3000)[0] - stops)
    assert np.degrees(beyond.max()) < 0.5
    assert np.degrees(np.abs(beyond[-200:]).max()) < 0.05


def test_a_gimbal_moves_the_same_to_the_last_bit_however_many_are_in_its_model(gimbal):
    made, draws = gimbal({"gimbal.pitch_body.left_m": 0.01}), np.random.default_rng(0)  # a load that couples the axes
    starts, torques = draws.normal(0.0, 0.1, (150, 2)), 0.6 * draws.standard_normal((1, 150, 2)).repeat(300, 0)
    together = driven(made, starts, torques)[0]
    for size in (1, 2, 5, 40, 64, 65):
        assert_array_equal(together[:, :size], driven(made, starts[:size], torques[:, :size])[0])


def test_the_current_lags_and_the_back_emf_leaves_less_torque(drive):
    lagging, torque = drive({"gimbal.yaw.current_lag_ms": 5, "gimbal.pitch.current_lag_ms": 0}), ZERO
    for _ in range(5):
        torque = motor_torque(lagging, torque, np.full((1, 2), 0.5), ZERO)
    assert_allclose(torque, [[0.5, 0.5 * (1.0 - np.exp(-1.0))]])
    strong = drive({"gimbal.yaw.current_lag_ms": 0, "gimbal.yaw.torque_limit_n_m": 10})
    for rate in (0.0, 10.0, 20.0, 32.0, 40.0):  # beyond 32.4 rad/s the supply brakes
        for sign in (-1.0, 1.0):
            found = motor_torque(strong, ZERO, np.full((1, 2), sign * 9.0), np.array([[0.0, rate]]))[0, 1]
            assert found == pytest.approx(max(-9.0, 0.741 * (sign * 24.0 - 0.741 * rate) / 3.6))


def test_torque_and_integral_by_hand_within_their_limits_and_that_of_the_rate(drive):
    made, integral = drive(), np.array([[0.0, 0.1]])
    small = 28 * 0.01  # rate that the angle loop requests for 0.01 rad
    # At the torque's limit the integral changes only away from it; no more than 12 rad/s are requested.
    limited = [(1.0, 0.0, 1.2, 0.1), (-1.0, 0.0, -1.2, 0.1), (1.0, 11.8, 1.1 * 0.2 + 0.1, 0.1 + 7e-3 * 0.2)]
    for command, rate, torque, after in (*limited, (0.01, 0.0, 1.1 * small + 0.1, 0.1 + 7e-3 * small)):
        grown, found = firmware_torque(made, integral, np.array([[0.0, command]]), ZERO, np.array([[0.0, rate]]))
        assert_allclose([found[0, 1], grown[0, 1]], [torque, after], rtol=1e-12)
    for _ in range(9000):
        integral, _ = firmware_torque(made, integral, np.array([[0.01, -0.01]]), ZERO, ZERO)
    assert_allclose(integral, [[0.6, -0.6]])


def test_the_encoder_counts_and_the_gyros_noise_is_filtered(drive):
    """A filter of gain a leaves the share a/(2 − a) of white noise; false alarms below 1e-6 at the tolerances."""
    angle, read, gyro = np.random.default_rng(0).uniform(-1, 1, (1000, 2)), [], np.zeros((100, 2))
    error = encoder_angle(drive(), angle) - angle / [1.03, 1.0]
    assert np.abs(error).max() <= np.pi / 8192 + 1e-12
    assert error.std() == pytest.approx(2 * np.pi / 8192 / np.sqrt(12), rel=0.15)
    made, draws, gain = drive(batch=100), np.random.default_rng(1), 1 - np.exp(-2 * np.pi * 150 * 1e-3)
    for _ in range(400):
        gyro = filtered_rate(made, gyro, np.zeros((100, 2)), draws.standard_normal((100, 2)))
        read.append(gyro)
    settled = np.array(read[50:])
    assert settled.std() == pytest.approx(0.0055 * np.sqrt(gain / (2 - gain)), rel=0.02)
    assert np.mean(settled[1:] * settled[:-1]) / settled.var() == pytest.approx(1 - gain, abs=0.03)


def reached(distance, speed, turn=0.0):
    """Return the event of a plate at distance + speed · |time − turn|."""
    return lambda time, place: place[:, 0] - distance - speed * np.abs(time - turn)


@pytest.mark.parametrize("drag", [0.0, 0.019])
def test_flights_to_moving_plates_and_to_the_ground_agree_with_scipy(drag):
    draws, count = np.random.default_rng(0), 12
    position, direction = 0.1 * draws.standard_normal((count, 3)), [1, 0, 0] + 0.3 * draws.standard_normal((count, 3))
    velocity = draws.uniform(10, 28, (count, 1)) * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    distance, speed = draws.uniform(1, 8, count), draws.uniform(-2, 2, count)

    def slope(_, state):
        return [*state[3:], *(-drag * np.linalg.norm(state[3:]) * state[3:] - [0.0, 0.0, GRAVITY])]

    def check(event, exact_event):
        found = fly(position, velocity, drag, event)
        for member, start in enumerate(np.concatenate([position, velocity], axis=1)):
            met = lambda time, state, at=member: exact_event(time, state, at)  # noqa: E731
            met.terminal = True
            exact = solve_ivp(slope, (0, 3), start, events=met, rtol=1e-11, atol=1e-12)
            assert found.time[member] == pytest.approx(exact.t_events[0][0], abs=1e-8)
            assert_allclose(found.position[member], exact.y_events[0][0][:3], atol=1e-7)

    check(reached(distance, speed), lambda time, state, at: state[0] - distance[at] - speed[at] * time)
    check(lambda _, place: -0.45 - place[:, 2], lambda _, state, at: -0.45 - state[2])


def test_a_plate_that_turns_back_within_a_step_is_met_where_it_is_unless_the_pellet_never_gets_there():
    velocity = np.random.default_rng(1).normal([18.0, 0.0, 1.0], 2.0, (30, 3))
    velocity[3, 0] = -18.0
    distance = np.linspace(2.0, 7.0, 30)
    found = fly(np.zeros((30, 3)), velocity, 0.019, reached(distance, 4.0, 0.163))
    assert_allclose(found.position[:, 0], distance + 4.0 * np.abs(found.time - 0.163), atol=1e-9)
    assert np.flatnonzero(np.isnan(found.time)).tolist() == [3]


def test_speed_elevation_and_azimuth_of_a_launch_by_hand(changed_robot):
    values = {"muzzle.boresight_pitch_deg": 0, "muzzle.boresight_yaw_deg": 1, "muzzle.forward_m": 0.16}
    angle, rate, normals = np.zeros((4, 2)), np.zeros((4, 2)), np.zeros((4, 3))
    normals[1], angle[2], rate[3] = (1.0, -1.0, 2.0), np.radians([8.0, 30.0]), (3.0, 2.0)
    deficit = np.array([0.0, 0.5, 0.0, 0.0])
    position, velocity, speed = launch(changed_robot(values).description.muzzle, deficit, angle, rate, normals)
    assert_allclose(speed, [18.0, 18.0 + 2 * 0.2 - 0.5, 18.0, 18.0])
    azimuth = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))[:3]
    assert_allclose(azimuth, [1.0, 0.8, 30.0 + 1.0 / np.cos(np.radians(8.0))], atol=1e-3)  # wider on the ground
    assert_allclose(np.degrees(np.arcsin(velocity[:2, 2] / speed[:2])), [0.0, 0.2], atol=1e-12)
    assert_allclose(velocity[3] - velocity[0], [0.0, 0.32, 0.48], atol=1e-12)  # ω × r at 0.16 m
    assert_allclose(position[0], [0.16, 0.0, 0.0])


def test_droop_and_heat_by_hand(changed_robot):
    """A shot costs 0.03 m/s, regained with 150 ms, and heats by 10 up to 260, of which 30 are lost in a second."""
    robot, yes = changed_robot(noisy=True).description, np.ones(1, bool)
    muzzle, referee, last = robot.muzzle, robot.referee, LastShot(np.full(1, -np.inf), np.zeros(1), np.zeros(1))
    assert (deficit_at(muzzle, last, 0.0), heat_at(referee, last, 0.0), allowed(referee, last, 0.0)) == (0.0, 0.0, True)
    for time in (1.0, 1.15):
        last = after_shot(muzzle, referee, last, time, yes)
    assert deficit_at(muzzle, last, 1.15) == pytest.approx(0.03 + 0.03 / np.e)
    assert heat_at(referee, last, 1.15) == pytest.approx(10 + 10 - 0.15 * 30)
    assert after_shot(muzzle, referee, last, 2.0, ~yes) == last
    hot = last._replace(heat=np.array([256.0]))
    ready = [(last, 1.24), (last, 1.25), (hot, 1.25), (hot, 1.45)]
    assert [bool(allowed(referee, state, time)[0]) for state, time in ready] == [False, True, False, True]

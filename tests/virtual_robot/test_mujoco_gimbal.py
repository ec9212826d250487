import numpy as np
import pytest

pytest.importorskip("mujoco.batch")

import mujoco

from archerfish.virtual_robot.description import TICK_S, Gimbal
from archerfish.virtual_robot.linear_gimbal import axis_inertias
from archerfish.virtual_robot.mujoco_gimbal import GRAVITY, MujocoGimbal, gimbal_model

from .made_robots import changed

FREE = {
    f"gimbal__{axis}__{key}": value
    for axis in ("pitch", "yaw")
    for key, value in (("damping_n_m_s_per_rad", 0.0), ("friction_n_m", 0.0), ("low_deg", -200.0), ("high_deg", 200.0))
}


def swinging(gimbal: Gimbal, count: int, pitch: float, rates: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Let a gimbal move on without torque; return its angles and rates, shape (count, 2) each."""
    physics = MujocoGimbal(gimbal, 1)
    physics.reset(np.array([[pitch, 0.0]]), np.array([rates]))
    angles, speeds = [], []
    for _ in range(count):
        physics.step(np.zeros((1, 2)))
        angles.append(physics.angle[0].copy())
        speeds.append(physics.rate[0].copy())
    return np.array(angles), np.array(speeds)


def yaw_inertia(gimbal: Gimbal, pitch: np.ndarray) -> np.ndarray:
    """About the vertical, from the parallel-axis theorem [kg m²]."""
    body = gimbal.pitch_body
    reach = body.forward_m * np.cos(pitch) - body.up_m * np.sin(pitch)
    turned = body.roll_inertia_kg_m2 * np.sin(pitch) ** 2 + body.yaw_inertia_kg_m2 * np.cos(pitch) ** 2
    fixed = gimbal.yaw_body.inertia_kg_m2 + gimbal.yaw.armature_kg_m2
    return fixed + turned + body.mass_kg * (reach**2 + body.left_m**2)


def energy(gimbal: Gimbal, angle: np.ndarray, rate: np.ndarray) -> np.ndarray:
    body, pitch = gimbal.pitch_body, angle[:, 0]
    height = body.forward_m * np.sin(pitch) + body.up_m * np.cos(pitch)
    kinetic = 0.5 * axis_inertias(gimbal)[0] * rate[:, 0] ** 2 + 0.5 * yaw_inertia(gimbal, pitch) * rate[:, 1] ** 2
    return kinetic + body.mass_kg * GRAVITY * height


def test_without_losses_energy_and_angular_momentum_about_the_vertical_stay() -> None:
    gimbal = changed(**FREE).gimbal
    angle, rate = swinging(gimbal, 2000, -0.5, (1.0, 1.6))
    assert np.ptp(angle[:, 0]) > 0.5
    total = energy(gimbal, angle, rate)
    # The integrator's energy wavers with the step; it must neither drift nor waver by more than a percent of the swing.
    swing = np.ptp(gimbal.pitch_body.mass_kg * GRAVITY * 0.025 * np.sin(angle[:, 0]))
    assert np.ptp(total) < 0.02 * swing
    assert abs(total[-500:].mean() - total[:500].mean()) < 0.005 * swing
    momentum = yaw_inertia(gimbal, angle[:, 0]) * rate[:, 1]
    np.testing.assert_allclose(momentum, momentum[0], rtol=6e-3)


def test_damping_takes_energy_at_every_step() -> None:
    gimbal = changed(**{**FREE, "gimbal__pitch__damping_n_m_s_per_rad": 0.02}).gimbal
    angle, rate = swinging(gimbal, 1500, -0.5, (0.0, 0.0))
    total = energy(gimbal, angle, rate)
    assert total[-1] < 0.7 * total[0] + 0.3 * (-gimbal.pitch_body.mass_kg * GRAVITY * np.hypot(0.025, 0.01))
    assert np.all(np.diff(total[::20]) <= 1e-9)


def test_a_damped_yaw_slows_down_exponentially() -> None:
    gimbal = changed(
        **{**FREE, "gimbal__yaw__damping_n_m_s_per_rad": 0.03, "gimbal__pitch_body__forward_m": 0.0}
    ).gimbal
    _, rate = swinging(gimbal, 500, 0.0, (0.0, 3.0))
    inertia = axis_inertias(gimbal)[1]
    expected = 3.0 * np.exp(-0.03 / inertia * TICK_S * np.arange(1, 501))
    np.testing.assert_allclose(rate[:, 1], expected, rtol=5e-3)


def test_friction_alone_stops_a_turn_after_the_time_that_it_takes() -> None:
    gimbal = changed(**{**FREE, "gimbal__yaw__friction_n_m": 0.06, "gimbal__pitch_body__forward_m": 0.0}).gimbal
    _, rate = swinging(gimbal, 1000, 0.0, (0.0, 1.0))
    expected = 1.0 * axis_inertias(gimbal)[1] / 0.06
    assert np.argmax(rate[:, 1] < 0.02) * TICK_S == pytest.approx(expected, rel=0.05)
    assert np.all(np.abs(rate[-100:, 1]) < 1e-4)


def test_a_load_below_the_friction_creeps_as_documented() -> None:
    """MuJoCo's friction is a soft constraint: 58 mrad/s per N·m of load here, where a real joint stands."""
    gimbal = changed().gimbal
    physics = MujocoGimbal(gimbal, 1)
    for share in (0.25, 0.5, 0.9):
        physics.reset(np.zeros((1, 2)))
        load = np.array([[physics.holding_torque()[0, 0], share * gimbal.yaw.friction_n_m]])
        for _ in range(500):
            physics.step(load)
        assert physics.rate[0, 1] == pytest.approx(0.0584 * load[0, 1], rel=0.05)


def test_the_holding_torque_is_the_weight_times_the_lever() -> None:
    gimbal = changed().gimbal
    body = gimbal.pitch_body
    physics = MujocoGimbal(gimbal, 2)
    pitch = np.array([0.0, -0.4])
    physics.reset(np.stack([pitch, [0.3, 0.7]], axis=1))
    lever = body.forward_m * np.cos(pitch) - body.up_m * np.sin(pitch)
    np.testing.assert_allclose(physics.holding_torque()[:, 0], GRAVITY * body.mass_kg * lever, rtol=1e-9)
    np.testing.assert_allclose(physics.holding_torque()[:, 1], 0.0, atol=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_stops_hold_against_the_full_torque(sign: float) -> None:
    gimbal = changed().gimbal
    physics = MujocoGimbal(gimbal, 1)
    physics.reset(np.zeros((1, 2)))
    beyond = []
    for _ in range(3000):
        physics.step(sign * np.array([[1.2, 1.2]]))
        angle = np.degrees(physics.angle[0])
        low, high = ([getattr(each, key) for each in (gimbal.pitch, gimbal.yaw)] for key in ("low_deg", "high_deg"))
        beyond.append(np.maximum(np.array(low) - angle, angle - np.array(high)))
    # At the impact the stop gives way by a quarter of a degree, then it holds.
    assert np.max(beyond) < 0.5
    assert np.max(beyond[-200:]) < 0.05


@pytest.mark.parametrize("axis", [0, 1])
def test_an_axis_without_gravity_follows_newton(axis: int) -> None:
    gimbal = changed(**FREE, gimbal__pitch_body__forward_m=0.0, gimbal__pitch_body__up_m=0.0).gimbal
    physics = MujocoGimbal(gimbal, 1)
    physics.reset(np.zeros((1, 2)))
    torque = np.zeros((1, 2))
    torque[0, axis] = 0.1
    for _ in range(100):
        physics.step(torque)
    np.testing.assert_allclose(physics.rate[0], 0.1 * torque[0] / axis_inertias(gimbal), rtol=1e-9, atol=1e-12)


def driven(gimbal: Gimbal, starts: np.ndarray, torques: np.ndarray) -> np.ndarray:
    """Drive gimbals from rest; return their angles after each tick, shape (count, B, 2)."""
    physics = MujocoGimbal(gimbal, len(starts))
    physics.reset(starts)
    angles = []
    for torque in torques:
        physics.step(torque)
        angles.append(physics.angle)
    return np.array(angles)


def test_a_gimbal_moves_the_same_to_the_last_bit_however_many_are_in_its_model() -> None:
    """With a load beside the axes, which couples them, and torques that reach the stops."""
    gimbal = changed(gimbal__pitch_body__left_m=0.01).gimbal
    generator = np.random.default_rng(0)
    starts, torques = generator.normal(0.0, 0.1, (150, 2)), 0.6 * generator.standard_normal((1, 150, 2)).repeat(300, 0)
    together = driven(gimbal, starts, torques)
    for size in (1, 2, 5, 40, 64, 65):
        np.testing.assert_array_equal(together[:, :size], driven(gimbal, starts[:size], torques[:, :size]))


def test_many_gimbals_in_a_model_move_as_one_alone_under_newtons_solver() -> None:
    gimbal = changed(gimbal__pitch_body__left_m=0.01).gimbal
    generator = np.random.default_rng(1)
    starts, torques = generator.normal(0.0, 0.1, (70, 2)), 0.6 * generator.standard_normal((1, 70, 2)).repeat(300, 0)
    model = mujoco.MjModel.from_xml_string(gimbal_model(gimbal))
    model.opt.solver, model.opt.jacobian = mujoco.mjtSolver.mjSOL_NEWTON, mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.tolerance = 0.0
    alone = np.empty_like(torques)
    for member, start in enumerate(starts):
        data = mujoco.MjData(model)
        data.qpos[:] = start[::-1]
        for tick, torque in enumerate(torques[:, member]):
            data.qfrc_applied[:] = torque[::-1]
            mujoco.mj_step(model, data)
            alone[tick, member] = data.qpos[::-1]
    np.testing.assert_allclose(driven(gimbal, starts, torques), alone, rtol=0.0, atol=1e-10)

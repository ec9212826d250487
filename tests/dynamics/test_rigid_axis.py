import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from archerfish.dynamics.pellet import GRAVITY
from archerfish.dynamics.rigid_axis import (
    RigidAxis,
    RigidState,
    dry_friction,
    pitch_axis,
    rigid_derivative,
    rigid_energy,
    rigid_step,
    yaw_axis,
)

MASS, LENGTH, DAMPING = 0.8, 0.1, 0.02


def swing(axis: RigidAxis, state: RigidState, torque: float, seconds: float, period: float = 1e-3) -> list[RigidState]:
    states = [state]
    for _ in range(round(seconds / period)):
        states.append(rigid_step(axis, states[-1], torque, period))
    return states


def test_acceleration_matches_a_hand_calculation() -> None:
    axis = pitch_axis(mass=2.0, length=0.5, damping=0.1)  # m l² = 0.5
    slope = rigid_derivative(axis, RigidState(math.pi / 6, 3.0), torque=1.0)
    assert slope.rate == pytest.approx((1.0 - 0.3) / 0.5 - 9.81 / 0.5 * 0.5)
    assert slope.angle == 3.0


def test_pitch_solves_the_angular_momentum_equation() -> None:
    # Eq (1) as printed: m l² θ̈ + b θ̇ + m g l sin θ = T.
    angle, rate, torque = 0.7, -2.0, 0.4
    slope = rigid_derivative(pitch_axis(MASS, LENGTH, DAMPING), RigidState(angle, rate), torque)
    left = MASS * LENGTH**2 * slope.rate + DAMPING * rate + MASS * GRAVITY * LENGTH * math.sin(angle)
    assert left == pytest.approx(torque)


def test_damping_only_takes_energy() -> None:
    axis = pitch_axis(MASS, LENGTH, DAMPING)
    energy = [rigid_energy(axis, state) for state in swing(axis, RigidState(2.0, 0.0), 0.0, 1.0)]
    assert np.all(np.diff(energy) < 1e-12)
    assert energy[-1] < 0.5 * energy[0]


def test_energy_falls_by_the_work_of_damping() -> None:
    axis, period = pitch_axis(MASS, LENGTH, DAMPING), 1e-3
    states = swing(axis, RigidState(2.0, 0.0), 0.0, 0.5, period)
    lost = rigid_energy(axis, states[0]) - rigid_energy(axis, states[-1])
    assert lost == pytest.approx(np.trapezoid([DAMPING * state.rate**2 for state in states], dx=period), rel=1e-4)


def test_energy_is_kept_without_damping() -> None:
    axis = pitch_axis(MASS, LENGTH, 0.0)
    states = swing(axis, RigidState(2.0, 0.0), 0.0, 2.0)
    assert rigid_energy(axis, states[-1]) == pytest.approx(rigid_energy(axis, states[0]), rel=1e-9)


def test_small_swings_have_the_period_of_a_pendulum() -> None:
    period = 1e-3
    angles = np.array([s.angle for s in swing(pitch_axis(MASS, LENGTH, 0.0), RigidState(1e-3, 0.0), 0.0, 3.0, period)])
    (falls,) = np.nonzero((angles[:-1] > 0) & (angles[1:] <= 0))
    crossings = (falls + angles[falls] / (angles[falls] - angles[falls + 1])) * period
    assert np.diff(crossings) == pytest.approx(2 * math.pi * math.sqrt(LENGTH / GRAVITY), rel=1e-5)


def test_pitch_rests_where_torque_holds_the_weight() -> None:
    angle = 0.3
    slope = rigid_derivative(
        pitch_axis(MASS, LENGTH, DAMPING), RigidState(angle, 0.0), MASS * GRAVITY * LENGTH * math.sin(angle)
    )
    assert slope.rate == pytest.approx(0.0, abs=1e-12)


def test_yaw_settles_at_torque_over_damping() -> None:
    torque = 0.05
    states = swing(yaw_axis(MASS, LENGTH, DAMPING), RigidState(0.0, 0.0), torque, 12.0, period=1e-2)
    assert states[-1].rate == pytest.approx(torque / DAMPING, rel=1e-9)


def test_yaw_follows_its_closed_form() -> None:
    torque, seconds, start = 0.05, 0.3, 1.5
    axis = yaw_axis(MASS, LENGTH, DAMPING)
    decay = math.exp(-DAMPING / (MASS * LENGTH**2) * seconds)
    final = swing(axis, RigidState(0.0, start), torque, seconds)[-1]
    assert final.rate == pytest.approx(torque / DAMPING + (start - torque / DAMPING) * decay, rel=1e-10)


@pytest.mark.parametrize("build", [pitch_axis, yaw_axis])
def test_steps_agree_with_scipy(build) -> None:
    axis, torque = build(MASS, LENGTH, DAMPING), 0.1
    reference = solve_ivp(
        lambda _, x: rigid_derivative(axis, RigidState(*x), torque), (0.0, 1.0), [1.0, -3.0], rtol=1e-11, atol=1e-12
    )
    final = swing(axis, RigidState(1.0, -3.0), torque, 1.0)[-1]
    assert_allclose(final, reference.y[:, -1], atol=1e-8)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree_in_float32(shape: tuple[int, ...]) -> None:
    jax = pytest.importorskip("jax")
    rng = np.random.default_rng(1)
    mass, length, damping = (rng.uniform(0.1, 1.0, shape).astype(np.float32) for _ in range(3))
    state = RigidState(*rng.uniform(-1.0, 1.0, (2, *shape)).astype(np.float32))
    torque = rng.uniform(-1.0, 1.0, shape).astype(np.float32)
    axis = pitch_axis(mass, length, damping)
    expected = rigid_step(axis, state, torque, np.float32(1e-3))
    found = jax.jit(rigid_step)(axis, state, torque, np.float32(1e-3))
    for ours, theirs in zip(found, expected, strict=True):
        assert ours.shape == theirs.shape == shape
        assert ours.dtype == theirs.dtype == np.float32
        assert_allclose(ours, theirs, rtol=2e-6, atol=2e-6)


def test_one_axis_serves_a_batch_of_states() -> None:
    axis = pitch_axis(MASS, LENGTH, DAMPING)
    angles = np.linspace(-1.0, 1.0, 6).reshape(2, 3)
    batch = rigid_step(axis, RigidState(angles, np.zeros((2, 3))), 0.0, 1e-3)
    single = rigid_step(axis, RigidState(angles[1, 2], 0.0), 0.0, 1e-3)
    assert batch.angle.shape == (2, 3)
    assert batch.rate[1, 2] == single.rate


def slid(axis, state, torque, friction, count, period=2e-3):
    states = [state]
    for _ in range(count):
        held = dry_friction(axis, states[-1], torque, friction, period)
        states.append(rigid_step(axis, states[-1], torque + held, period))
    return states


def test_dry_friction_alone_stops_a_wheel_evenly_and_holds_it() -> None:
    """Rate falls by F/I: from 3 rad/s at 0.2 N m on 0.1 kg m² it is gone after 1.5 s and 2.25 rad."""
    wheel = yaw_axis(mass=0.1, length=1.0, damping=0.0)
    states = slid(wheel, RigidState(0.0, 3.0), 0.0, 0.2, 1000)
    assert states[500].rate == pytest.approx(1.0)
    assert states[-1].rate == pytest.approx(0.0, abs=1e-12)
    assert states[-1].angle == pytest.approx(2.25, rel=1e-3)


def test_an_axis_at_rest_moves_only_under_more_than_its_friction() -> None:
    wheel, rest = yaw_axis(mass=0.1, length=1.0, damping=0.0), RigidState(0.0, 0.0)
    for torque in (-0.19, 0.19):
        assert slid(wheel, rest, torque, 0.2, 100)[-1] == pytest.approx((0.0, 0.0), abs=1e-12)
    assert slid(wheel, rest, 0.3, 0.2, 500)[-1].rate == pytest.approx(1.0, rel=1e-6)


def test_an_arm_stays_where_friction_holds_its_weight() -> None:
    arm = pitch_axis(MASS, LENGTH, DAMPING)
    held = slid(arm, RigidState(0.2, 0.0), 0.0, MASS * GRAVITY * LENGTH * math.sin(0.3), 200)
    assert held[-1].angle == pytest.approx(0.2, abs=1e-9)


def test_dry_friction_agrees_in_jax(agree_in_jax) -> None:
    rng = np.random.default_rng(0)
    for shape in ((), (3,), (2, 3)):
        axis = pitch_axis(*(np.asarray(0.1 + rng.random(shape)) for _ in range(3)))
        state = RigidState(*(np.asarray(rng.standard_normal(shape)) for _ in range(2)))
        torque, friction = np.asarray(rng.standard_normal(shape)), np.asarray(rng.random(shape))
        agree_in_jax(lambda *a: dry_friction(*a, 0.5), axis, state, torque, friction)

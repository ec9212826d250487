import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import dlsim

from archerfish2.dynamics import delayed_axis as delayed
from archerfish2.dynamics import linear_axis as linear
from archerfish2.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step
from archerfish2.errors import InputError
from archerfish2.records.plant import PlantRecord

PERIOD, ONE = 0.02, np.asarray(0)
SECOND = PlantRecord.second_order(5.0, 0.6)
PITCH = PlantRecord.second_order(12.0, 0.6, delay_s=3e-3).replace(D=np.array([[0.2]]))
# Of a higher order than pitch: behind a lag of first order.
LAG = np.block([[SECOND.A, SECOND.B], [np.zeros((1, 2)), 0.9 * np.eye(1)]]), np.array([[0.0], [0.0], [0.1]])
YAW = PlantRecord.from_state_space(*LAG, np.eye(1, 3), 0.0, 1e-3, delay_samples=27)


def with_draws(plant, gains, delays):
    draws = {name: np.stack([getattr(plant, name)] * len(gains)) for name in "ABCD"}
    draws["B"] = draws["B"] * np.array(gains)[:, None, None]
    return plant.replace(draws=draws, draw_delays=np.array(delays))


def by_the_tick(plant, start, sent, ticks):
    """Return states and inputs at each tick, of commands (tick sent, latency, command), as SciPy simulates them."""
    inputs, latest = np.full(ticks + 1, start), 0
    for tick, latency, command in sent:
        latest = max(latest, tick + latency + plant.delay_samples)
        inputs[latest:] = command
    rest = np.linalg.solve(np.eye(len(plant.A)) - plant.A, plant.B[:, 0]) * start
    return dlsim((plant.A, plant.B, plant.C, plant.D, 1), inputs, x0=rest)[2] @ plant.C[0], inputs


@pytest.mark.parametrize(("longest", "whole"), [(0, 1), (0, 20), (35, 20), (110, 20)])
def test_commands_of_random_latency_act_as_they_do_tick_by_tick(longest, whole):
    rng, start, period = np.random.default_rng(11), np.array([0.1, -0.2]), 1e-3 * whole
    model, gimbal = linear.gimbal_model(PITCH, YAW, period), delayed.delayed_gimbal(PITCH, YAW, period)
    coarse, places = linear.rest_state(model, start), delayed.longest_wait(gimbal, longest)
    state = delayed.rest_under(gimbal, ONE, start, places)
    sent, found, ends = [], [(0, *delayed.angle_and_rate(gimbal, ONE, state))], []
    for _ in range(60):
        command, latency, part = rng.uniform(-0.5, 0.5, 2), rng.integers(0, longest + 1), rng.integers(0, whole + 1)
        sent.append((found[-1][0], latency, command))
        state = delayed.send(gimbal, ONE, state, command, latency / 1e3)
        for ticks in (part, whole - part):
            state = delayed.run(gimbal, ONE, state, np.asarray(float(ticks)))
            found.append((found[-1][0] + ticks, *delayed.angle_and_rate(gimbal, ONE, state)))
        coarse = linear.advance(model, coarse, command)
        ends.append((linear.gimbal_angle(model, coarse), linear.gimbal_rate(model, coarse)))
    ticks, angles, rates = (np.array(each) for each in zip(*found[1:], strict=True))
    for axis, plant in enumerate((PITCH, YAW)):
        alone = [(tick, latency, command[axis]) for tick, latency, command in sent]
        states, inputs = by_the_tick(plant, start[axis], alone, ticks[-1] + 1)
        through = plant.D.item() * inputs
        assert_allclose(angles[:, axis], (states + through)[ticks], atol=1e-12)
        assert_allclose(rates[:, axis], np.diff(states)[ticks] / 1e-3, atol=1e-9)
        if longest == 0:  # at its end a command is still in force
            ended = states[1:] + through[:-1]
            assert_allclose(np.array(ends)[:, 0, axis], ended[ticks[1::2] - 1], atol=1e-12)
            assert_allclose(np.array(ends)[1:, 1, axis], np.diff(ended)[ticks[3::2] - 2] / 1e-3, atol=1e-9)


@pytest.mark.parametrize("yaw", [YAW, with_draws(YAW, [1.0, 0.5, 0.2, 9.0], [27, 1, 4, 9])])
def test_both_kinds_of_axes_have_the_same_draws_also_where_one_axis_has_none(yaw):
    pitch, draws, zero = with_draws(SECOND, [1.0, 1.5, 2.0], [0, 2, 25]), np.arange(3), np.zeros((3, 2))
    whole, parts = linear.gimbal_draws(pitch, yaw, PERIOD), delayed.delayed_gimbal(pitch, yaw, PERIOD)
    coarse = linear.rest_state(whole, zero)
    fine = delayed.rest_under(parts, draws, zero, delayed.longest_wait(parts, 0.0))
    for command in np.random.default_rng(12).uniform(-0.5, 0.5, (8, 3, 2)):
        coarse = linear.advance(whole, coarse, command)
        fine = delayed.run(parts, draws, delayed.send(parts, draws, fine, command, zero[:, 0]), np.full(3, 20.0))
    assert_allclose(delayed.angle_and_rate(parts, draws, fine)[0], linear.gimbal_angle(whole, coarse), atol=1e-11)
    assert np.ptp(linear.gimbal_angle(whole, coarse)[:, 1]) > 0.01


def test_a_refined_axis_is_the_plant_sampled_more_often_and_one_without_a_root_stays():
    sampled = [PlantRecord.second_order(8.0, 0.4, 0.02, each, gain=2.0) for each in (0.01, 0.001)]
    coarse, fine = (linear.axis_of(each) for each in sampled)
    for found, expected in zip(linear.refined(coarse, 1.1e-3), fine, strict=True):
        assert_allclose(found, expected, atol=1e-13)
    several, single = linear.axis_draws(with_draws(sampled[0], [1.0, 3.0], [2, 1]), sampled[0])
    assert_allclose(linear.refined(several, 1e-3).b, [fine.b, 3.0 * fine.b], atol=1e-13)
    assert single.a.shape == (2, 2, 2)
    odd = coarse._replace(a=np.diag([0.7, -0.2]))
    assert linear.refined(odd, 1e-3) is odd


def test_periods_that_do_not_fit_and_several_inputs_are_refused():
    with pytest.raises(InputError, match=r"same sampling period, got 0\.001 s for pitch and 0\.002 s for yaw"):
        delayed.delayed_gimbal(PITCH, YAW.replace(sample_period_s=0.002), PERIOD)
    with pytest.raises(InputError, match=r"multiple of the plant's sampling period 0\.001 s, got 0\.0205 s"):
        linear.gimbal_model(PITCH, YAW, 0.0205)
    with pytest.raises(InputError, match="must have one input, got 2"):
        linear.axis_of(PlantRecord.from_state_space(YAW.A, YAW.A[:, :2], YAW.C, np.zeros((1, 2)), 1e-3))


def test_a_rigid_axis_solves_eq_1():
    # m l² θ̈ + b θ̇ + m g l sin θ = T
    def slope(_, x):
        return [x[1], (0.1 - 0.02 * x[1] - 0.8 * 9.81 * 0.1 * np.sin(x[0])) / (0.8 * 0.1**2)]

    state = RigidState(np.asarray(1.0), np.asarray(-3.0))
    for _ in range(1000):
        state = rigid_step(RigidAxis(0.8, 0.1, 0.02, 9.81), state, 0.1, 1e-3)
    assert_allclose(state, solve_ivp(slope, (0.0, 1.0), [1.0, -3.0], rtol=1e-11, atol=1e-12).y[:, -1], atol=1e-8)


def test_dry_friction_stops_evenly_and_holds_what_is_weaker():
    # 0.2 N m on 0.1 kg m²: 3 rad/s are gone after 1.5 s and 2.25 rad; 0.3 N m accelerates from rest with 1 rad/s².
    wheel, torque = RigidAxis(0.1, 1.0, 0.0, 0.0), np.array([0.0, 0.19, 0.3])
    state = RigidState(np.zeros(3), np.array([3.0, 0.0, 0.0]))
    for _ in range(1000):
        state = rigid_step(wheel, state, torque + dry_friction(wheel, state, torque, 0.2, 2e-3), 2e-3)
    assert_allclose(state, [[2.25, 0.0, 2.0], [0.0, 0.0, 2.0]], atol=3e-3)

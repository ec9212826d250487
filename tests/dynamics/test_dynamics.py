"""Axes, pellets and command limits, against SciPy, hand calculation and limit cases."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.signal import dlsim

from archerfish.arrays import single_precision
from archerfish.dynamics import aiming, command_limits, delayed_axis, linear_axis, muzzle, pellet, rigid_axis
from archerfish.paper.gimbal import gate_limits
from archerfish.records.plant import PlantRecord

ONE, SECOND = np.asarray(0), PlantRecord.second_order(5.0, 0.6)
PITCH = PlantRecord.second_order(12.0, 0.6, delay_s=3e-3).replace(D=np.array([[0.2]]))
# Of a higher order than pitch: behind a lag of first order.
LAG = np.block([[SECOND.A, SECOND.B], [np.zeros((1, 2)), 0.9 * np.eye(1)]]), np.array([[0.0], [0.0], [0.1]])
YAW = PlantRecord.from_state_space(*LAG, np.eye(1, 3), 0.0, 1e-3, delay_samples=27)
DRAG, CROSSINGS = 0.019, (pellet.flat_fire_crossing, pellet.quadratic_crossing)
PERIOD = np.float32(0.02)
LOW, HIGH = (np.radians(each).astype(np.float32) for each in ([-25.0, -75.0], [10.0, 75.0]))
NAMED = (command_limits.named_limits(name, gate_limits(), np.radians(2.0)) for name in ("gate", "los-2deg"))
GATE, LEAD = map(single_precision, NAMED)


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
    model, gimbal = linear_axis.gimbal_model(PITCH, YAW, period), delayed_axis.delayed_gimbal(PITCH, YAW, period)
    state = delayed_axis.rest_under(gimbal, ONE, start, delayed_axis.longest_wait(gimbal, longest))
    coarse, now, sent, found, ends = linear_axis.rest_state(model, start), 0, [], [], []
    for _ in range(60):
        command, latency, part = rng.uniform(-0.5, 0.5, 2), rng.integers(0, longest + 1), rng.integers(0, whole + 1)
        sent.append((now, latency, command))
        state = delayed_axis.send(gimbal, ONE, state, command, latency / 1e3)
        for ticks in (part, whole - part):
            state, now = delayed_axis.run(gimbal, ONE, state, np.asarray(float(ticks))), now + ticks
            found.append((now, *delayed_axis.angle_and_rate(gimbal, ONE, state)))
        coarse = linear_axis.advance(model, coarse, command)
        ends.append((linear_axis.gimbal_angle(model, coarse), linear_axis.gimbal_rate(model, coarse)))
    ticks, angles, rates = (np.array(each) for each in zip(*found, strict=True))
    for axis, plant in enumerate((PITCH, YAW)):
        alone = [(tick, latency, command[axis]) for tick, latency, command in sent]
        states, inputs = by_the_tick(plant, start[axis], alone, now + 1)
        through = plant.D.item() * inputs
        assert_allclose(angles[:, axis], (states + through)[ticks], atol=1e-12)
        assert_allclose(rates[:, axis], np.diff(states)[ticks] / 1e-3, atol=1e-9)
        if longest == 0:  # at its end a command is still in force
            ended = states[1:] + through[:-1]
            assert_allclose(np.array(ends)[:, 0, axis], ended[ticks[1::2] - 1], atol=1e-12)
            assert_allclose(np.array(ends)[1:, 1, axis], np.diff(ended)[ticks[3::2] - 2] / 1e-3, atol=1e-9)


def test_a_refined_axis_is_the_plant_sampled_more_often_and_one_without_a_root_stays():
    sampled = lambda period_s, gain: PlantRecord.second_order(8.0, 0.4, 0.02, period_s, gain)  # noqa: E731
    one, draws = sampled(0.01, 2), {}
    for name in "ABCD":
        draws[name] = np.stack([getattr(sampled(0.01, gain), name) for gain in (2, 6)])
    for axis, gains in zip(linear_axis.axis_draws(one.replace(draws=draws), one), [(2, 6), (2, 2)], strict=True):
        fine = [linear_axis.axis_of(sampled(0.001, each)) for each in gains]
        for found, *expected in zip(linear_axis.refined(axis, 1.1e-3), *fine, strict=True):
            assert_allclose(found, expected, atol=1e-13)
    odd = linear_axis.axis_of(one)._replace(a=np.diag([0.7, -0.2]))
    assert linear_axis.refined(odd, 1e-3) is odd


def test_periods_that_do_not_fit_and_several_inputs_are_refused(refused):
    complaint, wide = r"same sampling period, got 0\.001 s for pitch and 0\.002 s for yaw", np.ones((1, 2))
    refused(complaint, delayed_axis.delayed_gimbal, PITCH, YAW.replace(sample_period_s=0.002), 0.02)
    refused(r"multiple of .* period 0\.001 s, got 0\.0205 s", linear_axis.gimbal_model, PITCH, YAW, 0.0205)
    refused("must have one input, got 2", linear_axis.axis_of, PlantRecord.from_state_space(1.0, wide, 1.0, wide, 1e-3))


def test_a_rigid_axis_solves_eq_1():
    # m l² θ̈ + b θ̇ + m g l sin θ = T
    def slope(_, x):
        return [x[1], (0.1 - 0.02 * x[1] - 0.8 * 9.81 * 0.1 * np.sin(x[0])) / (0.8 * 0.1**2)]

    state = rigid_axis.RigidState(np.asarray(1.0), np.asarray(-3.0))
    for _ in range(1000):
        state = rigid_axis.rigid_step(rigid_axis.RigidAxis(0.8, 0.1, 0.02, 9.81), state, 0.1, 1e-3)
    assert_allclose(state, solve_ivp(slope, (0.0, 1.0), [1.0, -3.0], rtol=1e-11, atol=1e-12).y[:, -1], atol=1e-8)


def test_dry_friction_stops_evenly_and_holds_what_is_weaker():
    # 0.2 N m on 0.1 kg m²: 3 rad/s are gone after 1.5 s and 2.25 rad; 0.3 N m accelerates from rest with 1 rad/s².
    wheel, torque = rigid_axis.RigidAxis(0.1, 1.0, 0.0, 0.0), np.array([0.0, 0.19, 0.3])
    state = rigid_axis.RigidState(np.zeros(3), np.array([3.0, 0.0, 0.0]))
    for _ in range(1000):
        friction = rigid_axis.dry_friction(wheel, state, torque, 0.2, 2e-3)
        state = rigid_axis.rigid_step(wheel, state, torque + friction, 2e-3)
    assert_allclose(state, [[2.25, 0.0, 2.0], [0.0, 0.0, 2.0]], atol=3e-3)


@pytest.mark.parametrize(("velocity", "flat_within"), [((18.0, 0.0, 1.0), 2e-4), ((14.0, -11.0, 0.5), 2e-3)])
def test_flights_solve_their_differential_equations(velocity, flat_within):
    ahead, velocity = lambda _, x: x[0] - 5.0, np.array(velocity)
    ahead.terminal = True
    ode = lambda _, x: [*x[3:], *(-DRAG * np.linalg.norm(x[3:]) * x[3:] - [0.0, 0.0, 9.81])]  # noqa: E731
    done = solve_ivp(ode, (0.0, 2.0), [0.0, 0.0, 0.0, *velocity], "DOP853", events=ahead, rtol=1e-12, atol=1e-13)
    flat, quadratic = (crossing(np.zeros(3), velocity, np.asarray(5.0), DRAG) for crossing in CROSSINGS)
    assert_allclose(quadratic, [*done.y_events[0][0, 1:3], done.t_events[0][0]], atol=1e-8)
    assert_allclose(flat, quadratic, atol=flat_within)  # leaves out what gravity does to the speed
    there = pellet.flat_fire_position(velocity, DRAG, flat.time)
    assert_allclose(there, [5.0, flat.lateral, flat.height], atol=1e-12)


@pytest.mark.parametrize("drag", [0.0, 1e-8, 1e-4, 1e-3])
def test_a_vanishing_drag_leaves_the_parabola_in_float32(drag):
    velocity, time = np.array([18.0, -2.0, 1.5], np.float32), 5.0 / 18.0
    for crossing in CROSSINGS:
        found = crossing(0.0 * velocity, velocity, np.float32(5.0), np.float32(drag))
        assert_allclose(found, [-2.0 * time, 1.5 * time - 9.81 / 2 * time**2, time], atol=1e-6 + 2 * drag)


def test_a_pellet_leaves_at_the_gimbals_angles_with_dispersion_and_the_velocity_of_the_muzzle():
    gun = muzzle.Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, -0.02), (0.004, 0.003), DRAG, 0.15)))
    angle, rate, drawn, step = np.array([0.15, -0.6]), np.array([3.0, 5.0]), np.array([2.0, -1.0, 0.5]), 1e-6
    before, after = (muzzle.pellet_at_muzzle(gun, angle + by * rate, rate, drawn)[0] for by in (-step, step))
    moving, resting = (muzzle.pellet_at_muzzle(gun, angle, each, drawn)[1] for each in (rate, 0.0 * rate))
    assert_allclose(moving - resting, (after - before) / (2 * step), atol=1e-8)
    assert_allclose(resting, 18.1 * muzzle.direction(np.array([0.15 + 0.01 + 0.008, -0.6 - 0.02 - 0.003])))


def test_the_mean_pellet_passes_through_the_target_that_it_is_aimed_at():
    place = np.random.default_rng(12).uniform([1.0, -1.2, -1.0], [8.0, 1.2, 1.0], (200, 3))
    gun = muzzle.Muzzle(*map(np.asarray, (18.0, 0.2, (0.01, -0.02), (0.004, 0.003), DRAG, 0.0)))
    for speed, bound in ((0.0, 1e-6), (2.0, 3e-3)):
        at = lambda time, speed=speed: place + speed * time[:, None] * [-0.3, 0.9, 0.3]  # noqa: E731
        angle, time = aiming.intercept(at, np.full(200, 0.05), gun)
        fired, then = muzzle.pellet_at_muzzle(gun, angle, 0.0 * angle, 0.0 * place), at(0.05 + time)
        found = np.array(pellet.flat_fire_crossing(*fired, then[:, 0], DRAG))
        assert np.max(np.abs(found[:2].T - then[:, 1:])) < bound


def commands(limits, desired):
    """Return the commands that come of desired ones, from rest at zero, two zeros first."""
    found = [np.zeros(desired.shape[1:], np.float32)] * 2
    for each in desired.astype(np.float32):
        rate = (found[-1] - found[-2]) / PERIOD
        found.append(command_limits.limit_command(limits, each, found[-1], rate, 0.0 * each, PERIOD))
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


def test_the_slew_to_an_aim_keeps_its_rate_and_stops_there():
    aim, path = np.array([0.1, 1.3]), [np.zeros(2)]
    for _ in range(60):
        path.append(command_limits.approach(aim, path[-1], GATE.max_rate, GATE.max_acceleration, PERIOD))
    rate = np.diff(path, axis=0) / PERIOD
    assert_array_equal(path[-1], aim)
    assert rate[:, 1].max() == pytest.approx(12.0)
    assert np.all(np.diff(rate, axis=0)[1:] / PERIOD >= -GATE.max_acceleration * 1.001)


@pytest.mark.parametrize(("target", "expected"), [(17.0, 19.0), (80.0, 75.0)])
def test_a_limited_lead_holds_yaw_near_the_line_of_sight_and_in_its_range(target, expected):
    zero, degrees = np.zeros(2), np.radians([[-10.0, 80.0], [3.0, target], [-10.0, expected]])
    assert_allclose(command_limits.limit_command(LEAD, degrees[0], zero, zero, degrees[1], 0.02), degrees[2], rtol=1e-6)


def test_numpy_and_jax_compute_alike_what_the_worlds_do_not_use(batch, agree):
    def everything(place, velocity, plane, arm, torque):
        held, crossing = (arm, rigid_axis.RigidState(*arm[:2]), torque), (place, velocity, plane, arm.mass)
        friction, after = rigid_axis.dry_friction(*held, 0.5 * torque, 0.01), rigid_axis.rigid_step(*held, 0.01)
        return pellet.quadratic_crossing(*crossing, steps=2), friction, after

    rng = np.random.default_rng(3)
    position, velocity = rng.normal(0.0, 0.1, (*batch, 3)), rng.normal([18.0, 0.0, 1.0], 2.0, (*batch, 3))
    plane, torque, *arm = rng.uniform(0.1, 0.9, (6, *batch))
    agree(everything, position, velocity, 4.0 * plane, rigid_axis.RigidAxis(*arm), torque, rtol=1e-4)

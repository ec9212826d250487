import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from archerfish2.dynamics import pellet
from archerfish2.dynamics.aiming import intercept
from archerfish2.dynamics.muzzle import Muzzle, direction, pellet_at_muzzle
from archerfish2.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step

DRAG, CROSSINGS = 0.019, (pellet.flat_fire_crossing, pellet.printed_crossing, pellet.quadratic_crossing)


def gun(speed=18.0, length=0.15):
    return Muzzle(*(np.asarray(each) for each in (speed, 0.2, (0.01, -0.02), (0.004, 0.003), DRAG, length)))


@pytest.mark.parametrize(("velocity", "flat_within"), [((18.0, 0.0, 1.0), 2e-4), ((14.0, -11.0, 0.5), 2e-3)])
def test_flights_solve_their_differential_equations(velocity, flat_within):
    def ahead(_, x):
        return x[0] - 5.0

    ahead.terminal, exact = True, []
    for size in (np.linalg.norm, lambda v: np.abs(v) * [1.0, 1.0, 0.0]):  # of |v|; eq (5) takes each coordinate alone
        ode = lambda _, x, size=size: [*x[3:], *(-DRAG * size(x[3:]) * x[3:] - [0.0, 0.0, 9.81])]  # noqa: E731
        done = solve_ivp(ode, (0.0, 2.0), [0.0, 0.0, 0.0, *velocity], "DOP853", events=ahead, rtol=1e-12, atol=1e-13)
        exact.append([*done.y_events[0][0, 1:3], done.t_events[0][0]])
    flat, printed, quadratic = (each(np.zeros(3), np.array(velocity), np.asarray(5.0), DRAG) for each in CROSSINGS)
    assert_allclose([quadratic, printed], exact, atol=1e-8)
    assert_allclose(flat, quadratic, atol=flat_within)  # leaves out what gravity does to the speed


def test_the_drop_of_a_flat_flight_solves_its_differential_equation():
    ode = lambda t, x: [x[1], 9.81 - 0.6 / (1.0 + 0.6 * t) * x[1]]  # noqa: E731
    drop = solve_ivp(ode, (0.0, 1.5), [0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-13).y[0, -1]
    assert pellet.flat_fire_drop(np.asarray(1.5), np.asarray(0.6)) == pytest.approx(drop, abs=1e-9)


@pytest.mark.parametrize("drag", [0.0, 1e-8, 1e-4, 1e-3])
def test_a_vanishing_drag_leaves_the_parabola_in_float32(drag):
    velocity, time = np.array([18.0, -2.0, 1.5], np.float32), 5.0 / 18.0
    for crossing in CROSSINGS:
        found = crossing(0.0 * velocity, velocity, np.float32(5.0), np.float32(drag))
        assert_allclose(found, [-2.0 * time, 1.5 * time - 9.81 / 2 * time**2, time], atol=1e-6 + 2 * drag)


def test_a_pellet_leaves_at_the_gimbals_angles_with_dispersion_and_the_velocity_of_the_muzzle():
    angle, rate, drawn, step = np.array([0.15, -0.6]), np.array([3.0, 5.0]), np.array([2.0, -1.0, 0.5]), 1e-6
    before, after = (pellet_at_muzzle(gun(), angle + by * rate, rate, drawn)[0] for by in (-step, step))
    moving, resting = (pellet_at_muzzle(gun(), angle, each, drawn)[1] for each in (rate, 0.0 * rate))
    assert_allclose(moving - resting, (after - before) / (2 * step), atol=1e-8)
    assert_allclose(resting, 18.1 * direction(np.array([0.15 + 0.01 + 0.008, -0.6 - 0.02 - 0.003])))


@pytest.mark.parametrize(("made", "speed", "bound"), [((12, 0), 0, 1e-3), ((18, 0), 0, 1e-6), ((18, 0.2), 2, 3e-3)])
def test_the_mean_pellet_passes_through_the_target_that_it_is_aimed_at(made, speed, bound):
    distance, yaw, z = np.random.default_rng(12).uniform([1.0, -1.2, -1.0], [8.0, 1.2, 1.0], (200, 3)).T
    start, muzzle = np.stack([distance * np.cos(yaw), distance * np.sin(yaw), z], axis=-1), gun(*made)
    place = lambda time: start + speed * time[:, None] * [-0.3, 0.9, 0.3]  # noqa: E731
    angle, time = intercept(place, 0.0 * z + 0.05, muzzle)
    fired, then = pellet_at_muzzle(muzzle, angle, 0.0 * angle, 0.0 * start), place(0.05 + time)
    y, height, flown = pellet.flat_fire_crossing(*fired, then[:, 0], DRAG)
    assert np.max(np.abs([(y - then[:, 1]) * np.cos(yaw), height - then[:, 2]])) < bound
    assert_allclose(time, flown, rtol=3e-3)


def test_numpy_and_jax_compute_alike_what_the_worlds_do_not_use(batch, agree):
    rng = np.random.default_rng(3)
    position, velocity = rng.normal(0.0, 0.1, (*batch, 3)), rng.normal([18.0, 0.0, 1.0], 2.0, (*batch, 3))

    def everything(place, velocity, plane, arm, torque):
        held = arm, RigidState(*arm[:2]), torque
        crossing = pellet.quadratic_crossing(place, velocity, plane, arm.mass, steps=2)
        printed = pellet.printed_crossing(place, velocity, plane, arm.mass)
        return crossing, printed, dry_friction(*held, 0.5 * torque, 0.01), rigid_step(*held, 0.01)

    plane, torque, *arm = rng.uniform(0.1, 0.9, (6, *batch))
    agree(everything, position, velocity, 4.0 * plane, RigidAxis(*arm), torque, rtol=1e-4)

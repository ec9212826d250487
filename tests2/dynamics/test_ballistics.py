import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from archerfish2.dynamics import pellet
from archerfish2.dynamics.aiming import aim_at, intercept
from archerfish2.dynamics.muzzle import Muzzle, direction, pellet_at_muzzle
from archerfish2.dynamics.pellet import GRAVITY

DRAG, STILL = 0.019, np.zeros(2)
CROSSINGS = (pellet.flat_fire_crossing, pellet.printed_crossing, pellet.quadratic_crossing)


def gun(speed=18.0, offset=(0.01, -0.02), drag=DRAG, length=0.15):
    return Muzzle(*(np.asarray(each) for each in (speed, 0.2, offset, (0.004, 0.003), drag, length)))


@pytest.mark.parametrize(("velocity", "flat_within"), [((18.0, 0.0, 1.0), 2e-4), ((14.0, -11.0, 0.5), 2e-3)])
def test_flights_solve_their_differential_equations(velocity, flat_within):
    def ahead(_, x):
        return x[0] - 5.0

    ahead.terminal = True
    exact = []
    for size in (np.linalg.norm, lambda v: np.abs(v) * [1.0, 1.0, 0.0]):  # of |v|; eq (5) takes each coordinate alone
        ode = lambda _, x, size=size: [*x[3:], *(-DRAG * size(x[3:]) * x[3:] - [0.0, 0.0, GRAVITY])]  # noqa: E731
        done = solve_ivp(ode, (0.0, 2.0), [0.0, 0.0, 0.0, *velocity], "DOP853", events=ahead, rtol=1e-12, atol=1e-13)
        exact.append([*done.y_events[0][0, 1:3], done.t_events[0][0]])
    flat, printed, quadratic = (each(np.zeros(3), np.array(velocity), np.asarray(5.0), DRAG) for each in CROSSINGS)
    assert_allclose(quadratic, exact[0], atol=1e-8)
    assert_allclose(printed, exact[1], atol=1e-9)
    assert_allclose(flat, quadratic, atol=flat_within)  # leaves out what gravity does to the speed
    ode = lambda t, x: [x[1], GRAVITY - 0.6 / (1.0 + 0.6 * t) * x[1]]  # noqa: E731
    drop = solve_ivp(ode, (0.0, 1.5), STILL, "DOP853", rtol=1e-12, atol=1e-13).y[0, -1]
    assert pellet.flat_fire_drop(np.asarray(1.5), np.asarray(0.6)) == pytest.approx(drop, abs=1e-9)


@pytest.mark.parametrize("drag", [0.0, 1e-8, 1e-4, 1e-3])
def test_a_vanishing_drag_leaves_the_parabola_in_float32(drag):
    muzzle, time = np.array([[0.2, 0.1, 0.3], [18.0, -2.0, 1.5]], np.float32), 5.0 / 18.0
    for crossing in CROSSINGS:
        found = crossing(*muzzle, np.float32(5.2), np.float32(drag))
        assert_allclose(found, [0.1 - 2.0 * time, 0.3 + 1.5 * time - GRAVITY / 2 * time**2, time], atol=1e-6 + 2 * drag)


def test_numpy_and_jax_fly_and_aim_alike(batch, agree):
    rng = np.random.default_rng(3)
    position, velocity = rng.normal(0.0, 0.1, (*batch, 3)), rng.normal([18.0, 0.0, 1.0], 2.0, (*batch, 3))
    plane, drag, time = rng.uniform(1.0, 6.0, batch), rng.uniform(0.0, 0.05, batch), rng.uniform(0.0, 0.3, batch)

    def everything(place, velocity, plane, drag, time, muzzle):
        slow = pellet.quadratic_crossing(place, velocity, plane, drag, steps=2)
        fired = pellet_at_muzzle(muzzle, place[..., :2], place[..., 1:], place)
        aim = intercept(lambda t: velocity / 4.0 + t[..., None] * velocity / 9.0, time, muzzle)
        return *(each(place, velocity, plane, drag) for each in CROSSINGS[:2]), slow, fired, aim

    assert agree(everything, position, velocity, plane, drag, time, gun(), atol=1e-5)[4].angle.shape == (*batch, 2)


def test_a_pellet_leaves_at_the_gimbals_angles_with_dispersion_and_the_velocity_of_the_muzzle():
    angle, rate, drawn, step = np.array([0.15, -0.6]), np.array([3.0, 5.0]), np.array([2.0, -1.0, 0.5]), 1e-6
    before, after = (pellet_at_muzzle(gun(), angle + by * rate, rate, drawn)[0] for by in (-step, step))
    moving, resting = (pellet_at_muzzle(gun(), angle, each, drawn)[1] for each in (rate, STILL))
    assert_allclose(moving - resting, (after - before) / (2 * step), atol=1e-8)
    assert_allclose(resting, 18.1 * direction(np.array([0.15 + 0.01 + 0.008, -0.6 - 0.02 - 0.003])))


@pytest.mark.parametrize(("speed", "length", "bound"), [(12.0, 0.0, 1e-3), (18.0, 0.0, 1e-6), (18.0, 0.2, 1e-4)])
def test_the_mean_pellet_passes_through_the_point_that_it_is_aimed_at(speed, length, bound):
    distance, yaw, z = np.random.default_rng(12).uniform([1.0, -1.2, -1.0], [8.0, 1.2, 1.0], (200, 3)).T
    point, muzzle = np.stack([distance * np.cos(yaw), distance * np.sin(yaw), z], axis=-1), gun(speed, length=length)
    angle, time = aim_at(point, muzzle)
    fired = pellet_at_muzzle(muzzle, angle, 0.0 * angle, 0.0 * point)
    y, height, flown = pellet.flat_fire_crossing(*fired, point[:, 0], DRAG)
    assert np.max(np.abs([(y - point[:, 1]) * np.cos(yaw), height - z])) < bound
    assert_allclose(time, flown, rtol=2e-3)


@pytest.mark.parametrize("velocity", [(0.0, 0.35, 0.0), (-1.0, 2.0, 0.0), (2.0, -1.0, 0.3)])
def test_an_intercept_hits_a_moving_target(velocity):
    place = lambda time: np.array([4.0, -0.5, 0.1]) + time * np.array(velocity)  # noqa: E731
    angle, time = intercept(place, np.asarray(0.05), gun())
    then, fired = place(0.05 + time), pellet_at_muzzle(gun(), angle, STILL, np.zeros(3))
    assert_allclose(pellet.flat_fire_crossing(*fired, then[0], DRAG)[:2], then[1:], atol=5e-4)

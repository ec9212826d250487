import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from archerfish2.dynamics import pellet
from archerfish2.dynamics.muzzle import Muzzle, direction, pellet_at_muzzle
from archerfish2.dynamics.rigid_axis import RigidAxis, RigidState, dry_friction, rigid_step

DRAG, CROSSINGS = 0.019, (pellet.flat_fire_crossing, pellet.printed_crossing, pellet.quadratic_crossing)


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
    there = pellet.flat_fire_position(np.array(velocity), DRAG, flat.time)
    assert_allclose(there, [5.0, flat.lateral, flat.height], atol=1e-12)


@pytest.mark.parametrize("drag", [0.0, 1e-8, 1e-4, 1e-3])
def test_a_vanishing_drag_leaves_the_parabola_in_float32(drag):
    velocity, time = np.array([18.0, -2.0, 1.5], np.float32), 5.0 / 18.0
    for crossing in CROSSINGS:
        found = crossing(0.0 * velocity, velocity, np.float32(5.0), np.float32(drag))
        assert_allclose(found, [-2.0 * time, 1.5 * time - 9.81 / 2 * time**2, time], atol=1e-6 + 2 * drag)


def test_a_pellet_leaves_at_the_gimbals_angles_with_dispersion_and_the_velocity_of_the_muzzle():
    muzzle = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, -0.02), (0.004, 0.003), DRAG, 0.15)))
    angle, rate, drawn, step = np.array([0.15, -0.6]), np.array([3.0, 5.0]), np.array([2.0, -1.0, 0.5]), 1e-6
    before, after = (pellet_at_muzzle(muzzle, angle + by * rate, rate, drawn)[0] for by in (-step, step))
    moving, resting = (pellet_at_muzzle(muzzle, angle, each, drawn)[1] for each in (rate, 0.0 * rate))
    assert_allclose(moving - resting, (after - before) / (2 * step), atol=1e-8)
    assert_allclose(resting, 18.1 * direction(np.array([0.15 + 0.01 + 0.008, -0.6 - 0.02 - 0.003])))


def test_numpy_and_jax_compute_alike_what_the_worlds_do_not_use(batch, agree):
    def everything(place, velocity, plane, arm, torque):
        held, crossing = (arm, RigidState(*arm[:2]), torque), (place, velocity, plane, arm.mass)
        both = pellet.quadratic_crossing(*crossing, steps=2), pellet.printed_crossing(*crossing)
        return *both, dry_friction(*held, 0.5 * torque, 0.01), rigid_step(*held, 0.01)

    rng = np.random.default_rng(3)
    position, velocity = rng.normal(0.0, 0.1, (*batch, 3)), rng.normal([18.0, 0.0, 1.0], 2.0, (*batch, 3))
    plane, torque, *arm = rng.uniform(0.1, 0.9, (6, *batch))
    agree(everything, position, velocity, 4.0 * plane, RigidAxis(*arm), torque, rtol=1e-4)

"""Pellets, how they leave and where they arrive, and the heat of the barrel: SciPy, closed forms, by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from archerfish2.virtual_robot.muzzle import LastShot, after_shot, allowed, deficit_at, heat_at, launch
from archerfish2.virtual_robot.pellets import fly

GRAVITY = 9.81


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

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from archerfish.identification.landing import landing_distance


def test_without_drag_it_is_the_parabola_of_school():
    speed, pitch, height = np.array(10.0), np.radians(30.0), 1.5
    rise, level = 10 * np.sin(pitch), 10 * np.cos(pitch)
    expected = level * (rise + np.sqrt(rise**2 + 2 * 9.81 * height)) / 9.81
    assert landing_distance(speed, np.array(pitch), np.array(0.0), height, 0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_it_agrees_with_the_differential_equations_of_eq_5(yaw):
    speed, pitch, height, drag = 18.0, np.radians(3.0), 0.4, 0.05
    start = speed * np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])

    def motion(_, state):
        velocity = state[3:]
        return [*velocity, -drag * velocity[0] * abs(velocity[0]), -drag * velocity[1] * abs(velocity[1]), -9.81]

    def ground(_, state):
        return state[2] + height

    ground.terminal = True
    end = solve_ivp(motion, (0, 5), [0, 0, 0, *start], events=ground, rtol=1e-11, atol=1e-12).y[:, -1]
    found = landing_distance(np.array(speed), np.array(pitch), np.array(yaw), height, drag)
    assert found == pytest.approx(np.hypot(end[0], end[1]), abs=1e-8)


def test_yaw_matters_as_little_as_the_docstring_says():
    straight, turned = landing_distance(np.array(18.9), np.radians(2.6), np.radians([0.0, 5.0]), 0.3, 0.019)
    assert abs(turned / straight - 1) < 1e-3
    assert straight == pytest.approx(6.2, abs=0.1)

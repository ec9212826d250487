import numpy as np
import pytest
from scipy.integrate import solve_ivp

from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.identification.muzzle.landing import landing_distance


def quadratic_landing(speed, pitch, height, drag):
    """Integrate v̇ = −k |v| v − g ẑ to the ground, in the vertical plane of the flight."""

    def motion(_, state):
        velocity = state[2:]
        return [*velocity, *(-drag * np.hypot(*velocity) * velocity - [0.0, 9.81])]

    def ground(_, state):
        return state[1] + height

    ground.terminal, ground.direction = True, -1
    start = [0.0, 0.0, speed * np.cos(pitch), speed * np.sin(pitch)]
    return solve_ivp(motion, (0, 9), start, events=ground, rtol=1e-9, atol=1e-11).y[0, -1]


def test_without_drag_it_is_the_parabola_of_school():
    speed, pitch, height = np.array(10.0), np.radians(30.0), 1.5
    rise, level = 10 * np.sin(pitch), 10 * np.cos(pitch)
    expected = level * (rise + np.sqrt(rise**2 + 2 * 9.81 * height)) / 9.81
    assert landing_distance(speed, np.array(pitch), height, 0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("height", [0.2, 0.4, 1.0])
@pytest.mark.parametrize(
    ("pitch_deg", "share"), [(-5.0, 0.0), (0.0, 0.0), (2.0, 0.0), (5.0, 4e-4), (10.0, 3e-3), (15.0, 7e-3)]
)
def test_it_departs_from_quadratic_drag_by_no_more_than_the_docstring_says(pitch_deg, share, height):
    # A flight is flat fire as long as gravity hardly turns it: exact to a millimetre or so, up to a slope of 5°.
    for speed in (10.0, 18.0, 30.0):
        expected = quadratic_landing(speed, np.radians(pitch_deg), height, 0.019)
        found = landing_distance(np.array(speed), np.radians(pitch_deg), height, 0.019)
        assert found == pytest.approx(expected, rel=share, abs=1.3e-3)


@pytest.mark.parametrize("height", [0.01, 0.4, 3.0])
@pytest.mark.parametrize("drag", [1e-4, 0.019, 0.3])
def test_a_pellet_of_the_simulator_is_on_the_ground_there(height, drag):
    speed, pitch = np.meshgrid([1.0, 8.0, 18.0, 35.0], np.linspace(-0.7, 0.7, 9))
    velocity = speed[..., None] * np.stack([np.cos(pitch), 0 * pitch, np.sin(pitch)], axis=-1)
    muzzle = np.array([0.0, 0.0, height]) + 0 * velocity
    landing = landing_distance(speed, pitch, height, drag)
    assert np.abs(flat_fire_crossing(muzzle, velocity, landing, np.asarray(drag)).height).max() < 1e-6

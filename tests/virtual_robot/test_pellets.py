import numpy as np
import pytest
from scipy.integrate import solve_ivp

from archerfish.virtual_robot.pellets import GRAVITY, crossing, landing


def by_scipy(position, velocity, drag, event):
    def slope(_, x):
        return [*x[3:], *(-drag * np.linalg.norm(x[3:]) * x[3:] - np.array([0.0, 0.0, GRAVITY]))]

    event.terminal = True
    found = solve_ivp(slope, (0, 5), [*position, *velocity], events=event, rtol=1e-11, atol=1e-12)
    return found.t_events[0][0], found.y_events[0][0][:3]


def test_crossings_of_moving_plates_agree_with_scipy() -> None:
    rng = np.random.default_rng(0)
    count = 12
    position = 0.1 * rng.standard_normal((count, 3))
    direction = np.array([1.0, 0.0, 0.0]) + 0.3 * rng.standard_normal((count, 3))
    velocity = rng.uniform(10, 28, (count, 1)) * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    start, drift = rng.uniform(1, 8, count), rng.uniform(-2, 2, count)

    def plate(time):
        return np.stack([start + drift * time, 0.0 * time, 0.0 * time], axis=1)

    found = crossing(position, velocity, 0.019, plate)
    for k in range(count):
        time, place = by_scipy(position[k], velocity[k], 0.019, lambda t, x, k=k: x[0] - start[k] - drift[k] * t)
        assert found.time[k] == pytest.approx(time, abs=1e-8)
        np.testing.assert_allclose(found.position[k], place, atol=1e-7)


def test_landings_agree_with_scipy() -> None:
    for pitch in (-0.3, 0.0, 0.17):
        velocity = 18 * np.array([np.cos(pitch), 0.1, np.sin(pitch)])
        found = landing(np.zeros((1, 3)), velocity[None], 0.019, -0.45)
        time, place = by_scipy(np.zeros(3), velocity, 0.019, lambda _, x: x[2] + 0.45)
        assert found.time[0] == pytest.approx(time, abs=1e-8)
        np.testing.assert_allclose(found.position[0], place, atol=1e-7)


def test_without_drag_the_flight_is_a_parabola() -> None:
    velocity = np.array([[15.0, 1.0, 2.0]])
    found = crossing(np.zeros((1, 3)), velocity, 0.0, lambda time: np.stack([0 * time + 5.0, time, time], axis=1))
    time = 5.0 / 15.0
    assert found.time[0] == pytest.approx(time, abs=1e-9)
    np.testing.assert_allclose(found.position[0], [5.0, time, 2 * time - 0.5 * GRAVITY * time**2], atol=1e-9)


def test_drag_alone_is_the_logarithm() -> None:
    """x(t) = log1p(k v t)/k on a straight, steep throw would bend; a fast level one hardly does in 0.1 s."""
    found = crossing(np.zeros((1, 3)), np.array([[200.0, 0.0, 0.0]]), 0.019, lambda t: np.stack([0 * t + 10] * 3, 1))
    assert found.time[0] == pytest.approx(np.expm1(0.019 * 10) / (0.019 * 200), rel=1e-5)


def test_a_plate_that_turns_back_within_a_step_is_met_where_it_is() -> None:
    def plate(time):
        x = 3.0 + 4.0 * np.abs(time - 0.163)
        return np.stack([x, 0 * x, 0 * x], axis=1)

    found = crossing(np.zeros((1, 3)), np.array([[18.0, 0.0, 0.0]]), 0.019, plate)
    assert found.position[0, 0] == pytest.approx(plate(found.time)[0, 0], abs=1e-9)


def test_a_pellet_that_never_gets_there_is_nan_and_stops_nobody() -> None:
    velocity = np.array([[18.0, 0.0, 0.0], [-18.0, 0.0, 0.0]])
    found = crossing(np.zeros((2, 3)), velocity, 0.019, lambda time: np.stack([0 * time + 3.0] * 3, axis=1))
    assert np.isfinite(found.time[0])
    assert np.isnan(found.time[1])
    assert np.isnan(found.position[1]).all()


def test_a_flight_does_not_depend_on_its_company() -> None:
    rng = np.random.default_rng(1)
    velocity = np.stack([rng.uniform(12, 24, 30), rng.normal(0, 2, 30), rng.normal(1, 1, 30)], axis=1)

    def plates(few):
        return lambda time: np.stack([few + 2.0 * np.abs(time - 0.2), 0 * time, 0 * time], axis=1)

    distance = rng.uniform(2, 7, 30)
    together = crossing(np.zeros((30, 3)), velocity, 0.019, plates(distance))
    for k in range(30):
        alone = crossing(np.zeros((1, 3)), velocity[k : k + 1], 0.019, plates(distance[k : k + 1]))
        np.testing.assert_array_equal(alone.time[0], together.time[k])
        np.testing.assert_array_equal(alone.position[0], together.position[k])

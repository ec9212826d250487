import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from archerfish.dynamics import pellet
from archerfish.dynamics.integration import runge_kutta_4
from archerfish.dynamics.pellet import GRAVITY

DRAG = 0.019
CROSSINGS = (pellet.flat_fire_crossing, pellet.printed_crossing, pellet.quadratic_crossing)
DEPARTURES = [(18.0, 0.0, 1.0), (14.0, -11.0, 0.5), (16.0, 5.0, -4.0), (25.0, 3.0, 6.0)]
TOLERANCE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def departure(speed: float, pitch: float, yaw: float) -> np.ndarray:
    return speed * np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])


def quadratic_drag(velocity: np.ndarray) -> np.ndarray:
    return -DRAG * np.linalg.norm(velocity) * velocity - [0.0, 0.0, GRAVITY]


def flight(acceleration: Callable[[np.ndarray], np.ndarray], velocity: np.ndarray, seconds: float) -> np.ndarray:
    """Position and velocity after a time by SciPy."""
    start = np.concatenate([np.zeros(3), velocity])
    done = solve_ivp(lambda _, x: np.concatenate([x[3:], acceleration(x[3:])]), (0.0, seconds), start, **TOLERANCE)
    return done.y[:, -1]


def crossing_by_scipy(velocity: np.ndarray, plane_x: float) -> list[float]:
    """Lateral position, height and time where a pellet under 3-D drag meets a plane."""

    def at_plane(_: float, x: np.ndarray) -> float:
        return x[0] - plane_x

    at_plane.terminal = True
    start = np.concatenate([np.zeros(3), velocity])
    slope = lambda _, x: np.concatenate([x[3:], quadratic_drag(x[3:])])  # noqa: E731
    done = solve_ivp(slope, (0.0, 5.0), start, events=at_plane, max_step=0.01, **TOLERANCE)
    return [done.y_events[0][0, 1], done.y_events[0][0, 2], done.t_events[0][0]]


@pytest.mark.parametrize("velocity", DEPARTURES)
def test_closed_form_of_eq_5_solves_its_own_differential_equation(velocity) -> None:
    def coordinatewise(v: np.ndarray) -> np.ndarray:
        return np.array([-DRAG * v[0] * abs(v[0]), -DRAG * v[1] * abs(v[1]), -GRAVITY])

    found = pellet.printed_position(np.array(velocity), DRAG, 0.8)
    assert_allclose(found, flight(coordinatewise, np.array(velocity), 0.8)[:3], rtol=0, atol=1e-9)


@pytest.mark.parametrize("velocity", DEPARTURES)
def test_runge_kutta_follows_3d_drag(velocity) -> None:
    state, stride = np.concatenate([np.zeros(3), velocity]), 0.01
    for _ in range(50):
        state = runge_kutta_4(
            lambda x: np.concatenate([x[3:], pellet.drag_acceleration(x[3:], DRAG)]), state, np.asarray(stride)
        )
    assert_allclose(state, flight(quadratic_drag, np.array(velocity), 0.5), rtol=0, atol=1e-6)


@pytest.mark.parametrize("plane_x", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("velocity", DEPARTURES)
def test_reference_crossing_agrees_with_scipy(velocity, plane_x) -> None:
    found = pellet.quadratic_crossing(np.zeros(3), np.array(velocity), np.asarray(plane_x), DRAG)
    assert_allclose(found, crossing_by_scipy(np.array(velocity), plane_x), rtol=0, atol=1e-8)


def test_printed_eq_4_is_what_the_paper_prints() -> None:
    # By hand, with k = 0.5 and m_b = 0.25: k v³/|v| = k v |v|.
    found = pellet.printed_acceleration(np.array([2.0, -4.0, 3.0]), 0.5, 0.25)
    assert_allclose(found, [-0.5 * 4.0, 0.5 * 16.0, -0.5 * 9.0 / 0.25 - 9.81])


@pytest.mark.parametrize("velocity", DEPARTURES)
def test_printed_eq_4_flies_as_its_differential_equation_says(velocity) -> None:
    drag, mass = 6e-5, 3.2e-3

    def as_printed(v: np.ndarray) -> np.ndarray:
        return -drag * v**3 / np.abs(v + (v == 0.0)) / [1.0, 1.0, mass] - [0.0, 0.0, GRAVITY]

    state = np.concatenate([np.zeros(3), velocity])
    for _ in range(100):
        state = runge_kutta_4(
            lambda x: np.concatenate([x[3:], pellet.printed_acceleration(x[3:], drag, mass)]), state, np.asarray(0.005)
        )
    # The acceleration has a kink where the pellet begins to fall.
    assert_allclose(state, flight(as_printed, np.array(velocity), 0.5), rtol=0, atol=1e-6)


def test_flat_fire_drop_solves_its_differential_equation() -> None:
    decay = 0.6  # a far stronger drag than a pellet's shows every term

    def slope(time: float, x: np.ndarray) -> list[float]:
        return [x[1], GRAVITY - decay / (1.0 + decay * time) * x[1]]

    reference = solve_ivp(slope, (0.0, 1.5), [0.0, 0.0], **TOLERANCE)
    assert pellet.flat_fire_drop(np.asarray(1.5), np.asarray(decay)) == pytest.approx(reference.y[0, -1], abs=1e-9)


def test_flat_fire_time_undoes_the_distance() -> None:
    time = pellet.flat_fire_time(np.array([0.0, 3.0, 8.0]), 18.0, DRAG)
    assert_allclose(np.log1p(DRAG * 18.0 * time) / DRAG, [0.0, 3.0, 8.0], atol=1e-12)


@pytest.mark.parametrize("crossing", CROSSINGS)
def test_zero_drag_limit_is_the_parabola(crossing) -> None:
    velocity, time = np.array([18.0, 2.0, 1.5]), 4.0 / 18.0
    found = crossing(np.array([0.2, 0.1, 0.3]), velocity, np.asarray(4.2), np.asarray(0.0))
    assert_allclose(found, [0.1 + 2.0 * time, 0.3 + 1.5 * time - 0.5 * GRAVITY * time**2, time], rtol=1e-13)


@pytest.mark.parametrize("drag", [0.0, 1e-8, 1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("crossing", CROSSINGS)
def test_a_vanishing_drag_nears_the_parabola_in_float32(crossing, drag) -> None:
    velocity, time = np.array([18.0, -2.0, 1.5], np.float32), 5.0 / 18.0
    found = crossing(np.zeros(3, np.float32), velocity, np.float32(5.0), np.float32(drag))
    assert all(each.dtype == np.float32 for each in found)
    parabola = [-2.0 * time, 1.5 * time - 0.5 * GRAVITY * time**2, time]
    assert_allclose(found, parabola, rtol=0, atol=1e-6 + 2.0 * drag)


@pytest.mark.parametrize("drag", [1e-9, 1e-4, 2e-3, 0.05])
def test_closed_forms_in_float32_match_float64(drag) -> None:
    velocity, time = np.array([18.0, -2.0, 1.5]), np.linspace(0.0, 0.6, 40)
    for position in (pellet.printed_position, pellet.flat_fire_position):
        exact = np.array([position(velocity, np.asarray(drag), each) for each in time])
        found = np.array([position(velocity.astype("f"), np.float32(drag), np.float32(each)) for each in time])
        assert_allclose(found, exact, rtol=0, atol=4e-6)


@pytest.mark.parametrize(
    ("closed", "along"),
    [(pellet.flat_fire_crossing, pellet.flat_fire_position), (pellet.printed_crossing, pellet.printed_position)],
)
def test_a_crossing_lies_on_the_flight(closed, along) -> None:
    position, velocity = np.array([0.1, -0.2, 0.3]), np.array([17.0, -4.0, 2.0])
    found = closed(position, velocity, np.asarray(5.0), DRAG)
    assert_allclose(position + along(velocity, DRAG, found.time), [5.0, found.lateral, found.height], atol=1e-12)


@pytest.mark.parametrize("off_axis_deg", [0, 15, 30, 45])
@pytest.mark.parametrize("distance", [1.0, 3.0, 5.0, 8.0])
def test_flat_fire_stays_near_3d_drag(distance, off_axis_deg) -> None:
    yaw = math.radians(off_axis_deg)
    velocity, plane_x = departure(18.0, math.radians(2.0), yaw), np.asarray(distance * math.cos(yaw))
    found = pellet.flat_fire_crossing(np.zeros(3), velocity, plane_x, DRAG)
    exact = pellet.quadratic_crossing(np.zeros(3), velocity, plane_x, DRAG)
    # What gravity does to the speed grows at least with the cube of the way: here it costs 0.15 mm at 8 m.
    bound = 2e-4 * (distance / 8.0) ** 3
    assert abs(found.height - exact.height) < bound
    assert abs(found.lateral - exact.lateral) < bound
    assert found.time == pytest.approx(exact.time, rel=2e-3)


def test_only_eq_5_depends_on_how_the_axes_lie() -> None:
    turn = Rotation.from_euler("z", 40, degrees=True)
    velocity, time = departure(18.0, 0.05, -0.3), 0.25
    for position, invariant in ((pellet.flat_fire_position, True), (pellet.printed_position, False)):
        there = position(turn.apply(velocity), DRAG, time)
        assert np.allclose(there, turn.apply(position(velocity, DRAG, time)), atol=1e-12) is invariant
    assert_allclose(
        pellet.drag_acceleration(turn.apply(velocity), DRAG), turn.apply(pellet.drag_acceleration(velocity, DRAG))
    )


@pytest.mark.parametrize("crossing", CROSSINGS)
def test_left_and_right_are_mirror_images(crossing) -> None:
    velocity = np.array([16.0, 7.0, 1.0])
    left = crossing(np.zeros(3), velocity, np.asarray(4.0), DRAG)
    right = crossing(np.zeros(3), velocity * [1.0, -1.0, 1.0], np.asarray(4.0), DRAG)
    assert left == (-right.lateral, right.height, right.time)


@pytest.mark.parametrize("per_pellet", [False, True])
@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, per_pellet, agree_in_jax) -> None:
    rng = np.random.default_rng(3)
    velocity = rng.normal([18.0, 0.0, 1.0], [1.0, 5.0, 2.0], (*shape, 3))
    position = rng.normal(0.0, 0.1, (*shape, 3))
    plane_x, time = rng.uniform(1.0, 6.0, shape), rng.uniform(0.0, 0.3, shape)
    drag = rng.uniform(0.0, 0.05, shape) if per_pellet else np.asarray(DRAG)

    def everything(position, velocity, plane_x, time, drag):
        return (
            pellet.drag_acceleration(velocity, drag),
            pellet.printed_acceleration(velocity, drag, drag + 0.5),
            pellet.printed_position(velocity, drag, time),
            pellet.flat_fire_position(velocity, drag, time),
            *(crossing(position, velocity, plane_x, drag) for crossing in CROSSINGS[:2]),
            pellet.quadratic_crossing(position, velocity, plane_x, drag, steps=2),
        )

    results = agree_in_jax(everything, position, velocity, plane_x, time, drag, atol=1e-5)
    assert results[0].shape == (*shape, 3)
    assert results[4].time.shape == shape


def test_the_drop_keeps_the_digits_of_float32() -> None:
    # Over flights of 5 cm to 60 m; the plain difference z − log1p(z) would lose a digit at a metre.
    time = np.geomspace(3e-3, 3.0, 200)
    exact = pellet.flat_fire_drop(time, np.asarray(0.34))
    rough = pellet.flat_fire_drop(time.astype(np.float32), np.float32(0.34))
    assert_allclose(rough, exact, rtol=1e-6)

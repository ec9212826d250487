import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import aim_at, line_of_sight
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.dynamics.pellet import GRAVITY, flat_fire_crossing


def muzzle(offset=(0.0, 0.0), length: float = 0.0, speed: float = 18.0, drag: float = 0.019) -> Muzzle:
    values = (speed, 0.2, offset, (0.003, 0.003), drag, length)
    return Muzzle(*(np.asarray(each) for each in values))


def miss(gun: Muzzle, reach: float) -> np.ndarray:
    """Distance [m] of the mean pellet from 200 points that it was aimed at, across and above the line of sight."""
    rng = np.random.default_rng(12)
    distance, bearing = rng.uniform(1.0, reach, 200), rng.uniform(-1.2, 1.2, 200)
    point = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), rng.uniform(-1.0, 1.0, 200)], axis=-1)
    aim = aim_at(point, gun)
    position, velocity = pellet_at_muzzle(gun, aim.angle, np.zeros((200, 2)), np.zeros((200, 3)))
    crossing = flat_fire_crossing(position, velocity, point[:, 0], gun.drag)
    assert_allclose(aim.flight_time, crossing.time, rtol=2e-3)
    return np.hypot((crossing.lateral - point[:, 1]) * np.cos(bearing), crossing.height - point[:, 2])


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.01, -0.02)])
@pytest.mark.parametrize(("speed", "bound"), [(12.0, 1e-3), (18.0, 1e-6), (25.0, 1e-8)])
def test_the_mean_pellet_passes_through_the_point(speed, bound, offset) -> None:
    assert np.max(miss(muzzle(offset, speed=speed), reach=8.0)) < bound


def test_a_muzzle_away_from_the_pivot_costs_less_than_a_tenth_of_a_millimetre() -> None:
    assert np.max(miss(muzzle((0.01, -0.02), length=0.2), reach=8.0)) < 1e-4


def test_without_drag_the_angle_is_that_of_the_parabola() -> None:
    # From ẑ: x tan θ − g x² / (2 v² cos² θ) = z, the flat one of its two solutions.
    x, z, v = 6.0, 0.4, 20.0
    drop = GRAVITY * x**2 / (2.0 * v**2)
    tangent = (x - np.sqrt(x**2 - 4.0 * drop * (drop + z))) / (2.0 * drop)
    aim = aim_at(np.array([x, 0.0, z]), muzzle(speed=v, drag=0.0))
    assert_allclose(aim.angle, [np.arctan(tangent), 0.0], atol=1e-6)
    assert aim.flight_time == pytest.approx(x / (v * np.cos(np.arctan(tangent))), rel=1e-5)


def test_left_and_right_are_mirror_images() -> None:
    left, right = (aim_at(np.array([3.0, y, 0.1]), muzzle()) for y in (1.0, -1.0))
    assert_allclose(left.angle * [1.0, -1.0], right.angle, rtol=0, atol=0)


def test_the_line_of_sight_by_hand() -> None:
    assert_allclose(line_of_sight(np.array([1.0, 1.0, np.sqrt(2.0)])), [np.pi / 4, np.pi / 4])
    assert_allclose(line_of_sight(np.array([2.0, -2.0, 0.0])), [0.0, -np.pi / 4])


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    point = np.random.default_rng(7).uniform([1.0, -2.0, -0.5], [6.0, 2.0, 0.5], (*shape, 3))

    def both(point, gun):
        return aim_at(point, gun), line_of_sight(point)

    aim, _ = agree_in_jax(both, point, muzzle((0.01, -0.02), 0.2))
    assert aim.angle.shape == (*shape, 2)
    assert aim.flight_time.shape == shape

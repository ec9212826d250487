import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.targets.passing import Line

MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.0, 0.0), (0.0035, 0.0035), 0.019, 0.0)))
DELAY = np.asarray(0.05)


@pytest.mark.parametrize("velocity", [(0.0, 0.35, 0.0), (-1.0, 2.0, 0.0), (2.0, -1.0, 0.3)])
def test_a_pellet_meets_a_moving_target(velocity) -> None:
    line = Line(np.array([4.0, -0.5, 0.1]), np.array(velocity))
    aim = intercept(line.position, DELAY, MUZZLE)
    position, speed = pellet_at_muzzle(MUZZLE, aim.angle, np.zeros(2), np.zeros(3))
    place = line.position(DELAY + aim.flight_time)
    crossing = flat_fire_crossing(position, speed, place[0], MUZZLE.drag)
    assert_allclose([crossing.lateral, crossing.height], place[1:], atol=5e-4)
    assert crossing.time == pytest.approx(aim.flight_time, rel=1e-3)


def test_a_static_target_needs_no_lead() -> None:
    place = np.array([4.0, -0.5, 0.1])
    aim = intercept(lambda time: place, DELAY, MUZZLE)
    assert_allclose(aim.angle, aim_at(place, MUZZLE).angle)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(61)
    line = Line(rng.uniform([2.0, -0.7, 0.0], [5.0, 0.7, 0.1], (*shape, 3)), rng.uniform(-1.0, 1.0, (*shape, 3)))
    aim = agree_in_jax(
        lambda line, delay, gun: intercept(line.position, delay, gun), line, np.full(shape, 0.04), MUZZLE
    )
    assert aim.angle.shape == (*shape, 2)

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.sensing.interfaces import Shot, World, fire_always, without_withheld
from archerfish.simulation.shooting import ShootingWorld


def test_a_plain_command_fires_without_feed_forward_or_estimate() -> None:
    command = fire_always(np.array([[0.1, -0.2], [0.0, 0.3]]))
    assert_allclose(command.angle, [[0.1, -0.2], [0.0, 0.3]])
    assert_allclose(command.rate, 0.0)
    assert command.fire.tolist() == [True, True]
    assert np.isnan(command.hit_probability).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_angle_that_is_no_number_fires_nothing(bad) -> None:
    with np.errstate(invalid="ignore"):
        assert not fire_always(np.array([bad, 0.0])).fire


def test_the_simulation_keeps_the_worlds_protocol() -> None:
    assert isinstance(ShootingWorld(*[np.asarray(0.02)] * len(ShootingWorld._fields)), World)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_a_withheld_shot_has_neither_miss_nor_flight_in_numpy_and_jax(shape, agree_in_jax) -> None:
    fired = np.arange(np.prod(shape, dtype=int)).reshape(shape) % 2 == 1
    numbers = np.random.default_rng(0).normal(size=(*shape, 5)).astype(np.float32)
    shot = Shot(fired, numbers[..., :2], numbers[..., 2], numbers[..., 3:])
    found = agree_in_jax(without_withheld, shot)
    assert_allclose(found.miss, np.where(fired[..., None], shot.miss, np.nan))
    assert_allclose(found.flight_time, np.where(fired, shot.flight_time, np.nan))
    assert_allclose(found.angle, shot.angle)

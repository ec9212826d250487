import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.targets.distributions import LARGEST_SPEED, TABLE, Distribution, direction, draw_parameters, way_along

ALL = [(motion, name, each) for motion, table in TABLE.items() for name, each in table.items()]
NAMES = [f"{motion}: {name}" for motion, name, _ in ALL]


@pytest.mark.parametrize(("motion", "name", "each"), ALL, ids=NAMES)
def test_a_draw_is_the_inverse_of_the_distribution_function(motion: str, name: str, each: Distribution) -> None:
    uniform = np.linspace(0.0, 1.0, 101)[:-1]
    values = each.draw(uniform)
    assert np.all(np.diff(values) > 0.0)
    scale = np.log if each.logarithmic else np.asarray
    assert_allclose(np.interp(scale(values), scale(each.value), each.share), uniform, atol=1e-12)


@pytest.mark.parametrize(("motion", "name", "each"), ALL, ids=NAMES)
def test_quantiles_are_those_of_the_table(motion: str, name: str, each: Distribution) -> None:
    assert_allclose(each.draw(np.array(each.share)), each.value)
    assert (each.share[0], each.share[-1]) == (0.0, 1.0)
    assert np.all(np.diff(each.share) > 0.0)
    assert each.reason
    assert each.unit != "m/s" or max(each.value) <= LARGEST_SPEED


def test_parameters_come_in_the_order_of_the_table_and_in_rad() -> None:
    chance = np.tile(np.array([0.0, 0.5, 1.0])[:, None], (1, 4))
    speed, heading = draw_parameters("pass", chance)
    assert_allclose(speed, [0.31, 1.0, 3.0])
    assert_allclose(heading, np.deg2rad([-90.0, 0.0, 90.0]), atol=1e-12)


def test_directions_are_zero_to_the_left_and_positive_away() -> None:
    assert_allclose(direction(np.deg2rad([0.0, 90.0, 180.0])), [[0, 1], [1, 0], [0, -1]], atol=1e-12)
    assert_allclose(way_along(np.asarray(0.0), np.array([1.0, -2.0])), [[0.0, 1.0], [0.0, -2.0]])


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape: tuple[int, ...], agree_in_jax) -> None:
    chance = np.random.default_rng(3).random((*shape, 8))

    def drawn(chance):
        return tuple(draw_parameters(motion, chance) for motion in TABLE if TABLE[motion])

    for values in agree_in_jax(drawn, chance):
        assert all(each.shape == shape for each in values)

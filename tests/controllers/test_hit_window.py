import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from archerfish.controllers.hit_window import across_sight, distribution, most_hits

REACH = 0.06


def hit_chance(aim, place, sd, chance) -> np.ndarray:
    """Chance that a pellet at each aim hits, with normal densities."""
    off = aim[:, None] - place
    return np.sum(chance * (norm.cdf((off + REACH) / sd) - norm.cdf((off - REACH) / sd)), axis=-1)


@pytest.mark.parametrize("seed", range(20))
def test_no_other_aim_hits_noticeably_more(seed) -> None:
    rng = np.random.default_rng(seed)
    place, sd = rng.uniform(-0.15, 0.15, 9), rng.uniform(0.005, 0.03, 9)
    chance = rng.dirichlet(np.full(9, 0.5))
    aim = most_hits(place, sd, np.asarray(REACH), chance)
    best = hit_chance(np.linspace(-0.2, 0.2, 2001), place, sd, chance).max()
    assert hit_chance(np.array([aim]), place, sd, chance)[0] > best - 0.025


def test_of_two_places_the_likelier_is_aimed_at_and_not_their_mean() -> None:
    place, sd = np.array([-0.2, 0.2]), np.array([0.01, 0.01])
    for chance, near in (([0.6, 0.4], -0.2), ([0.4, 0.6], 0.2)):
        assert abs(most_hits(place, sd, np.asarray(REACH), np.array(chance)) - near) < REACH


def test_an_aim_that_reaches_two_places_is_better_than_one_at_the_likelier() -> None:
    place, sd = np.array([0.0, 0.09]), np.array([0.005, 0.005])
    aim = most_hits(place, sd, np.asarray(REACH), np.array([0.8, 0.2]))
    assert 0.035 < aim < 0.055


def test_places_are_equally_likely_unless_said_otherwise() -> None:
    rng = np.random.default_rng(3)
    place, sd = rng.normal(0.0, 0.05, (4, 12)), np.full((4, 1), 0.01)
    assert_allclose(
        most_hits(place, sd, np.asarray(REACH)),
        most_hits(place, sd + 0.0 * place, np.asarray(REACH), np.full((4, 12), 1 / 12)),
    )


def test_the_cheap_distribution_function_is_near_the_normal_one() -> None:
    deviate = np.linspace(-5.0, 5.0, 1001)
    assert np.abs(distribution(deviate) - norm.cdf(deviate)).max() < 0.023


def test_left_is_across_the_line_of_sight() -> None:
    left, distance = across_sight(np.array([3.0, 4.0]))
    assert distance == pytest.approx(5.0)
    assert_allclose(left, [-0.8, 0.6])


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(4)
    place, sd = rng.normal(0.0, 0.05, (*shape, 7)), rng.uniform(0.01, 0.03, (*shape, 7))
    chance = rng.dirichlet(np.ones(7), shape)
    # The sharp choice magnifies rounding.
    assert agree_in_jax(most_hits, place, sd, np.asarray(REACH), chance, atol=1e-4).shape == shape

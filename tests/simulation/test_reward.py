import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.simulation.reward import EQ_8, Reward, reward

RADIUS = np.float32(0.06)
MISS = np.array([[0.03, -0.04], [0.0, 0.0], [0.06, 0.0], [0.1, 0.2]], np.float32)


def smooth(width: float) -> Reward:
    return Reward(np.float32(0.0), np.float32(1.0), np.float32(width))


def test_by_default_it_is_eq_8() -> None:
    gained, hit = reward(EQ_8, MISS, RADIUS)
    assert_allclose(gained, [-0.05, 0.0, -0.06, -np.hypot(0.1, 0.2)], rtol=1e-6)
    assert hit.tolist() == [True, True, True, False]


def test_a_hit_adds_its_worth_and_a_miss_nothing() -> None:
    gained, hit = reward(Reward(hit=np.float32(0.1)), MISS, RADIUS)
    assert_allclose(gained, reward(EQ_8, MISS, RADIUS)[0] + 0.1 * hit, rtol=1e-6)


def test_a_smooth_hit_is_worth_half_at_the_edge_and_nearly_all_or_nothing_beyond_a_few_widths() -> None:
    distances = np.array([0.06, 0.06 - 0.05, 0.06 + 0.05], np.float32)
    gained, _ = reward(smooth(0.01), np.stack([distances, 0.0 * distances], axis=-1), RADIUS)
    assert_allclose(gained, [0.5, 1.0 / (1.0 + np.exp(-5.0)), 1.0 / (1.0 + np.exp(5.0))], rtol=1e-4)


def test_the_narrower_the_nearer_to_a_step() -> None:
    miss = np.stack([np.linspace(0.0, 0.12, 50, dtype=np.float32), np.zeros(50, np.float32)], axis=-1)
    step, hit = reward(smooth(0.0), miss, RADIUS)
    assert_allclose(step, hit)
    off = [np.abs(reward(smooth(width), miss, RADIUS)[0] - step).mean() for width in (0.02, 0.005, 0.001)]
    assert off[0] > 3 * off[1] > 9 * off[2]


def test_far_misses_overflow_nothing() -> None:
    gained, _ = reward(smooth(1e-3), np.array([[1e3, 0.0]], np.float32), RADIUS)
    assert gained[0] < 1e-12


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    miss = np.random.default_rng(5).normal(0.0, 0.06, (*shape, 2))
    weights = Reward(np.asarray(0.2), np.asarray(0.1), np.asarray(0.012))
    agree_in_jax(reward, weights, miss, np.asarray(0.06), rtol=1e-5, atol=1e-6)


def test_its_slope_is_that_of_the_logistic_function() -> None:
    import jax

    miss = np.array([0.05, 0.02], np.float32)
    weights = Reward(np.float32(0.2), np.float32(0.1), np.float32(0.012))
    slope = jax.grad(lambda each: reward(weights, each, RADIUS)[0])(miss)
    distance = np.hypot(*miss)
    likely = 1.0 / (1.0 + np.exp(-(0.06 - distance) / 0.012))
    expected = -(0.2 + 0.1 * likely * (1.0 - likely) / 0.012) * miss / distance
    assert_allclose(slope, expected, rtol=1e-4)

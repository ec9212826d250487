"""Slower and swaying targets, as trainings for any target meet them."""

import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from archerfish.targets.path import TIMES, at_pace
from archerfish.targets.variation import CHANCES, SLOWER, SWAYING, varied

ZERO = int(np.argmin(np.abs(TIMES)))


def test_at_half_the_pace_a_target_is_where_it_was_at_half_the_time() -> None:
    way = np.stack([np.sin(TIMES), 0.3 * TIMES**2], axis=-1)
    slow = at_pace(np.stack([way, way]), np.array([0.5, 1.0]))
    half = np.stack([np.sin(TIMES / 2.0), 0.3 * (TIMES / 2.0) ** 2], axis=-1)
    assert_allclose(slow, [half, way], atol=1e-4)
    assert_allclose(at_pace(way, np.asarray(0.5)), half, atol=1e-4)
    assert_allclose(slow[:, ZERO], 0.0, atol=1e-12)


def test_the_first_draw_says_which_targets_are_slower_and_which_sway() -> None:
    rng = np.random.default_rng(1)
    chance = rng.random((300, CHANCES))
    chance[:, 0] = np.linspace(0.0, 1.0, 300, endpoint=False)
    way = np.stack([0.0 * TIMES, TIMES], axis=-1) + np.zeros((300, 1, 1))
    found = varied(way, chance)
    slower, swaying = chance[:, 0] < SLOWER, chance[:, 0] >= 1.0 - SWAYING
    assert_allclose(found[~slower & ~swaying], way[~slower & ~swaying], atol=1e-12)
    pace = found[slower][:, -1, 1] / TIMES[-1]
    assert 0.1 <= pace.min() < 0.2
    assert 0.8 < pace.max() <= 1.0
    sway = np.linalg.norm(found - way, axis=-1)[swaying].max(axis=-1)
    assert 0.015 < sway.min() < 0.03
    assert 0.12 < sway.max() <= 0.15


def test_in_jax_it_is_the_same() -> None:
    rng = np.random.default_rng(2)
    chance, way = rng.random((5, CHANCES)).astype(np.float32), rng.random((5, len(TIMES), 2)).astype(np.float32)
    chance[:, 0] = [0.0, 0.1, 0.5, 0.9, 0.95]
    assert_allclose(varied(jnp.asarray(way), jnp.asarray(chance)), varied(way, chance), atol=1e-4)

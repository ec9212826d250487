import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from archerfish.controllers.network import OBSERVATION_CLIP, Layer, Normaliser, forward, normalise

RNG = np.random.default_rng(0)
SHAPES = [(), (3,), (2, 3)]


def layers(*sizes: int) -> tuple[Layer, ...]:
    pairs = itertools.pairwise(sizes)
    return tuple(Layer(RNG.standard_normal((a, b)), RNG.standard_normal(b)) for a, b in pairs)


def test_one_hidden_layer_by_hand() -> None:
    # Hidden: (1·1 + 2·(−1) + 0.5, 1·3 + 2·1 − 1) = (−0.5, 4), ReLU (0, 4); output: 0·7 + 4·0.5 + 1 = 3.
    network = (
        Layer(np.array([[1.0, 3.0], [-1.0, 1.0]]), np.array([0.5, -1.0])),
        Layer(np.array([[7.0], [0.5]]), np.array([1.0])),
    )
    assert forward(network, np.array([1.0, 2.0])) == pytest.approx([3.0])


def test_normalised_observations_have_zero_mean_and_unit_variance() -> None:
    observations = RNG.standard_normal((1000, 3)) * [0.1, 1.0, 30.0] + [5.0, 0.0, -7.0]
    normaliser = Normaliser(observations.mean(axis=0), observations.var(axis=0), np.asarray(1000.0))
    found = normalise(normaliser, observations)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(found.std(axis=0), 1.0, rtol=1e-5)


def test_a_number_never_met_in_training_is_clipped() -> None:
    normaliser = Normaliser(np.zeros(2), np.ones(2), np.asarray(1.0))
    np.testing.assert_array_equal(
        normalise(normaliser, np.array([1e9, -np.inf])), [OBSERVATION_CLIP, -OBSERVATION_CLIP]
    )


@pytest.mark.parametrize("shape", SHAPES)
def test_numpy_and_jax_agree(agree_in_jax: Callable[..., Any], shape: tuple[int, ...]) -> None:
    normaliser = Normaliser(RNG.standard_normal(5), RNG.random(5) + 0.1, np.asarray(10.0))
    observation = RNG.standard_normal((*shape, 5))
    normal = agree_in_jax(normalise, normaliser, observation, rtol=1e-5)
    assert agree_in_jax(forward, layers(5, 16, 2), normal, rtol=1e-4, atol=1e-5).shape == (*shape, 2)

import jax.numpy as jnp
import numpy as np

from archerfish.learning.normalisation import LEAST_VARIANCE, empty_normaliser, merge


def test_merged_batches_have_the_moments_of_all_their_observations() -> None:
    rng = np.random.default_rng(0)
    batches = [loc + rng.standard_normal((count, 3)) * [0.1, 1.0, 20.0] for loc, count in ((0, 4), (5, 100), (-2, 1))]
    normaliser = empty_normaliser(3)
    for batch in batches:
        normaliser = merge(normaliser, jnp.asarray(batch, jnp.float32))
    everything = np.concatenate(batches)
    np.testing.assert_allclose(normaliser.mean, everything.mean(axis=0), rtol=1e-5)
    np.testing.assert_allclose(normaliser.variance, everything.var(axis=0), rtol=1e-5)
    assert normaliser.count == len(everything)


def test_a_long_training_does_not_lose_the_moments_to_rounding() -> None:
    rng = np.random.default_rng(1)
    batches = 1000.0 + rng.standard_normal((300, 500, 1)).astype(np.float32)
    normaliser = empty_normaliser(1)
    for batch in batches:
        normaliser = merge(normaliser, jnp.asarray(batch))
    np.testing.assert_allclose(normaliser.mean, batches.mean(dtype=np.float64), rtol=1e-6)
    np.testing.assert_allclose(normaliser.variance, batches.var(dtype=np.float64), rtol=1e-3)


def test_what_hardly_varies_is_not_magnified_without_bound() -> None:
    normaliser = empty_normaliser(2)
    for _ in range(3):
        normaliser = merge(normaliser, jnp.asarray([[0.5, 1.0], [0.5, 3.0]]))
    np.testing.assert_allclose(normaliser.variance, [LEAST_VARIANCE, 1.0], rtol=1e-6)

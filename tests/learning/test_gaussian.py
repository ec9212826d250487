import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from archerfish.learning.gaussian import entropy, log_probability

LOG_STD = np.array([-1.0, 0.3])


def test_log_probability_is_scipys_of_a_normal_with_diagonal_covariance() -> None:
    rng = np.random.default_rng(0)
    action, mean = rng.standard_normal((2, 7, 2))
    reference = stats.norm.logpdf(action, mean, np.exp(LOG_STD)).sum(axis=-1)
    found = log_probability(jnp.asarray(action), jnp.asarray(mean), jnp.asarray(LOG_STD))
    np.testing.assert_allclose(found, reference, rtol=2e-5)


def test_entropy_is_scipys() -> None:
    reference = stats.multivariate_normal(cov=np.diag(np.exp(2 * LOG_STD))).entropy()
    assert float(entropy(jnp.asarray(LOG_STD))) == pytest.approx(reference, rel=1e-6)

"""The running mean and variance of the observations that a policy has met."""

import jax.numpy as jnp
from jax import Array

from archerfish.controllers.network import Normaliser

LEAST_VARIANCE = 1e-4
"""Of an observation, all of which are scaled to about one. What varies less is magnified no further: in float32 the
last bits of an angle would become a part of what the policy does, and no two libraries agree on those."""


def empty_normaliser(size: int) -> Normaliser:
    """Return the normaliser that has met nothing: it leaves observations of `size` numbers as they are."""
    return Normaliser(jnp.zeros(size), jnp.ones(size), jnp.float32(0))


def merge(normaliser: Normaliser, observations: Array) -> Normaliser:
    """Add a batch to the running mean and variance (Chan's parallel formula), which stays above `LEAST_VARIANCE`.

    Args:
      normaliser: of all earlier observations.
      observations: shape (B, n).
    """
    mean, variance, count = jnp.mean(observations, axis=0), jnp.var(observations, axis=0), observations.shape[0]
    total = normaliser.count + count
    share, shift = count / total, mean - normaliser.mean
    spread = (1 - share) * normaliser.variance + share * variance + share * (1 - share) * shift**2
    return Normaliser(normaliser.mean + share * shift, jnp.maximum(spread, LEAST_VARIANCE), total)

"""The running mean and variance of the observations that a policy has met."""

import jax
import jax.numpy as jnp
from jax import Array

from archerfish.controllers.network import Normaliser
from archerfish.learning.shards import averaged

LEAST_VARIANCE = 1e-4
"""Of an observation, all of which are scaled to about one. What varies less is magnified no further: in float32 the
last bits of an angle would become a part of what the policy does, and no two libraries agree on those."""


def empty_normaliser(size: int) -> Normaliser:
    """Return the normaliser that has met nothing: it leaves observations of `size` numbers as they are."""
    return Normaliser(jnp.zeros(size), jnp.ones(size), jnp.float32(0))


def merge(normaliser: Normaliser, observations: Array, axis: str | None = None) -> Normaliser:
    """Add a batch to the running mean and variance (Chan's parallel formula), which stays above `LEAST_VARIANCE`.

    Args:
      normaliser: of all earlier observations.
      observations: shape (B, n).
      axis: of the shards, each with a batch of its own.
    """
    mean = averaged(jnp.mean(observations, axis=0), axis)
    variance = averaged(jnp.mean((observations - mean[None, :]) ** 2, axis=0), axis)
    count = observations.shape[0] * (1 if axis is None else jax.lax.axis_size(axis))
    total = normaliser.count + count
    share, shift = count / total, mean - normaliser.mean
    spread = (1 - share) * normaliser.variance + share * variance + share * (1 - share) * shift**2
    return Normaliser(normaliser.mean + share * shift, jnp.maximum(spread, LEAST_VARIANCE), total)

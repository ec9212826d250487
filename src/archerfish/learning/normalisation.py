"""The running mean and variance of the observations that a policy has met."""

import jax
import jax.numpy as jnp
from jax import Array

from archerfish.controllers.network import Normaliser
from archerfish.learning.shards import averaged


def empty_normaliser(size: int) -> Normaliser:
    """Return the normaliser that has met nothing: it leaves observations of `size` numbers as they are."""
    return Normaliser(jnp.zeros(size), jnp.ones(size), jnp.float32(0))


def merge(normaliser: Normaliser, observations: Array, axis: str | None = None) -> Normaliser:
    """Add a batch to the running mean and variance (Chan's parallel formula).

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
    return Normaliser(normaliser.mean + share * shift, spread, total)

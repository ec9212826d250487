"""The diagonal normal distribution of the actions."""

import math

import jax.numpy as jnp
from jax import Array

from archerfish.dynamics.array_namespace import lift


def log_probability(action: Array, mean: Array, log_std: Array) -> Array:
    """Return the logarithm of the density of an action.

    Args:
      action: shape B + (n,).
      mean: shape B + (n,).
      log_std: logarithms of the standard deviations, shape (n,).

    Returns:
      Shape B.
    """
    log_std = lift(log_std, action)
    scaled = (action - mean) * jnp.exp(-log_std)
    return jnp.sum(-0.5 * scaled**2 - log_std - 0.5 * math.log(2.0 * math.pi), axis=-1)


def entropy(log_std: Array) -> Array:
    """Return the entropy of the distribution [nat], shape (n,) → ()."""
    return jnp.sum(log_std + 0.5 * (1.0 + math.log(2.0 * math.pi)), axis=-1)

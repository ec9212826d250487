"""The diagonal normal distribution of the actions."""

import math

import jax.numpy as jnp
from jax import Array


def log_probability(action: Array, mean: Array, log_std: Array) -> Array:
    """Logarithm of the density of an action, shape B + (n,) → B."""
    scaled = (action - mean) * jnp.exp(-log_std)
    return jnp.sum(-0.5 * scaled**2 - log_std - 0.5 * math.log(2.0 * math.pi), axis=-1)


def entropy(log_std: Array) -> Array:
    """Entropy of the distribution [nat], shape (n,) → ()."""
    return jnp.sum(log_std + 0.5 * (1.0 + math.log(2.0 * math.pi)), axis=-1)

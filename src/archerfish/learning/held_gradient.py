"""A bound on what comes back through time, for each engagement by itself.

Where a gimbal may only be asked what it can follow, a small change of what the policy sees may grow from decision to
decision, and so does the gradient on its way back: by orders of magnitude in the few engagements that hang on a hair,
which then drown all others. To scale the sum, as is done with the whole gradient, is too late for these others.
"""

import jax
import jax.numpy as jnp
from jax import Array


@jax.custom_vjp
def held(rows: Array, limit: Array) -> Array:  # noqa: ARG001 (is for the way back)
    """Return an array as it is, but scale the gradient that comes back through it.

    Args:
      rows: shape (B, n).
      limit: largest norm of what comes back to a row, shape ().
    """
    return rows


def _forward(rows: Array, limit: Array) -> tuple[Array, Array]:
    return rows, limit


def _backward(limit: Array, gradient: Array) -> tuple[Array, Array]:
    norm = jnp.sqrt(jnp.sum(gradient**2, axis=-1, keepdims=True))
    return gradient * jnp.where(norm > limit, limit / norm, 1.0), jnp.zeros_like(limit)


held.defvjp(_forward, _backward)

"""A bound on what comes back through time, for each engagement by itself.

Where a gimbal may only be asked what it can follow, small changes of an early command may grow from decision to
decision, and so does the gradient on its way back: by orders of magnitude in the few engagements that hang on a hair,
which then drown all others. To scale the sum, as is done with the whole gradient, is too late for these others.
"""

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

Tree = TypeVar("Tree")


@jax.custom_vjp
def held(tree: Tree, limit: Array) -> Tree:  # noqa: ARG001 (is for the way back)
    """Return a tree as it is, but scale the gradient that comes back through it.

    Args:
      tree: arrays of shape (B, ...).
      limit: largest norm of what comes back to the numbers of one of the B rows, shape ().
    """
    return tree


def _forward(tree: Tree, limit: Array) -> tuple[Tree, Array]:
    return tree, limit


def _backward(limit: Array, gradient: Any) -> tuple[Any, Array]:
    moving = [each for each in jax.tree.leaves(gradient) if each.dtype != jax.dtypes.float0]
    norm = jnp.sqrt(sum(jnp.sum(each.reshape(each.shape[0], -1) ** 2, axis=-1) for each in moving))
    factor = jnp.where(norm > limit, limit / norm, 1.0)

    def scaled(each: Any) -> Any:
        # Whole numbers have no gradient.
        return each if each.dtype == jax.dtypes.float0 else each * factor.reshape(-1, *[1] * (each.ndim - 1))

    return jax.tree.map(scaled, gradient), jnp.zeros_like(limit)


held.defvjp(_forward, _backward)

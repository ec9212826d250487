"""How a batch is dealt into minibatches."""

import jax
import jax.numpy as jnp
from jax import Array


def shuffled_minibatches(key: Array, rows: int, epochs: int, parts: int) -> Array:
    """Deal the rows of a batch into equal parts, in a new order for every epoch.

    Random bits with the row's number in the lowest places, sorted: one sort of plain integers, nine times as fast on
    a CPU as `jax.random.permutation`, which a fifth of a training went into. Rows whose random bits agree stay in
    order; with 18 random bits beside the number of 12,800 rows that happens to one pair in 260,000.

    Args:
      key: PRNG key; is consumed.
      rows: of the batch, a multiple of `parts`.
      epochs: passes over the batch.
      parts: minibatches per epoch.

    Returns:
      Row numbers, shape (epochs, parts, rows / parts).
    """
    places = (rows - 1).bit_length()
    numbers = jnp.arange(rows, dtype=jnp.uint32)[None, :]
    tagged = jax.random.bits(key, (epochs, rows)) >> places << places | numbers
    orders: Array = jnp.sort(tagged, axis=-1) & (2**places - 1)
    return orders.reshape(epochs, parts, rows // parts)

"""The random numbers of seeded engagements: each environment has a stream of its own, whoever else runs beside it.

So one environment alone and the same among thousands meet the same targets and the same dispersion.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

BLOCK = 64
"""Steps whose numbers are drawn in one call: drawing for each step by itself would cost more than the step."""


class Draws(NamedTuple):
    """Numbers of a block of steps in B environments."""

    normals: Array
    """Standard normals, shape (BLOCK, B, normals)."""
    uniforms: Array
    """Uniform in [0, 1), shape (BLOCK, B, uniforms)."""


class DrawStream(NamedTuple):
    """Where the streams of B environments stand."""

    keys: Array
    """PRNG keys, shape (B,)."""
    sizes: tuple[int, int]
    """Normals and uniforms per step."""
    position: int
    """Steps so far."""
    draws: Draws
    """Of the block that the position lies in, shape (BLOCK, B, ...)."""

    @property
    def place(self) -> int:
        """The position within the block."""
        return self.position % BLOCK


def begin_stream(seeds: Sequence[int], normals: int, uniforms: int) -> DrawStream:
    """Begin the streams of B environments.

    Args:
      seeds: one per environment, each at least 0.
      normals: per step.
      uniforms: per step.
    """
    words = np.stack([np.random.SeedSequence(seed).generate_state(2) for seed in seeds])
    # Named, so that another default of JAX does not change what a seed means.
    keys = jax.random.wrap_key_data(jnp.asarray(words), impl="threefry2x32")
    return DrawStream(keys, (normals, uniforms), 0, _block(keys, 0, normals, uniforms))


def following(stream: DrawStream) -> DrawStream:
    """Return the streams one step on."""
    position = stream.position + 1
    draws = stream.draws if position % BLOCK else _block(stream.keys, position // BLOCK, *stream.sizes)
    return stream._replace(position=position, draws=draws)


@partial(jax.jit, static_argnames=("normals", "uniforms"))
def _block(keys: Array, number: int, normals: int, uniforms: int) -> Draws:
    def of_one(key: Array) -> tuple[Array, Array]:
        first, second = jax.random.split(jax.random.fold_in(key, number))
        return jax.random.normal(first, (BLOCK, normals)), jax.random.uniform(second, (BLOCK, uniforms))

    return Draws(*jax.vmap(of_one, out_axes=1)(keys))

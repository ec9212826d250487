"""A tree of arrays as two vectors, so that calling a compiled program costs as little as its few arguments.

Handing over sixty small arrays takes longer than one decision of one engagement.
"""

import math
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array


class Packing(NamedTuple):
    """How to rebuild a tree; it can be hashed, so it may be a static argument of a compiled function."""

    structure: Any
    """The tree without its arrays."""
    shapes: tuple[tuple[int, ...], ...]
    """Of its arrays."""
    kinds: tuple[str, ...]
    """Of each: "f" for float32, "i" for int32, "b" for bool."""


def packing_of(tree: Any) -> Packing:
    """Return how a tree of float32, int32 and bool arrays is packed."""
    leaves, structure = jax.tree.flatten(tree)
    return Packing(structure, tuple(each.shape for each in leaves), tuple(each.dtype.kind for each in leaves))


def pack(tree: Any) -> tuple[Array, Array]:
    """Return the floats and the integers of a tree as two vectors, shapes (F,) and (I,)."""
    leaves = [jnp.asarray(each) for each in jax.tree.leaves(tree)]
    floats = [each.reshape(-1) for each in leaves if each.dtype.kind == "f"]
    others = [each.reshape(-1).astype(jnp.int32) for each in leaves if each.dtype.kind != "f"]
    return _joined(floats, jnp.float32), _joined(others, jnp.int32)


def unpack(packing: Packing, floats: Array, integers: Array) -> Any:
    """Return the tree of two vectors.

    Args:
      packing: of the tree.
      floats: shape (F,).
      integers: shape (I,).
    """
    sizes = [math.prod(shape) for shape in packing.shapes]
    arrays = dict[int, Array]()
    for is_float, vector in ((True, floats), (False, integers)):
        places = [place for place, kind in enumerate(packing.kinds) if (kind == "f") == is_float]
        edges = accumulate((sizes[place] for place in places), initial=0)
        for place, (start, end) in zip(places, pairwise(edges), strict=True):
            array = vector[start:end].reshape(packing.shapes[place])
            arrays[place] = array.astype(bool) if packing.kinds[place] == "b" else array
    return jax.tree.unflatten(packing.structure, [arrays[place] for place in range(len(sizes))])


def _joined(vectors: list[Array], dtype: Any) -> Array:
    return jnp.concatenate(vectors) if vectors else jnp.zeros(0, dtype)

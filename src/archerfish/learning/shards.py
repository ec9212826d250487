"""A training split into shards: each acts in environments of its own, and their gradients are averaged.

The products of a gradient step are too small for two cores to share one well; two halves of a minibatch, each on a core
of its own, keep both busy. The number of shards belongs to a training's settings, as it decides how environments and
minibatches are dealt. Where they run does not: on a device each if there are enough, else side by side on one.
"""

import contextlib
import os
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.sharding import Mesh, NamedSharding, PartitionSpec

AXIS = "shard"
"""Name of the axis that the shards lie along."""
Tree = TypeVar("Tree")
_lax: Any = lax


def claim_devices(count: int) -> int:
    """Have JAX make so many devices out of the processor; changes nothing once JAX has begun to compute.

    Args:
      count: of shards.

    Returns:
      Devices that a training in so many shards has: as many, or one, which decides its last bits.
    """
    # Where the user has said how many, that is it.
    if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
        configure: Any = jax.config
        with contextlib.suppress(RuntimeError):  # computing already: the shards share what there is
            configure.update("jax_num_cpu_devices", max(count, configure.jax_num_cpu_devices))
    return count if _have_devices(count) else 1


def _have_devices(count: int) -> bool:
    return len(jax.devices()) >= count


def placed(tree: Tree, count: int, split: Any) -> Tree:
    """Put arrays where `over_shards` leaves them, so that the first call and the ones after it are one program.

    Args:
      tree: arrays, any shapes.
      count: of shards.
      split: whether each is split along its leading dimension, or a tree of that.
    """
    if not _have_devices(count):
        return tree
    mesh = _mesh(count)

    def put(is_split: bool, part: Any) -> Any:
        # What is split comes from NumPy: JAX would compile a program for each shape to split what is on a device.
        part = jax.tree.map(np.asarray, part) if is_split else part
        # JAX leaves empty arrays whole.
        places = jax.tree.map(lambda each: NamedSharding(mesh, _partition(is_split and each.size > 0)), part)
        return jax.device_put(part, places)

    there: Tree = jax.tree.map(put, split, tree)
    return there


def _mesh(count: int) -> Mesh:
    return Mesh(np.array(jax.devices()[:count]), (AXIS,))


def _partition(is_split: bool) -> Any:
    place: Any = PartitionSpec
    return place(AXIS) if is_split else place()


def over_shards(function: Callable[..., Any], count: int, split: Any, given: Any) -> Callable[..., Any]:
    """Run a function once per shard, with the shard's part of what is split and the whole of everything else.

    What it returns and is not split must be the same in all shards: made from averages, or of nothing that is split.

    Args:
      function: runs with the axis `AXIS`.
      count: of shards; divides the leading dimension of all that is split.
      split: for each argument whether it is split along its leading dimension, or a tree of that.
      given: the same of what it returns.
    """
    if _have_devices(count):
        places, specs = (jax.tree.map(_partition, each) for each in (split, given))
        mapped: Callable[..., Any] = jax.shard_map(
            function, mesh=_mesh(count), in_specs=places, out_specs=specs, check_vma=False
        )
        return mapped

    def axes(splits: Any) -> Any:
        return jax.tree.map(lambda each: 0 if each else None, splits)

    def stacked(is_split: bool, tree: Any) -> Any:
        return jax.tree.map(lambda e: e.reshape(count, len(e) // count, *e.shape[1:]), tree) if is_split else tree

    def joined(is_split: bool, tree: Any) -> Any:
        return jax.tree.map(lambda e: e.reshape(count * e.shape[1], *e.shape[2:]), tree) if is_split else tree

    batched = jax.vmap(function, in_axes=axes(split), out_axes=axes(given), axis_name=AXIS, axis_size=count)
    return lambda *arguments: jax.tree.map(joined, given, batched(*jax.tree.map(stacked, split, arguments)))


def own_key(key: Array) -> Array:
    """Return a shard's own PRNG key, shape (), from one that all share."""
    return jax.random.fold_in(key, lax.axis_index(AXIS))


def averaged(tree: Tree) -> Tree:
    """Average arrays over the shards, any shapes."""
    leaves, structure = jax.tree.flatten(tree)
    # One message for all: what an exchange costs hardly depends on its size.
    together: Array = _lax.pmean(jnp.concatenate([jnp.ravel(each) for each in leaves]), AXIS)
    ends = np.cumsum([each.size for each in leaves])[:-1]
    parts = zip(jnp.split(together, ends), leaves, strict=True)
    means: Tree = jax.tree.unflatten(structure, [part.reshape(each.shape) for part, each in parts])
    return means


def largest(array: Array) -> Array:
    """Return the largest over the shards, any shape; infinity where one is not a number."""
    found: Array = _lax.pmax(jnp.where(jnp.isnan(array), jnp.inf, array), AXIS)
    return found

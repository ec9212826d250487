"""A training split into shards: each acts in environments of its own, and what they learn is averaged.

The products of a gradient step are too small for two cores to share one well; two halves of a minibatch, each on a core
of its own, keep both busy. The number of shards belongs to a training's settings, as it decides how environments and
minibatches are dealt. Where they run does not: on a device each if there are enough, else side by side on one.
"""

import os
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh, PartitionSpec

AXIS = "shard"
"""Name of the axis that the shards lie along."""
Tree = TypeVar("Tree")


def claim_devices(count: int) -> None:
    """Have JAX make so many devices out of the processor; does nothing once JAX has begun to compute.

    Args:
      count: of devices.
    """
    if "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", ""):
        return  # the user has said how many
    configure: Any = jax.config
    try:
        configure.update("jax_num_cpu_devices", max(count, configure.jax_num_cpu_devices))
    except RuntimeError:  # computing already: the shards share what there is
        return


def over_shards(function: Callable[..., Any], count: int, split: Any, given: Any) -> Callable[..., Any]:
    """Let a function run once per shard, with the shard's part of what is split and the whole of everything else.

    What it returns and is not split must be the same in all shards: made from averages, or of nothing that is split.

    Args:
      function: runs with the axis `AXIS`.
      count: of shards; divides the leading dimension of all that is split.
      split: for each argument whether it is split along its leading dimension, or a tree of that.
      given: the same of what it returns.
    """
    if len(jax.devices()) >= count:
        mesh = Mesh(np.array(jax.devices()[:count]), (AXIS,))
        place: Any = PartitionSpec

        def places(splits: Any) -> Any:
            return jax.tree.map(lambda each: place(AXIS) if each else place(), splits)

        sharded: Callable[..., Any] = jax.shard_map(
            function, mesh=mesh, in_specs=places(split), out_specs=places(given), check_vma=False
        )
        return sharded
    return _side_by_side(function, count, split, given)


def _side_by_side(function: Callable[..., Any], count: int, split: Any, given: Any) -> Callable[..., Any]:
    def axes(splits: Any) -> Any:
        return jax.tree.map(lambda each: 0 if each else None, splits)

    def stacked(is_split: bool, tree: Any) -> Any:
        return jax.tree.map(lambda each: each.reshape(count, -1, *each.shape[1:]), tree) if is_split else tree

    def joined(is_split: bool, tree: Any) -> Any:
        return jax.tree.map(lambda each: each.reshape(-1, *each.shape[2:]), tree) if is_split else tree

    mapped = jax.vmap(function, in_axes=axes(split), out_axes=axes(given), axis_name=AXIS, axis_size=count)

    def run(*arguments: Any) -> Any:
        return jax.tree.map(joined, given, mapped(*jax.tree.map(stacked, split, arguments)))

    return run


def own_key(key: Array) -> Array:
    """Return a shard's own PRNG key, from one that all share."""
    return jax.random.fold_in(key, jax.lax.axis_index(AXIS))


def averaged(tree: Tree, axis: str | None) -> Tree:
    """Average arrays over the shards, any shapes; without an axis there is but one."""
    if axis is None:
        return tree
    leaves, structure = jax.tree.flatten(tree)
    # One message for all: what a meeting of the shards costs hardly depends on how much is said.
    lax: Any = jax.lax
    together: Array = lax.pmean(jnp.concatenate([jnp.ravel(each) for each in leaves]), axis)
    ends = np.cumsum([each.size for each in leaves])[:-1]
    parts = zip(jnp.split(together, ends), leaves, strict=True)
    means: Tree = jax.tree.unflatten(structure, [part.reshape(each.shape) for part, each in parts])
    return means


def worst(fault: Array) -> Array:
    """Return the largest number of all shards, any shape."""
    lax: Any = jax.lax
    largest: Array = lax.pmax(fault, AXIS)
    return largest

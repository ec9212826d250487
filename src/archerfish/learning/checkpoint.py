"""A training's state on disk: arrays in safetensors, facts in JSON, whole or not at all."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from archerfish.learning.ppo import Metrics
from archerfish.learning.training import Standing
from archerfish.records import storage
from archerfish.records.errors import file_error

SCHEMA = "archerfish.checkpoint/1"
_CURVE = "curve."


def write_checkpoint(path: Path, learner: Any, facts: dict[str, Any]) -> None:
    """Write a learner.

    Args:
      path: JSON file; the arrays go beside it.
      learner: everything that training needs to go on, the random key included: a tree of arrays.
      facts: configuration and provenance.
    """
    storage.write_record(path, SCHEMA, facts, learner_arrays(learner))


def read_checkpoint(path: Path, like: Any) -> tuple[Any, dict[str, Any]]:
    """Read a learner back, bit for bit.

    Args:
      path: JSON file of the checkpoint.
      like: a learner of the same configuration, for the structure.

    Raises:
      InputError: if the checkpoint is damaged or of another configuration.
    """
    facts, arrays = storage.read_record(path, SCHEMA)
    return restore_learner(path, arrays, like), facts


def standing_arrays(standing: Standing) -> dict[str, NDArray[Any]]:
    """Return the arrays of a learner and of all that was measured on the way to it, any shapes."""
    curve = {f"{_CURVE}{name}": np.asarray(array) for name, array in standing.metrics._asdict().items()}
    return learner_arrays(standing.learner) | curve


def restore_standing(path: Path, arrays: dict[str, NDArray[Any]], like: Any) -> Standing:
    """Build a standing from the arrays of any shapes that `standing_arrays` returned.

    Args:
      path: where they were read, for errors.
      arrays: name → array.
      like: a learner of the same configuration, for the structure.

    Raises:
      InputError: if an array is missing or of another shape.
    """
    missing = [name for name in Metrics._fields if f"{_CURVE}{name}" not in arrays]
    if missing:
        raise file_error(path, f"holds no {missing[0]} of the iterations so far", "begin the training anew")
    measured: dict[str, Any] = {name: arrays[f"{_CURVE}{name}"] for name in Metrics._fields}
    metrics = Metrics(**measured)
    return Standing(restore_learner(path, arrays, like), (metrics,))


def learner_arrays(learner: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of a tree by the way to each, any shapes; PRNG keys as the numbers that make them up."""
    return {name: np.asarray(_plain(leaf)) for name, leaf in _named(learner)}


def restore_learner(path: Path, arrays: dict[str, NDArray[Any]], like: Any) -> Any:
    """Build a learner from its arrays of any shapes.

    Args:
      path: where they were read, for errors.
      arrays: name → array.
      like: a learner of the same configuration, for the structure.

    Raises:
      InputError: if an array is missing or of another shape.
    """
    leaves = []
    for name, expected in _named(like):
        plain, found = np.asarray(_plain(expected)), arrays.get(name)
        if found is None or found.shape != plain.shape or found.dtype != plain.dtype:
            shape = None if found is None else found.shape
            raise file_error(
                path,
                f'array "{name}" is {shape}, expected {plain.shape}',
                "go on with the configuration it was made with",
            )
        restored = jax.numpy.asarray(found)
        leaves.append(jax.random.wrap_key_data(restored) if _is_key(expected) else restored)
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


def _is_key(leaf: Any) -> bool:
    return bool(jax.numpy.issubdtype(leaf.dtype, jax.dtypes.prng_key))


def _plain(leaf: Any) -> Any:
    return jax.random.key_data(leaf) if _is_key(leaf) else leaf


def _named(tree: Any) -> list[tuple[str, Any]]:
    return [(jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(tree)]

"""A training's state on disk: arrays in safetensors, facts in JSON, whole or not at all."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax import Array

from archerfish.learning.ppo import Learner
from archerfish.records import storage
from archerfish.records.errors import file_error

SCHEMA = "archerfish.checkpoint/1"


def write_checkpoint(path: Path, learner: Learner, facts: dict[str, Any]) -> None:
    """Write a learner.

    Args:
      path: JSON file; the arrays go beside it.
      learner: everything that training needs to go on, the random key included.
      facts: configuration and provenance.
    """
    arrays = {name: np.asarray(array) for name, array in _named(_plain(learner))}
    storage.write_record(path, SCHEMA, facts, arrays)


def read_checkpoint(path: Path, like: Learner) -> tuple[Learner, dict[str, Any]]:
    """Read a learner back, bit for bit.

    Args:
      path: JSON file of the checkpoint.
      like: a learner of the same configuration, for the structure.

    Raises:
      InputError: if the checkpoint is damaged or of another configuration.
    """
    facts, arrays = storage.read_record(path, SCHEMA)
    plain = _plain(like)
    for name, array in _named(plain):
        found = arrays.get(name)
        if found is None or found.shape != array.shape or found.dtype != np.asarray(array).dtype:
            shape = None if found is None else found.shape
            raise file_error(
                path,
                f'array "{name}" is {shape}, expected {array.shape}',
                "go on with the configuration it was made with",
            )
    leaves = [jax.numpy.asarray(arrays[name]) for name, _ in _named(plain)]
    restored: Learner = jax.tree.unflatten(jax.tree.structure(plain), leaves)
    return restored._replace(key=jax.random.wrap_key_data(restored.key)), facts


def _plain(learner: Learner) -> Learner:
    return learner._replace(key=jax.random.key_data(learner.key))


def _named(tree: Any) -> list[tuple[str, Array]]:
    return [(jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(tree)]

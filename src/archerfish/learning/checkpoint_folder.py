"""The checkpoints of a training in progress: the last two of them, whole at every moment, and the newest that is sound.

A checkpoint never overwrites another one: its name is its iteration. The arrays are written first, then the JSON that
holds their hash: before that is in place there is no such checkpoint, after it there is. Needs no JAX.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.storage import Arrays

SCHEMA = "archerfish.training/1"
KEPT = 2
"""Checkpoints that stay: the one before the last is there for a last one that is damaged."""
_DAMAGED = ".damaged"


class Checkpoint(NamedTuple):
    """A checkpoint as read."""

    path: Path
    """Its JSON file."""
    iteration: int
    """Iterations done."""
    facts: dict[str, Any]
    """As they were given."""
    arrays: Arrays
    """As they were given, any shapes."""
    damaged: tuple[str, ...] = ()
    """What is wrong with each newer one, in one line."""


def add_checkpoint(folder: Path, iteration: int, facts: Mapping[str, Any], arrays: Arrays) -> None:
    """Write a checkpoint and remove those that are no longer needed.

    Args:
      folder: is made if missing.
      iteration: iterations done.
      facts: what JSON can hold.
      arrays: name → array, any shapes.

    Raises:
      InputError: if it can't be written; the ones before are as they were.
    """
    told = {"iteration": iteration, **facts}
    path = folder / f"{iteration:09d}.json"
    storage.write_record(path, SCHEMA, {"facts_sha256": _hash(told), **told}, arrays)
    for old in checkpoint_files(folder)[:-KEPT]:
        _remove(old)


def checkpoint_files(folder: Path) -> list[Path]:
    """Return the JSON files of the checkpoints in a folder, oldest first."""
    return sorted(folder.glob("[0-9]*.json"))


def newest_checkpoint(folder: Path) -> Checkpoint | None:
    """Read the newest checkpoint that is sound; damaged ones are renamed, and what a killed writer left is removed.

    Returns:
      None where no checkpoint was written yet.

    Raises:
      InputError: if there are checkpoints, and all are damaged.
    """
    files, damaged = checkpoint_files(folder), []
    for path in reversed(files):
        try:
            checkpoint = _read(path)
        except InputError as error:
            damaged.append((path, str(error)))
            continue
        for bad, _ in damaged:
            _set_aside(bad)
        _remove_remains(folder)
        return checkpoint._replace(damaged=tuple(told for _, told in damaged))
    if damaged:
        raise file_error(
            folder, f"no checkpoint is sound ({damaged[0][1]})", "delete that folder to train again from the beginning"
        )
    _remove_remains(folder)
    return None


def _read(path: Path) -> Checkpoint:
    facts, arrays = storage.read_record(path, SCHEMA)
    told = {name: value for name, value in facts.items() if name not in ("schema", "arrays_sha256", "facts_sha256")}
    if facts.get("facts_sha256") != _hash(told):
        raise file_error(path, "is not as it was written", "use the checkpoint before it")
    return Checkpoint(path, storage.field(path, told, "iteration", int), told, arrays)


def _hash(facts: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _remove(path: Path) -> None:
    # Without its JSON there is no checkpoint: arrays alone are never taken for one.
    path.unlink(missing_ok=True)
    path.with_suffix(".safetensors").unlink(missing_ok=True)


def _set_aside(path: Path) -> None:
    for each in (path, path.with_suffix(".safetensors")):
        if each.exists():
            each.replace(each.with_name(each.name + _DAMAGED))


def _remove_remains(folder: Path) -> None:
    for path in folder.glob("[0-9]*.safetensors"):
        if not path.with_suffix(".json").exists():
            path.unlink()
    for path in folder.glob(".unfinished-*"):
        path.unlink()

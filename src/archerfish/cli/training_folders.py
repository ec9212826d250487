"""What trainings leave in the folders of a run; only files that a training makes are removed."""

import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from archerfish.cli.run_lock import NAME as LOCK
from archerfish.cli.run_lock import is_lock
from archerfish.cli.training_log import EVENTS
from archerfish.cli.writer import Writer
from archerfish.cli.written_files import find_written
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.unfinished import unfinished_name

UNFINISHED = "unfinished"
"""Folder in a run folder for a training in progress."""
DIVERGED = "diverged"
"""Folder in a run folder for a training that met a number that is not finite."""
CONFIGURATION = "config.json"
FAULT = "fault.json"
CHECKPOINTS = "checkpoints"
INPUTS = "inputs"
RESULTS = "results"
"""What is finished and not yet in place."""
REPLACED = "replaced"
"""What results take the place of, until all of them are in place."""

_ROLES = "pitch|yaw|muzzle|sensing|limits"
_RESULT = (
    r"policy\.json|policy\.safetensors|checkpoint\.json|checkpoint\.safetensors|log\.jsonl|curve\.svg|config\.json"
)
_HIDDEN = r"\.unfinished-[0-9a-f]{12}|\.[^/]+\.safetensors\.before"
"""What a process leaves that is killed while it writes a file."""
_FOLDERS = re.compile(rf"{CHECKPOINTS}|{INPUTS}(/({_ROLES}))?|{RESULTS}(/{EVENTS})?|{REPLACED}|{EVENTS}")
_FILES = re.compile(
    rf"({RESULTS}/)?({_RESULT})|{re.escape(LOCK)}|{re.escape(FAULT)}|{CHECKPOINTS}/\d{{9}}\.(json|safetensors)(\.damaged)?"
    rf"|{INPUTS}/({_ROLES})/[^/]+|{REPLACED}/\d+|({RESULTS}/)?{EVENTS}/events\.[^/]+|(({_FOLDERS.pattern})/)?({_HIDDEN})"
)
_SETTINGS = ("setting", "ppo", "provenance")
"""Objects that the configuration of every training holds."""
_FAULT_FACTS = {"iteration", "first_not_finite", "message"}


def check_unfinished(folder: Path) -> None:
    """Refuse a folder for a training in progress that holds something else than what such a training leaves.

    Raises:
      InputError: naming what is there.
    """
    _check_names(folder)
    path = folder / CONFIGURATION
    if path.is_file():
        facts = _facts(path)
        if not all(isinstance(facts.get(name), dict) for name in _SETTINGS):
            raise file_error(
                path, "is not the configuration of a training", f"choose another --out, or move {folder} away"
            )
    elif any(folder.glob("*")) and not is_lock(folder / LOCK):
        # A training that was killed before its configuration was written, or after it was removed.
        raise file_error(folder, "holds files that no training left there", "choose another --out, or move them away")


def check_diverged(folder: Path) -> None:
    """Refuse a folder for a training that diverged that holds something else than what such a training leaves.

    Raises:
      InputError: naming what is there.
    """
    _check_names(folder)
    if any(folder.glob("*")) and not _facts(folder / FAULT).keys() >= _FAULT_FACTS:
        raise file_error(folder, "holds files that no training left there", "choose another --out, or move them away")


def check_events(folder: Path, writer: Writer) -> None:
    """Refuse a folder for TensorBoard's files that holds others than those that this command wrote.

    Raises:
      InputError: naming what is there.
    """
    for path in sorted(folder.rglob("*")):
        if not (path.is_file() and path.name.startswith("events.") and not path.is_symlink()):
            raise _not_left(folder, path)
        if not writer.overwrite and find_written(path) != (writer.command, True):
            problem = f"holds files that no training left there, such as {path.relative_to(folder)}"
            remedy = "choose another --out, move them away, or pass --overwrite to replace TensorBoard's files"
            raise file_error(folder, problem, remedy)


def remove_training(folder: Path) -> bool:
    """Remove a folder of a training, and return whether all of it was the training's.

    A process that is killed meanwhile leaves no half of it under its name. What others put there stays, in its place.
    """
    if next(_others(folder), None) is not None:
        remove_files(folder)
        return False
    with suppress(OSError):
        folder = folder.replace(folder.with_name(unfinished_name()))
    shutil.rmtree(folder, ignore_errors=True)
    return True


def remove_files(folder: Path, *, but: str = "") -> None:
    """Remove what a training left in its folder.

    Args:
      folder: exists.
      but: name of the file that stays.
    """
    others = set(_others(folder))
    # What is inside comes before its folder.
    for path in sorted(folder.rglob("*"), reverse=True):
        if path not in others and path.name != but:
            with suppress(OSError):  # a folder that holds something else
                path.rmdir() if path.is_dir() else path.unlink()


def _check_names(folder: Path) -> None:
    other = next(_others(folder), None)
    if other is not None:
        raise _not_left(folder, other)


def _not_left(folder: Path, other: Path) -> InputError:
    problem = f"holds files that no training left there, such as {other.relative_to(folder)}"
    return file_error(folder, problem, "choose another --out, or move them away")


def _others(folder: Path) -> Iterator[Path]:
    """Yield what is in the folder of a training, and no training makes."""
    for path in sorted(folder.rglob("*")):
        name, mode = path.relative_to(folder).as_posix(), path.lstat().st_mode
        is_own = _FOLDERS.fullmatch(name) if stat.S_ISDIR(mode) else stat.S_ISREG(mode) and _FILES.fullmatch(name)
        if not is_own:
            yield path


def _facts(path: Path) -> dict[str, Any]:
    try:
        facts = storage.read_json(path)
    except InputError:
        return {}
    return facts if isinstance(facts, dict) else {}

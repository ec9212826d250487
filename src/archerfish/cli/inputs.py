"""The files that a command reads, found in its options: no command may write over them."""

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from archerfish.records.log_files import log_parts

WRITTEN = ("out", "json", "export", "resume")
"""Options that name what a command writes."""
FILE_WORDS = ("plant", "motion", "controllers", "robot", "on", "changed", "target", "vary")
"""Options whose words may name files: FILE, FOLDER, FILE.py:NAME, records=FOLDER,FOLDER."""
FOLDER_WORDS = ("plant", "vary")
"""Those of them that may name the folder of a robot."""
OF_ROBOT = ("pitch", "yaw", "muzzle", "sensing", "limits")
"""Records that are read in the folder of a robot."""
OF_RUN = ("policy", "config", "results")
"""Records that are read in a run folder."""


def read_files(command: Any) -> tuple[Path, ...]:
    """Return the files that a command reads, as far as its options name them.

    Args:
      command: its options, a dataclass.
    """
    return tuple(dict.fromkeys(_named(command)))


def _named(value: Any, name: str = "") -> Iterator[Path]:
    """Yield the files that an option names."""
    if is_dataclass(value):
        for each in fields(value):
            if each.name not in WRITTEN:
                yield from _named(getattr(value, each.name), each.name)
    elif isinstance(value, (tuple, list)):
        for each in value:
            yield from _named(each, name)
    elif isinstance(value, Path):
        yield from _log_or_run(value) if value.is_dir() else _record(value)
    elif isinstance(value, str) and name in FILE_WORDS:
        # Only --vary takes lists, NAME=VALUE,VALUE; elsewhere a path may hold both signs.
        for word in filter(None, re.split("[=,]", value) if name == "vary" else [value]):
            yield from _of_word(Path(word), name)
            yield from _record(Path(word.rpartition(":")[0]))


def _of_word(path: Path, name: str) -> Iterator[Path]:
    if path.is_dir() and name in FOLDER_WORDS:
        yield from (part for each in OF_ROBOT for part in _record(path / f"{each}.json"))
    else:
        yield from _record(path)


def _log_or_run(folder: Path) -> Iterator[Path]:
    if (folder / "metadata.yaml").is_file():
        yield from log_parts(folder)
    for name in OF_RUN:
        yield from _record(folder / f"{name}.json")


def _record(path: Path) -> Iterator[Path]:
    """Yield a file and what is read with it."""
    if path.is_file():
        yield path
        if path.suffix == ".json":
            yield path.with_suffix(".safetensors")
        if path.name == "policy.json":
            # It says for which robot the policy was trained.
            yield path.with_name("config.json")

"""Which command wrote what: a list in each output folder, so that no command replaces what another one wrote.

The list `.archerfish.json` names the command and the SHA-256 of every file that was put into its folder. A file that
was edited or exchanged since is no longer the output of a command.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from archerfish.records import storage
from archerfish.records.errors import InputError

NAME = ".archerfish.json"
SCHEMA = "archerfish.written/1"
JSON = "--json"
"""Who wrote a file that --json named, whichever command it was given to."""


class Written(NamedTuple):
    """What is known of a file."""

    command: str
    """Name of the command that wrote it."""
    is_unchanged: bool
    """Whether it is as it was written."""


def find_written(path: Path) -> Written | None:
    """Return which command wrote a file, None if no list names it.

    Args:
      path: of a regular file; the lists of all folders above it are looked at, the nearest first.
    """
    place = path.parent.resolve() / path.name
    for folder in place.parents:
        entry = read_list(folder).get(place.relative_to(folder).as_posix())
        if entry is not None:
            return Written(entry[0], storage.file_hash(place) in entry[1:])
    return None


def read_list(folder: Path) -> dict[str, list[str]]:
    """Return the list of a folder: path of a file in it → command, then the hashes of what it may hold.

    A list that is missing or damaged is empty: its files then count as those of nobody.
    """
    if not (folder / NAME).is_file():
        return {}
    try:
        written = storage.read_facts(folder / NAME, SCHEMA).get("written")
    except InputError:
        return {}
    entries = written.items() if isinstance(written, dict) else ()
    return {name: entry for name, entry in entries if isinstance(entry, list) and entry}


def add_to_list(folder: Path, command: str, hashes: Mapping[str, Sequence[str]]) -> None:
    """Add files to the list of a folder, or replace what it has of them.

    Args:
      folder: exists.
      command: that writes them.
      hashes: path in the folder → hashes of what it may hold from now on.
    """
    write_list(folder, read_list(folder) | {name: [command, *each] for name, each in hashes.items()})


def write_list(folder: Path, entries: Mapping[str, Sequence[str]]) -> None:
    """Write the list of a folder; one without entries is removed."""
    if entries:
        written = {name: list(entries[name]) for name in sorted(entries)}
        storage.write_json(folder / NAME, {"schema": SCHEMA, "written": written})
    else:
        (folder / NAME).unlink(missing_ok=True)

"""What --json writes: a file, whole or not at all, or a stream such as /dev/stdout, a pipe or a terminal."""

import os
import re
import stat
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from archerfish.cli.interrupts import without_interrupts
from archerfish.cli.publication import publish_text
from archerfish.cli.writer import Writer
from archerfish.cli.written_files import JSON, NAME, find_written
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

STDOUT = Path("-")
"""Stands for standard output, with nothing else on it."""
_DESCRIPTORS = {"/dev/stdout": 1, "/dev/stderr": 2}


def is_stream(path: Path) -> bool:
    """Tell whether --json is written to what is open or open to others, and so not replaced as a file is."""
    return _descriptor(path) is not None or _is_special(path)


def check_json_file(path: Path, writer: Writer) -> None:
    """Refuse a --json file that can't be written, or that would replace something other than an earlier --json.

    Raises:
      InputError: naming what is there, and what to do.
    """
    if path.is_dir():
        raise file_error(path, "--json names a folder, expected a file", "name a file in it")
    with without_interrupts():
        storage.check_writable(path.parent)
    storage.check_regular(path.parent / NAME)
    writer = writer._replace(command=JSON, option="--json", named=(path,))
    writer.check([path])
    if path.is_file() and path.stat().st_size and not writer.overwrite and find_written(path) is None:
        problem = "is there, and no earlier --json wrote it"
        if not _is_json(path):
            problem = "holds no JSON, so it is no earlier --json"
        raise file_error(path, problem, writer.remedy)


def write_json_output(path: Path, result: Any) -> None:
    """Write a result as JSON, as a file or to a stream.

    Raises:
      InputError: if it can't be written.
    """
    if not is_stream(path):
        with without_interrupts():
            publish_text(path, storage.json_text(result), JSON)
        return
    descriptor, text = _descriptor(path), storage.json_text(result)
    if descriptor in _DESCRIPTORS.values():
        # After what was printed so far; a reader that has gone is that of the whole output.
        stream = sys.stdout if descriptor == _DESCRIPTORS["/dev/stdout"] else sys.stderr
        stream.write(text)
        stream.flush()
        return
    try:
        handle = os.open(path, os.O_WRONLY) if descriptor is None else os.dup(descriptor)
        with os.fdopen(handle, "w", encoding="utf-8") as other:
            other.write(text)
    except OSError as error:
        raise file_error(path, f"can't be written ({error.strerror})", "choose another --json") from error


def _descriptor(path: Path) -> int | None:
    """Return which of the open files of this process a path stands for."""
    if path == STDOUT:
        return _DESCRIPTORS["/dev/stdout"]
    name = os.path.abspath(path)  # noqa: PTH100 (what /dev/stdout links to is no name)
    found = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", name)
    if found or name in _DESCRIPTORS:
        return int(found[1]) if found else _DESCRIPTORS[name]
    for descriptor in _DESCRIPTORS.values():
        with suppress(OSError):  # one of the two is not there
            if os.path.samestat(path.stat(), os.fstat(descriptor)):
                return descriptor
    return None


def _is_special(path: Path) -> bool:
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def _is_json(path: Path) -> bool:
    try:
        storage.read_json(path)
    except InputError:
        return False
    return True

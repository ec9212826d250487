"""How files reach the disk, whole or not at all, and how JSON is read back.

A file is written beside its place, synced and renamed. A command fills a folder that is hidden inside its output
folder, whose files are moved into place at the end under the folder's lock; `run.json` lists them, so that no command
replaces what another one, or the user, has written.
"""

import errno
import hashlib
import json
import os
import reprlib
import secrets
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from archerfish2.errors import InputError, file_error, one_line

LARGEST = 64_000_000
"""Bytes of the largest file that is read as a record."""
_KINDS = {"S_ISDIR": "folder", "S_ISLNK": "symbolic link", "S_ISFIFO": "named pipe", "S_ISCHR": "character device"}


def plain(value: Any) -> Any:
    """Return what JSON can hold of structs, arrays and paths.

    Raises:
      InputError: if there is something else.
    """

    def convert(each: Any) -> Any:
        if isinstance(each, np.ndarray | np.generic):
            return each.tolist()
        if isinstance(each, Path):
            return str(each)
        raise InputError(f"expected numbers, texts and records, got {one_line(repr(each))[:60]}; give one of these")

    return msgspec.to_builtins(value, enc_hook=convert)


def read_json(path: Path, remedy: str = "write the file again") -> Any:
    """Read a JSON file.

    Raises:
      InputError: if it is missing, unreadable, larger than `LARGEST` or not JSON; neither NaN, infinity nor a field
        that is there twice, which Python would read, are.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        fields = dict(pairs)
        if len(fields) < len(pairs):
            raise ValueError(f"a field is there twice, among {', '.join(reprlib.repr(name) for name in fields)}")
        return fields

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        if not path.is_file():
            raise file_error(path, "there is no such file", "check the path")
        if (size := path.stat().st_size) > LARGEST:
            raise file_error(path, f"has {size} bytes, expected at most {LARGEST}", remedy)
        text = path.read_bytes().decode("utf-8-sig")
        return json.loads(text, object_pairs_hook=unique, parse_constant=refuse)
    except InputError:
        raise
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check the path") from error
    except (ValueError, RecursionError) as error:
        raise file_error(path, f"is not JSON ({one_line(str(error))[:200]})", remedy) from error


def json_text(content: Mapping[str, Any]) -> str:
    """Return JSON with a line per field; NaN and infinity are refused, since JSON has neither."""
    lines = (f" {json.dumps(name)}: {json.dumps(plain(value), allow_nan=False)}" for name, value in content.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON whole, as `json_text` returns it."""
    write_bytes(path, json_text(content).encode())


def check_regular(path: Path) -> None:
    """Refuse to write where something other than a regular file is: replacing would lose devices, pipes and links.

    Raises:
      InputError: saying what is there.
    """
    try:
        mode = path.lstat().st_mode
    except OSError:  # nothing there, or a folder that can't be looked into: writing says so
        return
    if not stat.S_ISREG(mode):
        kind = next((name for test, name in _KINDS.items() if getattr(stat, test)(mode)), "special file")
        raise file_error(path, f"can't be written, since it is a {kind}", "name another file")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole: beside its place, synced, then renamed.

    Raises:
      InputError: if it can't be written, or something other than a regular file is in its place.
    """
    check_regular(path)
    beside = path.with_name(f".unfinished-{secrets.token_hex(6)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with beside.open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            beside.replace(path)
        finally:
            with suppress(OSError):
                beside.unlink(missing_ok=True)
        _sync_folder(path.parent)
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError) -> InputError:
    return file_error(path, f"can't be written ({error.strerror})", "choose another folder or free the disk")


def _sync_folder(folder: Path) -> None:
    """Have the names in a folder reach the disk; without it a loss of power may undo a renaming that came before."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL:  # some network file systems have no such thing
            raise
    finally:
        os.close(handle)


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, as hex digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()

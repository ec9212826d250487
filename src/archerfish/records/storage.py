"""How records reach the disk: whole or not at all.

Facts are JSON, arrays are safetensors, never pickle. A file is written beside its final name, synced and renamed, so
that a crash leaves either the old file or the new one; nothing but a regular file is ever replaced. A record with
arrays is a pair `NAME.json` and `NAME.safetensors`; the JSON holds the hash of the arrays, so that a mixed pair is
refused. While a record is written over another one, the old arrays stay beside it, so that a crash leaves one of the
two.
"""

import errno
import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from archerfish.records.errors import InputError, file_error
from archerfish.records.unfinished import unfinished_file, unfinished_name

Arrays = Mapping[str, NDArray[Any]]


_KEPT = ".safetensors.before"
"""End of the names of arrays that are being replaced."""
_KINDS = (
    (stat.S_ISDIR, "folder"),
    (stat.S_ISLNK, "symbolic link"),
    (stat.S_ISFIFO, "named pipe"),
    (stat.S_ISCHR, "character device"),
    (stat.S_ISBLK, "block device"),
    (stat.S_ISSOCK, "socket"),
)


def check_regular(path: Path) -> None:
    """Refuse to write where something other than a regular file is: renaming would replace devices, pipes and links.

    Raises:
      InputError: saying what is there.
    """
    try:
        mode = path.lstat().st_mode
    except OSError:  # nothing there, or a folder that can't be looked into: writing says so
        return
    if not stat.S_ISREG(mode):
        kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "special file")
        raise file_error(
            path, f"can't be written, since it is a {kind}", "name a regular file, or one that is not there"
        )


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole: temporary file in the same folder, sync, rename.

    Raises:
      InputError: if the folder can't be made or written, or something other than a regular file is in its place.
    """
    check_regular(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with unfinished_file(path.parent) as (temporary, stream):
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
            if os.name != "posix":  # elsewhere an open file can't be renamed
                stream.close()
            temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise _unwritable(path, error) from error


def sync_folder(folder: Path) -> None:
    """Have the names in a folder reach the disk; without it a loss of power may undo a renaming that came before."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno != errno.EINVAL:  # some network file systems know no such thing
            raise
    finally:
        os.close(handle)


def _unwritable(path: Path, error: OSError) -> InputError:
    return file_error(path, f"can't be written ({error.strerror})", "choose another output folder or free the disk")


def check_writable(folder: Path) -> None:
    """Fail now, not after minutes of work, if a folder can't take results.

    Raises:
      InputError: if the folder can't be made or written.
    """
    probe = folder / unfinished_name()
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        write_bytes(probe, b"")
    except InputError as error:
        raise InputError(str(error).replace(str(probe), str(folder), 1)) from error
    finally:
        with suppress(OSError):  # never made, or another process has removed it with its folder
            probe.unlink(missing_ok=True)
        for each in made:
            with suppress(OSError):  # never made, or another process has begun to use it
                each.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file whole."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Any) -> None:
    """Write JSON whole, as `json_text` returns it."""
    write_text(path, json_text(content))


def json_text(content: Any) -> str:
    """Return JSON, indented; NaN and infinity are refused since JSON has neither."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises:
      InputError: if it is missing, unreadable or not JSON; NaN and infinity, which Python would read, are not.
    """

    def refuse(constant: str) -> None:
        raise file_error(path, f"holds {constant}, which JSON does not know", "write the file anew")

    try:
        return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    except FileNotFoundError as error:
        raise file_error(path, "no such file", "check the path") from error
    except (OSError, UnicodeDecodeError) as error:
        raise file_error(path, f"can't be read ({error})", "check that it is a readable text file") from error
    except json.JSONDecodeError as error:
        raise file_error(path, f"line {error.lineno}: not JSON ({error.msg})", "write the file anew") from error


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, as hex digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def write_record(path: Path, schema: str, facts: Mapping[str, Any], arrays: Arrays) -> None:
    """Write a record: `path` (ends in .json) and the arrays beside it.

    Args:
      path: the JSON file; the arrays go to the same name with the ending .safetensors.
      schema: name and version, for instance "archerfish.plant/1".
      facts: what JSON can hold.
      arrays: name → array.
    """
    # ascontiguousarray turns a scalar into shape (1,); copy keeps shape ().
    content = save({name: np.array(array, order="C", copy=True) for name, array in arrays.items()})
    # Facts that JSON can't hold must fail before the old arrays are gone.
    text = json_text({"schema": schema, "arrays_sha256": hashlib.sha256(content).hexdigest(), **facts})
    with overwriting(path):
        write_bytes(path.with_suffix(".safetensors"), content)
        write_text(path, text)


@contextmanager
def overwriting(path: Path) -> Iterator[None]:
    """Keep a record readable while a block replaces its two files, the arrays first: the old arrays stay until its end.

    Two files can't be renamed in one step. Killed between the two, the old facts would stand beside the new arrays.

    Args:
      path: the JSON file of the record.
    """
    arrays = path.with_suffix(".safetensors")
    _settle(path)  # someone may have been killed in this block
    if path.is_file() and arrays.is_file():
        write_bytes(_kept_arrays(path), arrays.read_bytes())
    try:
        yield
    finally:
        _settle(path)


def settle_records(folder: Path) -> None:
    """End what a process that was killed was about to replace in a folder, while nobody else writes there."""
    for kept in folder.glob(f".*{_KEPT}"):
        _settle(folder / f"{kept.name.removeprefix('.').removesuffix(_KEPT)}.json")


def _settle(path: Path) -> None:
    """Put the kept arrays back if the facts are still theirs, else remove them."""
    arrays, kept = path.with_suffix(".safetensors"), _kept_arrays(path)
    if not kept.exists():
        return
    if _arrays_hash(path) == file_hash(kept):
        kept.replace(arrays)
    else:
        kept.unlink()


def _kept_arrays(path: Path) -> Path:
    return path.with_name(f".{path.stem}{_KEPT}")


def _arrays_hash(path: Path) -> str | None:
    try:
        facts = read_json(path)
    except InputError:
        return None
    return facts.get("arrays_sha256") if isinstance(facts, dict) else None


def read_record(path: Path, schema: str, *older: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read a record written by `write_record`.

    Args:
      path: the JSON file.
      schema: name and version.
      older: versions that will do as well.

    Returns:
      The facts and the arrays.

    Raises:
      InputError: if a file is missing or damaged, the schema is another, or the pair does not belong together.
    """
    facts = read_json(path)
    _check_schema(path, facts, schema, *older)
    arrays_path = path.with_suffix(".safetensors")
    try:
        content = arrays_path.read_bytes()
    except OSError as error:
        raise file_error(arrays_path, f"can't be read ({error.strerror})", f"it belongs beside {path.name}") from error
    kept = _kept_arrays(path)
    if hashlib.sha256(content).hexdigest() != facts.get("arrays_sha256") and kept.is_file():
        content = kept.read_bytes()
    if hashlib.sha256(content).hexdigest() != facts.get("arrays_sha256"):
        raise file_error(arrays_path, f"is not the file that {path.name} was written with", "write the record anew")
    try:
        return facts, load(content)
    except SafetensorError as error:
        raise file_error(arrays_path, f"damaged ({error})", "write the record anew") from error


def read_facts(path: Path, schema: str, *older: str) -> dict[str, Any]:
    """Read a record that has no arrays, less its schema.

    Args:
      path: of the record.
      schema: as it is written today.
      older: schemas that can still be read.

    Raises:
      InputError: if the file is missing or damaged, or the schema is another.
    """
    facts = read_json(path)
    _check_schema(path, facts, schema, *older)
    return {name: value for name, value in facts.items() if name != "schema"}


def _check_schema(path: Path, facts: Any, schema: str, *older: str) -> None:
    found = facts.get("schema") if isinstance(facts, dict) else type(facts).__name__
    if found not in (schema, *older):
        raise file_error(path, f'field "schema" is {found!r}, expected {schema!r}', "pass a file of that kind")


def field(path: Path, facts: Mapping[str, Any], name: str, kind: type | tuple[type, ...]) -> Any:
    """Return a fact of a record, checked.

    Raises:
      InputError: if the field is missing or of another type.
    """
    value = facts.get(name)
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        expected = kind.__name__ if isinstance(kind, type) else " or ".join(each.__name__ for each in kind)
        raise file_error(path, f'field "{name}" is {value!r}, expected {expected}', "write the record anew")
    return value

"""How files reach the disk: whole or not at all.

A file is written beside its place, synced and renamed. A command fills a folder that is hidden inside its output
folder, whose files are moved into place at the end under the folder's lock; `run.json` lists them, so that no command
replaces what another one, or the user, has written.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.errors import check_name, file_error, one_line

MOST_BYTES = 64_000_000
"""Bytes of the largest file that is read whole."""
LOCK, RUN, RUN_SCHEMA = "run.lock", "run.json", "archerfish.run/1"


def check_regular(path: Path) -> None:
    """Refuse to write where something other than a regular file is: replacing would lose devices, pipes and links.

    Raises:
      InputError: saying what is there.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        kind = "symbolic link" if path.is_symlink() else "folder" if path.is_dir() else "special file"
        raise file_error(path, f"can't be written, since it is a {kind}", "name another file")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole: beside its place, synced, then renamed.

    Raises:
      InputError: if it can't be written, or something other than a regular file is in its place.
    """
    beside = path.with_name(f".unfinished-{os.urandom(6).hex()}")
    with writing(path):
        check_regular(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with beside.open("xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
        _sync(path.parent)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says when a file can't be written into an `InputError`."""
    try:
        yield
    except OSError as error:
        raise file_error(path, f"can't be written ({error.strerror})", "choose another folder or free space") from error


def _sync(path: Path) -> None:
    """Have a file reach the disk, or the names in a folder, without which a loss of power may undo a renaming."""
    if os.name == "posix":
        handle = os.open(path, os.O_RDONLY)
        with suppress(OSError):  # some network file systems can't
            os.fsync(handle)
        os.close(handle)


def read_bytes(path: Path, remedy: str) -> bytes:
    """Return the content of a file.

    Raises:
      InputError: if it is missing, unreadable or larger than `MOST_BYTES`.
    """
    if not path.is_file():
        raise file_error(path, "there is no such file", "check the path")
    if (size := path.stat().st_size) > MOST_BYTES:
        raise file_error(path, f"has {size} bytes, expected at most {MOST_BYTES}", remedy)
    try:
        return path.read_bytes()
    except OSError as error:
        raise file_error(path, f"can't be read ({error.strerror})", "check the path") from error


def text_of(content: bytes) -> str:
    """Return the text of a file in UTF-8 or UTF-16, with or without a byte order mark, which editors of Windows write.

    Raises:
      ValueError: if it is in neither, with the place.
    """
    encoding = json.detect_encoding(content)
    try:
        return content.decode(encoding).removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start} is no {encoding}, save it as UTF-8") from error


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file, as hex digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_arrays(path: Path, facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write arrays to a .safetensors file whole, with facts as JSON, and the arrays' SHA-256, in its header.

    Raises:
      InputError: if it can't be written.
    """
    from safetensors.numpy import save

    arrays = {name: np.asarray(arrays[name], order="C") for name in sorted(arrays)}
    # One field: the library writes several in any order.
    header = {"archerfish": f"{_arrays_hash(arrays)} {json.dumps(facts, allow_nan=False)}"}
    write_bytes(path, save(arrays, header))


def read_arrays(path: Path, remedy: str) -> tuple[str, dict[str, Any]]:
    """Return facts, as JSON, and arrays of a .safetensors file.

    Raises:
      InputError: if it is missing, too large, damaged, or no such file.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    content = read_bytes(path, remedy)
    try:
        arrays = dict(sorted(load(content).items()))
        header = json.loads(content[8:][: int.from_bytes(content[:8], "little")]).get("__metadata__") or {}
    except (SafetensorError, TypeError, ValueError, LookupError) as error:
        raise file_error(path, f"is no .safetensors file ({one_line(str(error))[:200]})", remedy) from error
    digest, _, facts = header.get("archerfish", "").partition(" ")
    if digest != _arrays_hash(arrays):
        raise file_error(path, "was not written by archerfish, or is damaged", remedy)
    return facts, arrays


def _arrays_hash(arrays: Mapping[str, Any]) -> str:
    digest = hashlib.sha256()
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype} {array.shape} ".encode() + array.tobytes())
    return digest.hexdigest()


@contextmanager
def locked(folder: Path, timeout_s: float = 0.0, name: str = LOCK) -> Iterator[None]:
    """Hold the lock of a folder, which is made if missing, for a block; it ends with its holder, however that ends.

    Args:
      folder: to lock.
      timeout_s: how long to wait for another process [s].
      name: of the lock's file.

    Raises:
      InputError: if another process holds it, or the folder can't be written.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(folder / name)
    with writing(folder):
        check_regular(folder / name)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=timeout_s)
        except Timeout as error:
            raise file_error(folder, "is in use by another process", "wait for it, or choose another folder") from error
    try:
        yield
    finally:
        lock.release()


@contextmanager
def output_folder(
    out: Path, command: str, inputs: Iterable[Path], overwrite: bool, facts: Any = None, names: Iterable[str] = ()
) -> Iterator[Path]:
    """Yield an empty folder to fill; at the end its files replace those that the same command wrote before.

    A block that fails, or is killed, leaves the old results. `run.json` is written last: for each command its files,
    and its facts.

    Args:
      out: is made if missing.
      command: whose files these are; it may replace and remove its own.
      inputs: files that it reads, which are never replaced.
      overwrite: whether files that it didn't write may be replaced.
      facts: options and provenance by name, for `run.json`.
      names: of files that are certain to come, so that what is in their place is named before the work.

    Raises:
      InputError: if the folder can't be written or is in use, or something in it may not be replaced.
    """
    import shutil  # slow to load

    check_name(out)
    made = [each for each in (out, *out.parents) if not each.exists()]
    hidden, inputs = out / f".unfinished-{os.urandom(6).hex()}", tuple(inputs)
    with locked(out):
        runs = _read_runs(out)
        own = {*runs.get(command, {}).get("files", ()), *([RUN] if runs else [])}
        try:
            with writing(out):
                _check_targets(out, (*names, *own, RUN), own, inputs, overwrite)
                for each in out.glob(".unfinished-*/"):  # of processes that were killed
                    shutil.rmtree(each, ignore_errors=True)
                hidden.mkdir()
            yield hidden
            files = sorted(each.relative_to(hidden).as_posix() for each in hidden.rglob("*") if each.is_file())
            with writing(out):
                _check_targets(out, (*files, RUN), own, inputs, overwrite)
                for name in files:
                    (out / name).parent.mkdir(parents=True, exist_ok=True)
                    _sync(hidden / name)
                    (hidden / name).replace(out / name)
                for name in own.difference(files, {RUN}):
                    (out / name).unlink(missing_ok=True)
            content = {"schema": RUN_SCHEMA, **runs, command: {"files": files, **(facts or {})}}
            write_bytes(out / RUN, json.dumps(content, indent=1, allow_nan=False).encode())
        finally:
            shutil.rmtree(hidden, ignore_errors=True)
            if made and {each.name for each in out.iterdir()} <= {LOCK}:
                (out / LOCK).unlink(missing_ok=True)
                with suppress(OSError):
                    for each in made:
                        each.rmdir()


def _read_runs(out: Path) -> dict[str, Any]:
    """Return by command what run.json lists; nothing where it is missing, damaged or names files outside its folder."""
    try:
        runs = json.loads((out / RUN).read_bytes())
        is_ours = runs.pop("schema") == RUN_SCHEMA
        files = [Path(name) for run in runs.values() for name in run["files"]]
        inside = not any(each.is_absolute() or ".." in each.parts for each in files)
        return runs if is_ours and inside else {}
    except (OSError, ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return {}


def _check_targets(out: Path, names: Iterable[str], own: set[str], inputs: tuple[Path, ...], overwrite: bool) -> None:
    for name in names:
        path = out / name
        check_regular(path)
        if path.parent.resolve() != (out.resolve() / name).parent:
            raise file_error(path, "is reached through a link", "choose another output folder")
        if path.exists() and any(each.exists() and path.samefile(each) for each in inputs):
            raise file_error(path, "is read by this command, which never replaces it", "choose another output folder")
        if path.exists() and name not in own and not overwrite:
            raise file_error(path, "was not written by this command", "choose another folder, or pass --overwrite")

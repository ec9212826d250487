"""Files and folders that are not yet in place: hidden, locked by their owner, and removed when it was killed.

The lock goes with the process that holds it, however it ends; a process id would be another one's after a while.
"""

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # no such locks on Windows, where nothing is removed for others
    fcntl = None  # type: ignore[assignment]

_NAME = re.compile(r"\.unfinished-[0-9a-f]{12}")


def unfinished_name() -> str:
    """Return a hidden name that nothing else has."""
    return f".unfinished-{secrets.token_hex(6)}"


@contextmanager
def unfinished_file(folder: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """Open a new file in a folder while a block runs; unless it was renamed, it is removed after that.

    Yields:
      Its path, and the file, open for writing.
    """
    is_held = False
    while not is_held:
        path = folder / unfinished_name()
        try:
            with path.open("xb") as stream:
                is_held = _lock(stream.fileno(), path)
                if is_held:
                    yield path, stream
        finally:
            with suppress(OSError):  # the folder was never made
                path.unlink(missing_ok=True)


@contextmanager
def unfinished_folder(folder: Path) -> Iterator[Path]:
    """Make a new folder in a folder while a block runs; it is removed after that."""
    is_held = False
    while not is_held:
        path = folder / unfinished_name()
        try:
            path.mkdir()
            with _open(path) as handle:
                is_held = handle is not None and _lock(handle, path)
                if is_held:
                    yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _open(folder: Path) -> Iterator[int | None]:
    """Open a folder, to lock it, if it is still there: without the lock it looks abandoned."""
    try:
        handle = -1 if fcntl is None else os.open(folder, os.O_RDONLY)
    except FileNotFoundError:
        yield None
        return
    try:
        yield handle
    finally:
        if handle >= 0:
            os.close(handle)


def remove_abandoned(folder: Path) -> None:
    """Remove what processes that were killed left unfinished in a folder; what a living one holds stays."""
    if fcntl is None or not folder.is_dir():
        return
    for path in folder.glob(".unfinished-*"):
        if _NAME.fullmatch(path.name) and not path.is_symlink():
            with suppress(OSError):  # held, or another process removes it
                _remove(path)


def _remove(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()
    finally:
        os.close(handle)


def _lock(handle: int, path: Path) -> bool:
    """Lock what was just made, and return whether it is still there: without the lock it looked abandoned."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(handle), path.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
    except OSError:  # a file system without such locks, on which none is taken for abandoned either
        return True

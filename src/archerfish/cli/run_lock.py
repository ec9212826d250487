"""One writer per run folder: a lock that the system takes back however its holder ends."""

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

try:
    import fcntl
except ImportError:  # no such locks on Windows
    fcntl = None  # type: ignore[assignment]

NAME = ".lock"
_ALONE = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NOFOLLOW", "O_NONBLOCK"))
_CONTENT = re.compile(rb"\d{,31}")


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder for a block.

    Args:
      folder: exists; the file stays in it, and one that a killed process left is no lock.

    Raises:
      InputError: if another process holds it, the folder can't be written, or it holds another file of that name.
    """
    handle = _open(folder)
    try:
        with suppress(OSError):  # a full disk: the lock holds, it just does not say whose it is
            os.ftruncate(handle, 0)
            os.write(handle, str(os.getpid()).encode())
        yield
    finally:
        os.close(handle)


def is_lock(path: Path) -> bool:
    """Tell whether a file is a lock, whether a process holds it or not: empty, or the number of a process."""
    try:
        return stat.S_ISREG(path.lstat().st_mode) and _CONTENT.fullmatch(path.read_bytes()) is not None
    except OSError:
        return False


def _open(folder: Path) -> int:
    path = folder / NAME
    while True:
        storage.check_regular(path)
        try:
            # A link or a pipe that comes in between is not followed, and not waited for.
            handle = os.open(path, os.O_RDWR | os.O_CREAT | _ALONE, 0o666)
        except OSError as error:
            problem = f"can't be written ({error.strerror})"
            raise file_error(folder, problem, "choose another output folder") from error
        _check_lock(handle, path)
        if _lock(handle, path):
            return handle
        os.close(handle)


def _check_lock(handle: int, path: Path) -> None:
    """Refuse a file that is no lock of ours: they are empty, or hold the number of a process."""
    if not (stat.S_ISREG(os.fstat(handle).st_mode) and _CONTENT.fullmatch(os.pread(handle, 32, 0))):
        os.close(handle)
        raise file_error(path, "is no lock of Archerfish", "choose another output folder, or move the file away")


def _lock(handle: int, path: Path) -> bool:
    """Lock, and tell whether it was the file that others will look at: a run that ends removes its own."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.read(handle, 32).decode(errors="replace").strip()
        os.close(handle)
        raise InputError(
            f"{path.parent}: process {holder or 'unknown'} is writing this run; wait for it, or choose another folder"
        ) from None
    except OSError as error:
        os.close(handle)
        problem = f"can't be locked ({error.strerror})"
        raise file_error(path.parent, problem, "choose a folder on another file system") from error
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False

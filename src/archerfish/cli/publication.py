"""Finished files into an output folder: all of them or none, and nothing that others wrote is replaced."""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from archerfish.cli.writer import Writer
from archerfish.cli.written_files import add_to_list, read_list, write_list
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

try:
    import fcntl
except ImportError:  # no such locks on Windows
    fcntl = None  # type: ignore[assignment]


def publish(files: Mapping[str, Path], out: Path, writer: Writer, aside: Path) -> None:
    """Move files into a folder and list them there; where one can't be moved, the folder is as it was.

    Args:
      files: path in the folder → where the finished file is, on the same file system.
      out: is made if missing.
      writer: whose files they are.
      aside: folder for what is replaced, until all is in place; is made.

    Raises:
      InputError: if something is in the way that may not be replaced, or a file can't be moved.
    """
    out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(aside, ignore_errors=True)  # of a process that was killed here
    with _alone(out):
        _check(files, out, writer)
        for folder in {(out / name).parent for name in files}:
            storage.settle_records(folder)
        before = read_list(out)
        hashes = {name: [storage.file_hash(path)] for name, path in files.items()}
        # Killed from here on, the old and the new content are both the command's own.
        add_to_list(out, writer.command, {name: hashes[name] + before.get(name, [""])[1:] for name in files})
        try:
            _move(files, out, aside)
        except BaseException:
            write_list(out, before)
            raise
        add_to_list(out, writer.command, hashes)


def files_below(folder: Path, within: str = "") -> dict[str, Path]:
    """Return the files of a folder, or of one within it, by their path in the folder."""
    paths = sorted((folder / within).rglob("*"))
    return {each.relative_to(folder).as_posix(): each for each in paths if each.is_file()}


def publish_text(path: Path, text: str, command: str) -> None:
    """Write a text file and list it in its folder.

    Args:
      path: of the file; its folder is made if missing.
      text: what it is to hold.
      command: who writes it.

    Raises:
      InputError: if it can't be written; the list is as it was.
    """
    out, name = path.parent, path.name
    storage.check_writable(out)
    out.mkdir(parents=True, exist_ok=True)
    with _alone(out):
        before, digest = read_list(out), hashlib.sha256(text.encode()).hexdigest()
        # Killed from here on, the old and the new content are both the command's own.
        add_to_list(out, command, {name: [digest, *before.get(name, [""])[1:]]})
        try:
            storage.write_text(path, text)
        except BaseException:
            write_list(out, before)
            raise
        add_to_list(out, command, {name: [digest]})


def remove_written(out: Path, files: Mapping[str, Path], writer: Writer) -> None:
    """Remove those of some files that may be replaced, and have the list of their folder name none that is gone.

    Args:
      out: folder whose list names them.
      files: path in the folder → the file.
      writer: whose files they are.
    """
    with _alone(out):
        for path in files.values():
            with suppress(InputError):  # of somebody else: it is not in the way
                writer.check([path])
                path.unlink()
        write_list(out, {name: entry for name, entry in read_list(out).items() if os.path.lexists(out / name)})


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time put files into a folder; it takes milliseconds, so that the others wait."""
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without such locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _check(files: Mapping[str, Path], out: Path, writer: Writer) -> None:
    targets = [out / name for name in files]
    for folder in dict.fromkeys(each for target in targets for each in target.parents if out in each.parents):
        if os.path.lexists(folder) and (folder.is_symlink() or not folder.is_dir()):
            problem = "can't be written, since it is in the place of a folder"
            raise file_error(folder, problem, "choose another output folder")
    writer.check(targets)


def _move(files: Mapping[str, Path], out: Path, aside: Path) -> None:
    """Replace files one by one; after a fault, put all of them back."""
    undo: list[Callable[[], object]] = []
    try:
        with ExitStack() as stack:
            for name in (each for each in files if each.endswith(".safetensors")):
                stack.enter_context(storage.overwriting((out / name).with_suffix(".json")))
            # The arrays of a record before its facts, as `overwriting` wants it.
            for number, name in enumerate(sorted(files, key=lambda each: (each.endswith(".json"), each))):
                _replace(files[name], out / name, aside / str(number), undo)
    except BaseException:
        for step in reversed(undo):
            step()
        raise


def _replace(source: Path, target: Path, kept: Path, undo: list[Callable[[], object]]) -> None:
    try:
        for folder in reversed([each for each in target.parents if not each.exists()]):
            folder.mkdir()
            undo.append(folder.rmdir)
        if target.exists():
            _keep(target, kept)
            undo.append(lambda: kept.replace(target))
        else:
            undo.append(lambda: target.unlink(missing_ok=True))
        source.replace(target)
    except OSError as error:
        problem = f"can't be written ({error.strerror})"
        raise file_error(target, problem, "choose another output folder") from error


def _keep(path: Path, kept: Path) -> None:
    """Give a file a second name, so that it stays in its place meanwhile."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    try:
        kept.hardlink_to(path)
    except OSError:  # a file system without links
        shutil.copy2(path, kept)

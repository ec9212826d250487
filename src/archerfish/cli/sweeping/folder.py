"""The folder of a sweep: a trial is in it whole or not at all, and once.

The files of a trial are put under a hidden name; then its line goes into results.jsonl, and only with that line is it
done; then the files are put in place. A driver may be killed at any moment: what it leaves is taken up by the next one.
So a folder of a trial without a line is none that a sweep left.
"""

import os
import re
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from archerfish.cli.interrupts import without_interrupts
from archerfish.cli.run_lock import NAME as LOCK
from archerfish.cli.run_lock import locked
from archerfish.cli.sweeping.results import (
    TrialResult,
    read_results,
    result_line,
    result_line_beginning,
    whole_length,
)
from archerfish.cli.train import RESULT_FILES
from archerfish.cli.writer import Writer
from archerfish.cli.written_files import add_to_list, read_list, write_list
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.unfinished import remove_abandoned

RESULTS, CONFIGURATION, TRIALS = "results.jsonl", "sweep.json", "trials"
MAY_CHANGE = ("trials", "provenance")
"""What may differ when a sweep is taken up: a longer one first proposes what the shorter one did."""
_TRIAL = re.compile(r"\d{4,}")
_WRITER = Writer("sweep")


class SweepFolder:
    """A folder that this process alone writes, and the trials in it."""

    def __init__(self, path: Path, results: list[TrialResult], stream: int) -> None:
        self.path = path
        self.results = {each.trial: each for each in results}
        """Number → finished trial."""
        self._stream = stream

    def record(self, result: TrialResult, files: Mapping[str, bytes] | None) -> None:
        """Write a finished trial.

        Args:
          result: what came of it.
          files: name → content for its folder; None for none.

        Raises:
          InputError: if it is there already, or can't be written; the results then end with the line before.
        """
        if result.trial in self.results:
            raise InputError(
                f"{self.path}: trial {result.trial} is done already; this is a fault of the sweep, report it"
            )
        target = trial_folder(self.path, result.trial)
        unfinished = _unfinished(target)
        if files is not None:
            shutil.rmtree(unfinished, ignore_errors=True)
            for name, content in files.items():
                storage.write_bytes(unfinished / name, content)
        with without_interrupts():  # Ctrl-C waits for the whole line, and for the files
            self._append(result_line(result))
            self.results[result.trial] = result
            _put_in_place(unfinished, target)

    def _append(self, line: bytes) -> None:
        length = os.fstat(self._stream).st_size
        try:
            # A write that met the end of the disk takes what fits; the next one says why.
            while line:
                line = line[os.write(self._stream, line) :]
            os.fsync(self._stream)
        except OSError as error:
            # The next line would join the torn one.
            with suppress(OSError):
                os.ftruncate(self._stream, length)
            problem = f"can't be written ({error.strerror})"
            raise file_error(self.path / RESULTS, problem, "free the disk, then go on with --resume") from error


def trial_folder(out: Path, trial: int) -> Path:
    """Return the folder of a trial."""
    return out / TRIALS / f"{trial:04d}"


def _unfinished(target: Path) -> Path:
    return target.with_name(f".unfinished-{target.name}")


def _put_in_place(unfinished: Path, target: Path) -> None:
    """Give the files of a trial that is done their names; a process that was killed here has done a part of it."""
    if not unfinished.is_dir():
        return
    try:
        target.mkdir(exist_ok=True)
        for path in unfinished.iterdir():
            path.replace(target / path.name)
        unfinished.rmdir()
    except OSError as error:
        problem = f"can't be written ({error.strerror})"
        raise file_error(target, problem, "mend that, then go on with --resume") from error


@contextmanager
def sweep_folder(
    out: Path, configuration: Mapping[str, Any], resume: bool, writer: Writer = _WRITER
) -> Iterator[SweepFolder]:
    """Open the folder of a sweep while a block runs.

    Args:
      out: is made if missing.
      configuration: what the sweep was told, as JSON holds it.
      resume: whether to go on with the sweep that is there, if there is one.
      writer: what it may not replace.

    Raises:
      InputError: if the folder holds a sweep and `resume` is not given, or another sweep than this, or files that no
        sweep left, or another process is at it, or it can't be written.
    """
    with without_interrupts():
        storage.check_writable(out)
    remove_abandoned(out)
    _finished(out, configuration, resume, writer)
    made = [each for each in (out, *out.parents) if not each.exists()]
    out.mkdir(parents=True, exist_ok=True)
    path = out / RESULTS
    try:
        with locked(out):
            try:
                # Another process may have written between the look above and the lock.
                found = _finished(out, configuration, resume, writer)
                _end_killed(out, {each.trial for each in found})
                with _appended(path) as stream:
                    os.ftruncate(stream, whole_length(path))
                    storage.write_json(out / CONFIGURATION, configuration)
                    add_to_list(out, "sweep", {CONFIGURATION: [storage.file_hash(out / CONFIGURATION)]})
                    yield SweepFolder(out, found, stream)
            finally:
                with suppress(OSError):
                    (out / LOCK).unlink()
    finally:
        _leave_no_folder(made)


def _finished(out: Path, configuration: Mapping[str, Any], resume: bool, writer: Writer) -> list[TrialResult]:
    """Return the finished trials of the sweep that is to be begun or taken up."""
    storage.check_regular(out / RESULTS)
    found = read_results(out / RESULTS)
    _check_torn(out)
    if found and not resume:
        raise file_error(
            out, f"holds a sweep with {len(found)} finished trials", "add --resume, or choose another --out"
        )
    if found:
        _check_same_sweep(out / CONFIGURATION, configuration)
    elif (out / TRIALS).exists() and not (out / CONFIGURATION).exists():
        raise file_error(out / TRIALS, "is there, and no sweep made it", "choose another --out")
    done = {each.trial for each in found}
    for folder in sorted((out / TRIALS).glob("[0-9]*")):
        if _TRIAL.fullmatch(folder.name) and int(folder.name) not in done:
            _check_undone(folder, writer)
    return found


def _check_torn(out: Path) -> None:
    """Refuse results that end with something else than a line that a killed driver left unfinished."""
    path = out / RESULTS
    torn = path.read_bytes()[whole_length(path) :] if path.exists() else b""
    beginning = result_line_beginning()
    if torn and not (torn.startswith(beginning) or beginning.startswith(torn)):
        raise file_error(path, "its last line is none that a sweep wrote", "choose another --out")
    if torn and not (out / CONFIGURATION).is_file():
        raise file_error(path, f"is there without {CONFIGURATION}, so no sweep wrote it", "choose another --out")


def _check_undone(folder: Path, writer: Writer) -> None:
    """Refuse what is in the place of a trial that is to be run, unless it may be replaced."""
    writer.check_folders([folder])
    if not any(folder.iterdir()):
        return
    if not writer.overwrite:
        problem = f"holds files, and {RESULTS} has no line of that trial"
        raise file_error(folder, problem, f"put {RESULTS} back, or pass --overwrite to train that trial again")
    for each in folder.iterdir():
        if each.name in RESULT_FILES:
            storage.check_regular(each)


def _end_killed(out: Path, done: Collection[int]) -> None:
    """Put in place what a driver that was killed wrote of the trials that are done, and remove the others' files."""
    for each in (out / TRIALS).glob(".unfinished-*"):
        name = each.name.removeprefix(".unfinished-")
        if _TRIAL.fullmatch(name) and each.is_dir() and not each.is_symlink():
            if int(name) in done:
                _put_in_place(each, each.with_name(name))
            else:
                shutil.rmtree(each, ignore_errors=True)


def _check_same_sweep(path: Path, configuration: Mapping[str, Any]) -> None:
    begun = storage.read_json(path)
    for name in (each for each in {**begun, **configuration} if each not in MAY_CHANGE):
        before, now = begun.get(name), configuration.get(name)
        if before != now:
            raise file_error(
                path,
                f"the sweep was begun with {name} {before!r}, not {now!r}",
                "resume with the options it was begun with, or choose another --out",
            )


@contextmanager
def _appended(path: Path) -> Iterator[int]:
    """Open the results to append to; a sweep that comes to none leaves nothing of its own."""
    is_own = not path.exists() or CONFIGURATION in read_list(path.parent)
    try:
        # A link that comes in between is not followed.
        stream = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        raise file_error(path, f"can't be written ({error.strerror})", "choose another --out") from error
    try:
        yield stream
    finally:
        if os.fstat(stream).st_size == 0:
            _leave_no_sweep(path.parent, is_own)
        os.close(stream)


def _leave_no_sweep(out: Path, results_too: bool) -> None:
    _end_killed(out, ())
    with suppress(OSError):  # there is none, or it holds something else
        (out / TRIALS).rmdir()
    for name in (RESULTS, CONFIGURATION) if results_too else (CONFIGURATION,):
        (out / name).unlink(missing_ok=True)
    write_list(out, {name: entry for name, entry in read_list(out).items() if name != CONFIGURATION})


def _leave_no_folder(made: list[Path]) -> None:
    for folder in made:
        if not folder.is_dir() or any(folder.iterdir()):
            return
        folder.rmdir()

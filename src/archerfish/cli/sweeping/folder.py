"""The folder of a sweep: a trial is in it whole or not at all, and once.

The files of a trial are put under a hidden name and renamed; then its line goes into results.jsonl, and only with that
line is it done. A driver may be killed at any moment: what it leaves is taken up by the next one.
"""

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from archerfish.cli.interrupts import without_interrupts
from archerfish.cli.sweeping.results import TrialResult, read_results, result_line, whole_length
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

RESULTS, CONFIGURATION, TRIALS = "results.jsonl", "sweep.json", "trials"
MAY_CHANGE = ("trials", "provenance")
"""What may differ when a sweep is taken up: a longer one first proposes what the shorter one did."""


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
          InputError: if it is there already, or can't be written.
        """
        if result.trial in self.results:
            raise InputError(
                f"{self.path}: trial {result.trial} is done already; this is a fault of the sweep, report it"
            )
        if files is not None:
            self._write_files(trial_folder(self.path, result.trial), files)
        # One call appends the whole line; Ctrl-C waits for it.
        with without_interrupts():
            os.write(self._stream, result_line(result))
            os.fsync(self._stream)
            self.results[result.trial] = result

    def _write_files(self, target: Path, files: Mapping[str, bytes]) -> None:
        unfinished = target.with_name(f".unfinished-{target.name}")
        # Left by a driver that was killed before it wrote the line.
        for each in (unfinished, target):
            shutil.rmtree(each, ignore_errors=True)
        for name, content in files.items():
            storage.write_bytes(unfinished / name, content)
        unfinished.replace(target)


def trial_folder(out: Path, trial: int) -> Path:
    """Return the folder of a trial."""
    return out / TRIALS / f"{trial:04d}"


@contextmanager
def sweep_folder(out: Path, configuration: Mapping[str, Any], resume: bool) -> Iterator[SweepFolder]:
    """Open the folder of a sweep while a block runs.

    Args:
      out: is made if missing.
      configuration: what the sweep was told, as JSON holds it.
      resume: whether to go on with the sweep that is there, if there is one.

    Raises:
      InputError: if the folder holds a sweep and `resume` is not given, or another sweep than this, or another process
        is at it, or it can't be written.
    """
    storage.check_writable(out)
    path = out / RESULTS
    found = read_results(path)
    if found and not resume:
        raise file_error(
            out, f"holds a sweep with {len(found)} finished trials", "add --resume, or choose another --out"
        )
    if found:
        _check_same_sweep(out / CONFIGURATION, configuration)
    elif (out / TRIALS).exists() and not (out / CONFIGURATION).exists():
        raise file_error(out / TRIALS, "is there, and no sweep made it", "choose another --out")
    made = [each for each in (out, *out.parents) if not each.exists()]
    out.mkdir(parents=True, exist_ok=True)
    stream = _locked(path)
    try:
        # Read anew: another process may have written between the look above and the lock.
        found, length = read_results(path), whole_length(path)
        os.ftruncate(stream, length)
        storage.write_json(out / CONFIGURATION, configuration)
        yield SweepFolder(out, found, stream)
    finally:
        if os.fstat(stream).st_size == 0:
            _leave_nothing(out, made)
        os.close(stream)


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


def _locked(path: Path) -> int:
    """Open a file to append to, which no other process holds so; the system lets go of it when this one ends."""
    stream = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
    try:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:  # Windows, where nothing keeps two drivers apart
        pass
    except OSError as error:
        os.close(stream)
        raise file_error(path.parent, "another process is at this sweep", "wait, or choose another --out") from error
    return stream


def _leave_nothing(out: Path, made: list[Path]) -> None:
    shutil.rmtree(out / TRIALS, ignore_errors=True)
    for name in (RESULTS, CONFIGURATION):
        (out / name).unlink(missing_ok=True)
    for folder in made:
        if any(folder.iterdir()):
            return
        folder.rmdir()

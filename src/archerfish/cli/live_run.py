"""The folder of a training in progress: `unfinished` in the run folder, there until the results are.

What an earlier run left beside it stays until the new results replace it file by file. `config.json` in `unfinished` is
what makes it a run that can be resumed: it is written last when a run begins, and removed first when its results are in
place. So a process may be killed at any moment.
"""

import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from archerfish.cli.interrupts import Stopped, StopRequests, stop_requests, without_interrupts
from archerfish.cli.progress import note
from archerfish.cli.run_lock import locked
from archerfish.cli.training_log import EVENTS, LOG, EventFile, append_log, log_rows, log_text
from archerfish.learning.checkpoint import restore_standing, standing_arrays
from archerfish.learning.checkpoint_folder import add_checkpoint, checkpoint_files, newest_checkpoint
from archerfish.learning.training import Standing
from archerfish.plugins import names_code, options_to_type
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.plant import PlantRecord, write_plant

UNFINISHED = "unfinished"
CONFIGURATION = "config.json"
CHECKPOINTS = "checkpoints"
INPUTS = "inputs"


def configuration_file(out: Path) -> Path:
    """Return the file that holds the configuration of the unfinished run in a run folder."""
    return out / UNFINISHED / CONFIGURATION


def read_configuration(out: Path) -> dict[str, Any]:
    """Return the configuration of the unfinished run in a run folder.

    Raises:
      InputError: if it holds none.
    """
    path = configuration_file(out)
    if not path.is_file() and (out / CONFIGURATION).is_file():
        remedy = "for a longer training begin another, with more --ppo.steps and another --out"
        raise file_error(out, "holds a training that is finished: there is nothing left to resume", remedy)
    if not path.is_file():
        raise file_error(out, "holds no unfinished run", "begin one with archerfish train --out")
    facts: dict[str, Any] = storage.read_json(path)
    return facts


def input_copy(out: Path, role: str) -> Path:
    """Return the copy of a record that the unfinished run in a run folder reads.

    Args:
      out: run folder.
      role: of the record, as `LiveRun.begin` has it.

    Raises:
      InputError: if there is none.
    """
    folder = out / UNFINISHED / INPUTS / role
    # A file, not a link to what isn't there: its name might be taken for one of code.
    files = sorted(each for each in folder.glob("*") if each.is_file() and each.suffix != ".safetensors")
    if not files:
        raise file_error(folder, f"holds no copy of the {role} record", "put it back, or begin another training")
    return files[0]


class LiveRun:
    """A training in progress: its checkpoints, its log, and the wish that it ends."""

    def __init__(self, out: Path, requests: StopRequests, every_s: float, batch: int, tensorboard: bool) -> None:
        self.out, self.folder = out, out / UNFINISHED
        self._requests, self._every_s, self._batch, self._tensorboard = requests, every_s, batch, tensorboard
        self._events: EventFile | None = None
        self._written, self._saved = time.monotonic(), -1

    def begin(
        self,
        configuration: Mapping[str, Any],
        inputs: Mapping[str, Path],
        plants: Mapping[str, PlantRecord] = MappingProxyType({}),
    ) -> None:
        """Write what a run can be resumed from.

        Args:
          configuration: resolved, as JSON holds it.
          inputs: role → record that the run reads; they are copied, with their arrays.
          plants: axis → plant that no file holds; code of a user's own may change before the run goes on.
        """
        for axis, plant in plants.items():
            write_plant(self.folder / INPUTS / axis / f"{axis}.json", plant)
        for role, path in inputs.items():
            for each in (path, path.with_suffix(".safetensors")):
                if each.is_file():
                    storage.write_bytes(self.folder / INPUTS / role / each.name, each.read_bytes())
        storage.write_json(self.folder / CONFIGURATION, dict(configuration))

    @property
    def goes_on(self) -> str:
        """How to go on with the run, as the end of a message."""
        facts: Any = {}
        with suppress(InputError):
            facts = storage.read_json(self.folder / CONFIGURATION)
        motion = str(facts.get("motion", "")) if isinstance(facts, dict) else ""
        named = f" {options_to_type({'--motion': motion})}" if names_code(motion) else ""
        return f"archerfish train --resume {self.out}{named} goes on with it"

    def resume(self, fresh: Standing) -> Standing:
        """Return where the training goes on: at the newest sound checkpoint, or at its beginning.

        Raises:
          InputError: if all checkpoints are damaged, or are those of another configuration.
        """
        found, standing = newest_checkpoint(self.folder / CHECKPOINTS), fresh
        if found is not None:
            if found.facts.get("configuration_sha256") != self._configuration():
                raise file_error(
                    self.folder / CONFIGURATION, f"is not that of {found.path.name}", "put back what was changed"
                )
            standing = restore_standing(found.path, dict(found.arrays), fresh.learner)
            for each in found.damaged:
                note(f"{each}; goes on from iteration {found.iteration} instead")
        rows = log_rows(standing.metrics, self._batch)
        storage.write_text(self.folder / LOG, log_text(rows))
        self._saved, self._written = standing.iterations, time.monotonic()
        return standing

    def watch(self, standing: Standing) -> None:
        """Log what was measured last, and write a checkpoint when it is time or the process is to end.

        Raises:
          Stopped: if a signal asked for it.
          InputError: if the disk is full or the folder can't be written.
        """
        part = standing.parts[-1]
        before = standing.iterations - len(part.mean_reward)
        rows = log_rows(part, self._batch, before)
        append_log(self.folder, rows)
        if self._tensorboard:
            # Not before there is something to write: a run that was killed at its very end has moved its own already.
            self._events = self._events or EventFile(self.folder / EVENTS, before * self._batch)
            self._events.add(rows)
        self._requests.patient = True
        if self._requests.number is not None or time.monotonic() - self._written >= self._every_s:
            self.save(standing)
        if self._requests.number is not None:
            raise Stopped(self._requests.number)

    def save(self, standing: Standing) -> None:
        """Write a checkpoint, unless the last one is of this iteration."""
        if standing.iterations != self._saved:
            facts = {"configuration_sha256": self._configuration()}
            add_checkpoint(self.folder / CHECKPOINTS, standing.iterations, facts, standing_arrays(standing))
        self._saved, self._written = standing.iterations, time.monotonic()

    def end(self) -> None:
        """Move TensorBoard's files to the results, and remove what is no longer unfinished."""
        with without_interrupts():
            self.close()
            if (self.folder / EVENTS).exists():
                shutil.rmtree(self.out / EVENTS, ignore_errors=True)
                (self.folder / EVENTS).replace(self.out / EVENTS)
            (self.folder / CONFIGURATION).unlink()
            shutil.rmtree(self.folder)

    def set_aside(self, name: str) -> None:
        """Rename the unfinished run, which is over for good, in the place of an earlier one of that name."""
        with without_interrupts():
            self.close()
            if (self.out / name).exists():
                shutil.rmtree(self.out / name)
            self.folder.replace(self.out / name)

    def close(self) -> None:
        """Close TensorBoard's file."""
        if self._events is not None:
            events, self._events = self._events, None
            events.close()

    def _configuration(self) -> str:
        return storage.file_hash(self.folder / CONFIGURATION)

    @property
    def under_way(self) -> bool:
        """Whether this process has trained."""
        return self._requests.patient

    @property
    def resumable(self) -> bool:
        """Whether there is anything that going on would save."""
        return bool(checkpoint_files(self.folder / CHECKPOINTS))


@contextmanager
def live_run(out: Path, *, resumed: bool, every_s: float, batch: int, tensorboard: bool) -> Iterator[LiveRun]:
    """Hold the run folder of a training while a block runs; what was begun and has no checkpoint vanishes if it fails.

    Args:
      out: run folder; is made if missing.
      resumed: whether it goes on with the unfinished run that it holds.
      every_s: time between checkpoints [s].
      batch: decisions of an iteration.
      tensorboard: whether to write its files.

    Raises:
      InputError: if the folder can't be written, another process writes it, or it holds an unfinished run that should
        not be lost.
    """
    folder = out / UNFINISHED
    storage.check_writable(out)
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked(folder), stop_requests() as requests:
            run = LiveRun(out, requests, every_s, batch, tensorboard)
            if not resumed:
                _refuse_unfinished(run)
                _empty(folder)
            with _ended(run, discard=not resumed):
                yield run
    finally:
        for each in made:
            if each.is_dir() and not any(each.iterdir()):
                each.rmdir()


@contextmanager
def _ended(run: LiveRun, *, discard: bool) -> Iterator[None]:
    try:
        yield
    except BaseException as error:
        goes_on = run.goes_on
        if run.resumable or not discard:
            if isinstance(error, Stopped):
                error.told = f"{error.told.partition(';')[0]}; {goes_on}"
            elif isinstance(error, InputError) and run.under_way and run.folder.exists():
                raise InputError(f"{error}; {goes_on}") from error
        else:
            shutil.rmtree(run.folder, ignore_errors=True)
            if isinstance(error, Stopped):
                error.told = f"{error.told.partition(';')[0]} before the first checkpoint; nothing was kept"
        raise
    finally:
        # The first fault is the one to hear of.
        with suppress(InputError):
            run.close()


def _refuse_unfinished(run: LiveRun) -> None:
    files = checkpoint_files(run.folder / CHECKPOINTS)
    if files and (run.folder / CONFIGURATION).is_file():
        raise file_error(
            run.out,
            f"holds an unfinished run, of {int(files[-1].stem)} iterations so far",
            f"{run.goes_on}; delete {run.folder} to begin again",
        )


def _empty(folder: Path) -> None:
    """Remove what a run left that was killed before its first checkpoint, or after its results were in place."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != ".lock":
            path.unlink()

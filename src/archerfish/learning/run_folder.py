"""The folder of a training: everything that it needs to continue, to the bit, after any end.

`run.json` has the settings, the robot's records inside; `log.jsonl` a line per iteration; `checkpoint.safetensors` the
learner, and `checkpoint.previous.safetensors` the one before, should the newer be damaged. At the end there are
`policy.safetensors` and `curve.svg` in the place of the checkpoints; a training that diverged leaves `fault.json`.
"""

import json
import shutil
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import numpy as np

from archerfish import storage
from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.learning.config import TrainConfig
from archerfish.provenance import code_changes, code_commit, library_versions
from archerfish.records.json_files import parse_json, plain, read_json, to_struct, write_json
from archerfish.records.record import Struct
from archerfish.reports.style import new_figure, plot_style, svg_text
from archerfish.robot import Robot
from archerfish.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOG, POLICY, CURVE, FAULT = "log.jsonl", "policy.safetensors", "curve.svg", "fault.json"
CHECKPOINT, PREVIOUS = "checkpoint.safetensors", "checkpoint.previous.safetensors"
REMEDY = "begin the training again"


class Resumed(Struct, frozen=True, kw_only=True):
    """From where on a training has run with other code or libraries."""

    iterations: int
    """Done before."""
    commit: str
    """Of the code."""
    versions: dict[str, str]
    """Of the libraries."""


class Begun(Struct, frozen=True, kw_only=True):
    """What a training was begun with."""

    robot: Robot
    """With all records."""
    task: Task
    """That is trained on."""
    config: TrainConfig
    """Resolved."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**53)]
    """Of everything random."""
    devices: int = 1
    """That the shards had, which decides the last bits."""
    commit: str = ""
    """Of the code."""
    versions: dict[str, str] = msgspec.field(default_factory=dict)
    """Of the libraries."""
    code: dict[str, str] = msgspec.field(default_factory=dict)
    """A user's code, name → SHA-256 of the file that was run."""
    resumed: tuple[Resumed, ...] = ()
    """With other code or libraries than before."""
    files: tuple[str, ...] = ()
    """In the folder, that belong to the training."""


@dataclass
class RunFolder:
    """A training's folder, locked."""

    path: Path  # of the folder
    begun: Begun
    rows: list[dict[str, Any]] = field(default_factory=list)  # of the log, one per iteration; the training adds to them

    def log(self, new: list[dict[str, Any]]) -> None:
        """Write further rows to the log."""
        with storage.writing(self.path / LOG), (self.path / LOG).open("a", encoding="utf-8") as stream:
            stream.writelines(json.dumps(row, allow_nan=False) + "\n" for row in new)

    def save(self, learner: Any) -> None:
        """Write a checkpoint; the one before is kept."""
        with storage.writing(self.path):
            if (self.path / CHECKPOINT).exists():
                (self.path / CHECKPOINT).replace(self.path / PREVIOUS)
        storage.write_arrays(self.path / CHECKPOINT, {}, _arrays(learner))

    def restore(self, learner: Any) -> Any:
        """Return the learner of the latest checkpoint that is whole, and cut the log to it; the given one without any.

        Args:
          learner: that the training began with, for the structure.

        Raises:
          InputError: if a checkpoint is of other settings, or both are damaged.
        """
        faults = []
        for path in (self.path / CHECKPOINT, self.path / PREVIOUS):
            if not path.exists():
                continue
            try:
                restored = _learner(path, storage.read_arrays(path, REMEDY)[1], learner)
            except InputError as error:
                faults.append(str(error))
                continue
            if faults:
                warnings.warn(f"{faults[0]}: continuing from the checkpoint before", stacklevel=2)
                (self.path / CHECKPOINT).unlink()  # so that it never takes the place of the one before
            self._cut(int(restored.iteration))
            self._compare_code()
            return restored
        if faults:
            raise InputError(f"{self.path}: no checkpoint is whole ({'; '.join(faults)})")
        self._cut(0)
        return learner

    def _cut(self, count: int) -> None:
        path = self.path / LOG
        lines = path.read_bytes().splitlines()[:count] if path.exists() else []
        self.rows = [parse_json(line, path, REMEDY) for line in lines]
        if len(self.rows) < count:
            raise file_error(path, f"has {len(self.rows)} iterations, expected {count}", REMEDY)
        storage.write_bytes(path, b"".join(line + b"\n" for line in lines))

    def _compare_code(self) -> None:
        """Say, and write down, where code and libraries are not those that the training has run with so far."""
        last: Any = (self.begun, *self.begun.resumed)[-1]
        if changes := code_changes(last.commit, last.versions):
            later = Resumed(iterations=len(self.rows), commit=code_commit(), versions=library_versions())
            self.begun = self.begun.replace(resumed=(*self.begun.resumed, later))
            _write(self.path, self.begun)
            text = f"continued with {', '.join(changes)}, so the weights may not be those of an unbroken training"
            warnings.warn(f"{self.path}: {text}", stacklevel=2)

    def finish(self, policy: Any) -> None:
        """Write the results, and remove the checkpoints and what an earlier training left."""
        storage.write_bytes(self.path / CURVE, svg_text(learning_curve(self.rows)).encode())
        _write(self.path, self.begun.replace(files=(LOG, CURVE, POLICY)))
        policy.save(self.path / POLICY)
        for name in (CHECKPOINT, PREVIOUS, FAULT):
            (self.path / name).unlink(missing_ok=True)
        shutil.rmtree(self.path.with_name(f"{self.path.name}.before"), ignore_errors=True)

    def diverged(self, learner: Any, facts: dict[str, Any]) -> None:
        """Write the learner of before the fault, and what happened."""
        self.save(learner)
        write_json(self.path / FAULT, {"schema": "archerfish.fault/1", **facts})


@checked_arguments
@contextmanager
def new_run(folder: str | Path, begun: Begun) -> Iterator[RunFolder]:
    """Make the folder of a training and hold its lock; one that can't continue is moved aside until the end.

    Raises:
      InputError: if the folder is in use, has an unfinished training, or something that is no training's.
    """
    path = Path(folder)
    _earlier(path)  # a folder that is refused gets no lock
    with storage.locked(path):
        names = _earlier(path)
        if {POLICY, CHECKPOINT, PREVIOUS} & names:
            before = path.with_name(f"{path.name}.before")
            if before.exists():
                raise file_error(before, "is in the place where the earlier training is moved", "move it away")
            with storage.writing(before):
                before.mkdir()
                for name in names:
                    (path / name).replace(before / name)
        _write(path, begun)
        yield RunFolder(path, begun)


def _earlier(path: Path) -> set[str]:
    """Return the files of an earlier training that can't continue; refuse any others."""
    if not path.exists():
        return set()
    if not path.is_dir():
        raise file_error(path, "is no folder", "name another one")
    names = {each.name for each in path.iterdir() if not each.match(".unfinished-*")} - {storage.LOCK}
    if names and not (path / storage.RUN).exists():
        raise file_error(path, f"has files of something else, as {min(names)}", "choose another folder")
    if {CHECKPOINT, PREVIOUS} & names and not {POLICY, FAULT} & names:
        raise file_error(
            path,
            "has an unfinished training",
            f"continue it: --resume {path}, in Python af.resume",
        )
    own = {storage.RUN, LOG, CHECKPOINT, PREVIOUS, FAULT, *(read_run(path).files if names else ())}
    if others := sorted(names - own):
        raise file_error(path, f"has files of something else, as {others[0]}", "choose another folder")
    return names


@contextmanager
def resumed_run(path: Path) -> Iterator[RunFolder]:
    """Open the folder of an unfinished training and hold its lock.

    Raises:
      InputError: if it is in use, has no training or a finished one, or is damaged.
    """
    read_run(path)  # a folder that is refused gets no lock
    with storage.locked(path):
        if (path / POLICY).exists():
            raise file_error(path, "has a finished training", "train again, for more steps (--steps, steps=…)")
        yield RunFolder(path, read_run(path))


def read_run(path: Path) -> Begun:
    """Return what the training of a folder was begun with.

    Raises:
      InputError: if there is none, or its run.json is damaged, or of another command.
    """
    file = path / storage.RUN
    if not file.is_file():
        raise file_error(path, "has no training", "name the folder of an unfinished one")
    content = read_json(file, REMEDY)
    if not isinstance(content, dict) or not isinstance(content.get("train"), dict):
        raise file_error(file, "is not that of a training", "choose another folder")
    train = {"schema": content.get("schema"), **content["train"]}
    begun: Begun = to_struct(train, file, Begun, storage.RUN_SCHEMA, REMEDY)
    if begun.config.gradient.optimiser is None:  # of a version that had Adam alone
        gradient = begun.config.gradient.replace(optimiser="adam")
        begun = begun.replace(config=begun.config.replace(gradient=gradient))
    return begun


def learning_curve(rows: list[dict[str, Any]]) -> "Figure":
    """Draw hit share and mean reward of a training against its decisions.

    Args:
      rows: of the log.
    """
    decisions = np.array([row["decisions"] for row in rows]) / 1e6
    with plot_style():
        figure, axes = new_figure(2, 1, height=4.6, sharex=True)
        axes[0, 0].plot(decisions, [100.0 * row["hit_share"] for row in rows])
        axes[0, 0].set(title="Training", ylabel="hits [%]")
        axes[1, 0].plot(decisions, [row["mean_reward"] for row in rows])
        axes[1, 0].set(xlabel="decisions [million]", ylabel="reward [m]")
    return figure


def _write(path: Path, begun: Begun) -> None:
    write_json(path / storage.RUN, {"schema": storage.RUN_SCHEMA, "train": plain(begun)})


def _arrays(learner: Any) -> dict[str, Any]:
    """Return the arrays of a learner by their places; the PRNG key as the numbers that it is made of."""
    import jax

    leaves = jax.tree_util.tree_leaves_with_path(learner._replace(key=jax.random.key_data(learner.key)))
    return {jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}


def _learner(path: Path, arrays: dict[str, Any], like: Any) -> Any:
    import jax

    expected = _arrays(like)
    for name, array in expected.items():
        found = arrays.get(name)
        if found is None or found.shape != array.shape or found.dtype != array.dtype:
            raise file_error(path, f"array {name}: expected {array.dtype} of shape {array.shape}", REMEDY)
    leaves = [jax.numpy.asarray(arrays[name]) for name in expected]
    learner = jax.tree.unflatten(jax.tree.structure(like), leaves)
    return learner._replace(key=jax.random.wrap_key_data(learner.key))

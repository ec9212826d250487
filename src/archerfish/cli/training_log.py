"""What a training tells of itself as it goes: one line of JSON per iteration, and files for TensorBoard."""

import importlib.util
import json
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from archerfish.learning.ppo import Metrics
from archerfish.records.errors import file_error

LOG = "log.jsonl"
FLUSH_S = 10.0
"""TensorBoard's files are brought up to date this often [s]."""
EVENTS = "tensorboard"
"""Folder of TensorBoard's files."""


def log_rows(metrics: Metrics, batch: int, before: int = 0) -> list[dict[str, float]]:
    """Return one row per iteration: decisions trained for so far, and what was measured.

    Args:
      metrics: of K iterations, shape (K,); what an environment does not tell is NaN, and left out.
      batch: decisions of an iteration.
      before: iterations that came before.
    """
    names = [name for name in Metrics._fields if name != "fault"]
    rows = []
    for index, values in enumerate(zip(*(getattr(metrics, name) for name in names), strict=True)):
        told = {name: float(value) for name, value in zip(names, values, strict=True)}
        told = {name: value for name, value in told.items() if math.isfinite(value)}
        rows.append({"steps": float(batch * (before + index + 1)), **told})
    return rows


def log_text(rows: list[dict[str, float]]) -> str:
    """Return rows as JSON lines."""
    return "".join(json.dumps(row) + "\n" for row in rows)


def append_log(folder: Path, rows: list[dict[str, float]]) -> None:
    """Add rows to the log of a run in progress.

    Raises:
      InputError: if the disk is full, or the folder can't be written.
    """
    path = folder / LOG
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(log_text(rows))
    except OSError as error:
        raise file_error(path, f"can't be written ({error.strerror})", "free the disk") from error


def has_tensorboard() -> bool:
    """Tell whether files for TensorBoard can be written."""
    return importlib.util.find_spec("tensorboardX") is not None


class EventFile:
    """An event file of TensorBoard, written at once rather than by a thread, so that a full disk is noticed."""

    def __init__(self, folder: Path, step: int) -> None:
        from tensorboardX.event_file_writer import EventsWriter
        from tensorboardX.proto import event_pb2

        self._events: Any = event_pb2
        self._folder, self._flushed = folder, time.monotonic()
        with self._guarded():
            folder.mkdir(parents=True, exist_ok=True)
            self._writer: Any = EventsWriter(str(folder / "events"), filename_suffix=f".{step}")
        # Tells the reader to forget what a killed process wrote beyond the checkpoint.
        self._write(step, session_log=event_pb2.SessionLog(status=event_pb2.SessionLog.START))

    def add(self, rows: list[dict[str, float]]) -> None:
        """Add rows of the log.

        Raises:
          InputError: if the disk is full.
        """
        from tensorboardX.proto.summary_pb2 import Summary

        for row in rows:
            values = [Summary.Value(tag=name, simple_value=value) for name, value in row.items() if name != "steps"]
            self._write(int(row["steps"]), summary=Summary(value=values))
        # It waits for the disk: not after every chunk of a quick training.
        if time.monotonic() - self._flushed > FLUSH_S:
            self._flushed = time.monotonic()
            with self._guarded():
                self._writer.flush()

    def close(self) -> None:
        """Close the file."""
        with self._guarded():
            self._writer.close()

    def _write(self, step: int, **content: Any) -> None:
        with self._guarded():
            self._writer.write_event(self._events.Event(wall_time=time.time(), step=step, **content))

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise file_error(self._folder, f"can't be written ({error.strerror})", "free the disk") from error

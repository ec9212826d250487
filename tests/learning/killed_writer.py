"""A process that writes and is killed: before every one of the steps that change the disk, one after the other.

Run as a script with a folder. The steps are those of the operating system, not those of our code: opening for writing,
writing, fsync, renaming, removing. A child per step is killed there by SIGKILL, so that nothing cleans up.
"""

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.learning.checkpoint_folder import add_checkpoint, newest_checkpoint
from archerfish.records import storage

ARRAYS = {"weights": np.arange(5000, dtype=np.float32)}


# Nobody pulls the plug here: a step of the sequence, but one that need not wait for the disk.
os.fsync = lambda _: None


def counted(calls: list[int], stop_at: int, function: Callable[..., Any]) -> Callable[..., Any]:
    """Kill the process before one call of many."""

    def call(*arguments: Any, **named: Any) -> Any:
        calls[0] += 1
        if calls[0] == stop_at:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **named)

    return call


def killed_at(step: int, work: Callable[[], None]) -> bool:
    """Do some work in a child that is killed at a step; tell whether it was, or came to its end."""
    child = os.fork()
    if child == 0:
        calls = [0]
        for owner, name in ((os, "open"), (os, "fsync"), (os, "write"), (os, "fdopen"), (os, "close")):
            setattr(owner, name, counted(calls, step, getattr(owner, name)))
        for name in ("replace", "unlink", "chmod", "mkdir"):
            setattr(Path, name, counted(calls, step, getattr(Path, name)))
        work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def survive_checkpoints(folder: Path) -> int:
    """Kill while a third checkpoint is written beside two; the newest sound one is the second or the third."""
    step = 0
    while True:
        step += 1
        run = folder / f"checkpoints{step}"
        for iteration in (4, 8):
            add_checkpoint(run, iteration, {"note": iteration}, ARRAYS)
        was_killed = killed_at(step, partial(add_checkpoint, run, 12, {"note": 12}, ARRAYS))
        found = newest_checkpoint(run)
        assert found is not None
        assert found.iteration in ((8, 12) if was_killed else (12,)), (step, found.iteration)
        assert found.facts["note"] == found.iteration
        assert found.damaged == ()
        assert not list(run.glob(".*")), step
        if not was_killed:
            return step


def survive_records(folder: Path) -> int:
    """Kill while a record is written over another one; it is the old or the new one, and can be written anew."""
    step = 0
    while True:
        step += 1
        path = folder / f"record{step}.json"
        storage.write_record(path, "test/1", {"version": 1}, {"a": np.zeros(3)})
        was_killed = killed_at(step, partial(storage.write_record, path, "test/1", {"version": 2}, {"a": np.ones(3)}))
        facts, arrays = storage.read_record(path, "test/1")
        assert facts["version"] == (1 if np.all(arrays["a"] == 0) else 2)
        assert was_killed or facts["version"] == 2
        # And killed once more, wherever the first one left off.
        killed_at(step, partial(storage.write_record, path, "test/1", {"version": 3}, {"a": np.full(3, 2.0)}))
        facts, arrays = storage.read_record(path, "test/1")
        assert facts["version"] == 1 + arrays["a"][0]
        storage.write_record(path, "test/1", {"version": 4}, {"a": np.full(3, 3.0)})
        assert storage.read_record(path, "test/1")[0]["version"] == 4
        if not was_killed:
            return step


if __name__ == "__main__":
    where = Path(sys.argv[1])
    print(survive_checkpoints(where), survive_records(where))  # noqa: T201

"""Run trainings, each in a process and an environment of its own, and read what they noted."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from peers import environments
from peers.environments import NotRunError
from peers.roster import Tool
from peers.training_protocol import Case

SOURCE = Path(__file__).parents[2] / "src"
LIMIT_S = 900
UNSTEADY = 3
"""Calls at the beginning in which something may still be compiled."""
NEEDS_THREADS = ("Brax",)
"""Tools that never end with one thread: the mapped program of Brax waits for a second."""
ONE_THREAD = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


class Training(NamedTuple):
    """How a training went."""

    tool: str
    """Who trained."""
    case: Case
    """What."""
    marks: tuple[tuple[int, float], ...] = ()
    """Decisions trained for so far, and the seconds since the mark before."""
    policies: tuple[tuple[int, Path], ...] = ()
    """Decisions trained for, and the file of the policy then."""
    peak_mib: float = 0.0
    """Largest resident memory of its process [MiB]."""
    problem: str = ""
    """Why there was none."""

    @property
    def call_seconds(self) -> float:
        """Median time between two marks once everything is compiled."""
        return median(seconds for _, seconds in self.marks[UNSTEADY:] or self.marks[-1:])

    @property
    def compile_seconds(self) -> float:
        """What the first calls took beyond the later ones."""
        return sum(max(0.0, seconds - self.call_seconds) for _, seconds in self.marks[:UNSTEADY])

    @property
    def steps_per_second(self) -> float:
        """Decisions trained for per second, learning included, compilation excluded."""
        steady = self.marks[UNSTEADY:] or self.marks[-1:]
        before = self.marks[-len(steady) - 1][0] if len(self.marks) > len(steady) else 0
        return float((self.marks[-1][0] - before) / sum(seconds for _, seconds in steady))

    def seconds_until(self, steps: int) -> float:
        """Return the seconds of training until so many decisions, compilation excluded."""
        return sum(seconds for done, seconds in self.marks if done <= steps) - self.compile_seconds


def train(tool: Tool, case: Case, folder: Path, cache: Path | None = None) -> Training:
    """Train by a tool, or tell why that can't be.

    Args:
      tool: who.
      case: what.
      folder: for what it leaves.
      cache: folder of compiled programs; everything is compiled anew if not given.
    """
    return train_side_by_side(tool, [case], folder, cache)[0]


def train_side_by_side(
    tool: Tool, cases: Sequence[Case], folder: Path, cache: Path | None = None, one_thread: bool = False
) -> list[Training]:
    """Train by a tool in several processes at once.

    Args:
      tool: who.
      cases: what, one process each.
      folder: for what they leave.
      cache: folder of compiled programs; everything is compiled anew if not given.
      one_thread: whether each process has one thread only, where the tool can do with one.
    """
    one_thread = one_thread and tool.name not in NEEDS_THREADS
    try:
        words = environments.command(tool)
    except NotRunError as error:
        return [Training(tool.name, case, problem=str(error)) for case in cases]
    places = [folder / f"{tool.name}_{time.monotonic_ns()}_{index}" for index in range(len(cases))]
    running = [
        _start(words, case, place, _surroundings(cache, one_thread)) for case, place in zip(cases, places, strict=True)
    ]
    return [_end(tool, *each) for each in zip(cases, places, running, strict=True)]


def load_policy(path: Path) -> tuple[Any, Any, tuple[tuple[Any, Any], ...]]:
    """Return mean and variance of the observations, and the layers, of a policy that an adapter wrote."""
    arrays = np.load(path)
    count = sum(name.startswith("weight") for name in arrays.files)
    layers = tuple((arrays[f"weight_{each}"], arrays[f"bias_{each}"]) for each in range(count))
    return arrays["mean"], arrays["variance"], layers


def _surroundings(cache: Path | None, one_thread: bool) -> dict[str, str]:
    kept = {
        "JAX_COMPILATION_CACHE_DIR": str(cache),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    caching = kept if cache else {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    # RLtools would link a library of Intel's that it downloads for itself.
    plain = {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(SOURCE), "RL_TOOLS_DISABLE_MKL": "1"}
    return {**os.environ, **plain, **caching, **(ONE_THREAD if one_thread else {})}


def _start(words: list[str], case: Case, place: Path, surroundings: dict[str, str]) -> subprocess.Popen[str]:
    place.mkdir(parents=True)
    (place / "case.json").write_text(json.dumps(case._asdict()))
    with (place / "said.txt").open("w") as said:
        arguments = [*words, str(place / "case.json"), str(place)]
        return subprocess.Popen(arguments, env=surroundings, stdout=said, stderr=subprocess.STDOUT, text=True)


def _end(tool: Tool, case: Case, place: Path, process: subprocess.Popen[str]) -> Training:
    try:
        status = process.wait(LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return Training(tool.name, case, problem=f"took more than {LIMIT_S} s")
    if status or not (place / "log.json").is_file():
        said = [line for line in (place / "said.txt").read_text().splitlines() if line.strip()]
        print(f"{tool.name}: {' | '.join(said[-3:])}", file=sys.stderr, flush=True)
        return Training(tool.name, case, problem=f"ended with status {status}: {said[-1] if said else 'no message'}")
    facts = json.loads((place / "log.json").read_text())
    return Training(
        tool.name,
        case,
        tuple((int(steps), float(seconds)) for steps, seconds in facts["marks"]),
        tuple((each["steps"], place / each["file"]) for each in facts["policies"]),
        facts["peak_mib"],
    )

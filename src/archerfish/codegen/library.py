"""An exported C file as a library: compiled where a compiler is at hand, and called with buffers that are made once."""

import ctypes
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.arrays import Array
from archerfish.codegen.c99 import prefix, print_c
from archerfish.codegen.decision import (
    EXAMPLES,
    FIELDS,
    GATE_SIZE,
    TRUTHS,
    UNTRACEABLE,
    Gated,
    example_decisions,
    trace_decision,
)
from archerfish.errors import InputError
from archerfish.provenance import code_commit
from archerfish.robot import Robot
from archerfish.safety.gate import GateState, GateVerdict, resting_gate
from archerfish.storage import write_bytes
from archerfish.task import Task

MARK = "Made by Archerfish"
"""In every file that this writes: what has it may be replaced."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""What the compiler is asked."""


class Library:
    """The decision of a compiled file, with a memory of its own.

    `decide` takes and returns arrays. To make none, write into `seen`, call `step`, read `angle` and `codes`.

    Attributes:
      seen: `FIELDS`, each a view of what the next `step` takes, shape (size,); truths are 0 or 1.
      angle: of the verdict: pitch and yaw to send [rad], shape (2,).
      codes: of the verdict: fire, mode, reason and cause, shape (4,).
      memory: numbers that are remembered; those of the gate come first, shape (n,).
      error, fault: what the controller raised: nothing, in C.
      language: C.
    """

    def __init__(self, source: Path) -> None:
        """Load the library beside a source file and its header.

        Raises:
          OSError: if it is not there.
          InputError: if its self-test fails.
        """
        loaded, name = ctypes.CDLL(str(source.with_suffix(".so"))), prefix(source)
        if failed := loaded[f"{name}_self_test"]():
            raise InputError(f"{source.name}: decision {failed} of its self-test is not that of NumPy; report it")
        linked = re.findall(rf"#define {name}_decide (\w+)", source.with_suffix(".h").read_text(encoding="utf-8"))
        numbers, verdict = np.zeros(sum(FIELDS.values()), np.float32), np.zeros(6, np.float32)
        self.memory = np.zeros(loaded[f"{name}_memory_size"]() // 4, np.float32)
        self.seen, at = dict[str, Any](), 0
        for field, size in FIELDS.items():
            view = numbers[at : at + size]
            self.seen[field] = view.view(np.int32) if field in TRUTHS else view
            at += size
        self.angle, self.codes = verdict[:2], verdict[2:].view(np.int32)
        self.error = self.fault = ""
        self.language = "C"
        self._buffers = numbers, verdict
        self._arguments = [ctypes.c_void_p(each.ctypes.data) for each in (self.memory, numbers, verdict)]
        self._decide, self._reset = loaded[linked[0]], loaded[f"{name}_reset"]
        self._new_target = loaded[f"{name}_new_target"]
        self.reset()

    def reset(self) -> None:
        """Forget everything; the gate is disarmed."""
        self._reset(self._arguments[0])
        self.gate = resting_gate(np.zeros(2, np.float32))

    def new_target(self) -> None:
        """Forget the target; the gate's mode stays."""
        self._new_target(self._arguments[0])

    @property
    def gate(self) -> GateState:
        """State of the gate after the last decision, shape (); setting it takes a decision back."""
        numbers = self.memory[:GATE_SIZE].copy()
        return GateState(numbers[:2], numbers[2:4], *numbers[4:])

    @gate.setter
    def gate(self, state: GateState) -> None:
        self.memory[:GATE_SIZE] = np.hstack(state)

    def step(self) -> int:
        """Decide; return 0, or 1 where the input is bad."""
        return int(self._decide(*self._arguments))

    def decide(self, given: Mapping[str, Array]) -> tuple[GateVerdict, int]:
        """Decide from `FIELDS`, each of shape () or (size,); return what `step` does, too."""
        for name, view in self.seen.items():
            view[:] = given[name]
        status = self.step()
        fire, mode, reason, cause = self.codes.tolist()
        return GateVerdict(self.angle.copy(), bool(fire), mode, reason, cause), status


def find_compiler() -> str | None:
    """Return the path of a C compiler, or None."""
    return next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def c_decision(source: Path) -> Library | None:
    """Compile a source file, in its folder, and load it; None without a compiler that can.

    Args:
      source: beside its header.

    Raises:
      InputError: if its self-test fails.
    """
    words: list[Any] = [find_compiler() or "cc", *FLAGS, source, "-o", source.with_suffix(".so"), "-lm"]
    try:
        subprocess.run(words, capture_output=True, check=True)
        return Library(source)
    except (OSError, subprocess.CalledProcessError):
        return None


def compiled(files: Mapping[Path, bytes]) -> Library | None:
    """Compile a source file and its header in a folder that does not stay, and load it; see `c_decision`.

    Args:
      files: as of `codegen.c99.print_c`.
    """
    with tempfile.TemporaryDirectory() as folder:
        for file, text in files.items():
            write_bytes(Path(folder, file.name), text)
        [source] = [Path(folder, file.name) for file in files if file.suffix == ".c"]
        return c_decision(source)


def contract(title: str, gated: Gated, robot: Robot, task: Task) -> dict[str, Any]:
    """Return what a printed file says of itself: for which robot and task it is.

    Args:
      title: its first line.
      gated: what decides.
      robot: whose limits its gate keeps.
      task: decision period.
    """
    return {
        "title": title,
        "made": f"{MARK} {code_commit()[:12]}; do not edit.",
        "period_s": task.period_s,
        "late_s": float(gated.rules.late),
        "limits": [float(limit[axis]) for axis in range(2) for limit in gated.rules.limits[:4]],
        "robot": robot.digest(),
        "robot_name": robot.name,
        "stamp_offset_s": robot.sensing.camera.time_offset if robot.sensing else 0.0,
    }


def library_of(name: str, gated: Gated, robot: Robot, task: Task) -> Library | None:
    """Return a decision in C, loaded; None where no compiler is at hand, or its formulas can't be traced.

    Args:
      name: of the controller.
      gated: what decides.
      robot: whose limits its gate keeps.
      task: decision period.

    Raises:
      InputError: if it doesn't decide as in NumPy.
    """
    if find_compiler() is None:
        return None
    try:
        decision = trace_decision(gated)
    except UNTRACEABLE:
        return None
    examples = list(example_decisions(gated, EXAMPLES))
    return compiled(print_c(decision, contract(name, gated, robot, task), Path("decision.c"), examples))

"""An exported C file as a library: compiled where a compiler is at hand, and called with buffers that are made once."""

import ctypes
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.arrays import Array
from archerfish.codegen.c99 import prefix
from archerfish.codegen.decision import FIELDS, GATE_SIZE, TRUTHS
from archerfish.errors import InputError
from archerfish.safety.gate import GateVerdict

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""What the compiler is asked."""


class Library:
    """The decision of a compiled file, with a memory of its own.

    `decide` takes and returns arrays. A loop that may not wait writes into `seen`, calls `step`, and reads `angle` and
    `codes`.

    Attributes:
      seen: `FIELDS`, each a view of what the next `step` takes, shape (size,); truths are 0 or 1.
      angle: of the verdict: pitch and yaw to send [rad], shape (2,).
      codes: of the verdict: fire, mode, reason and cause, shape (4,).
      memory: numbers that are remembered; those of the gate come first, shape (n,).
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
        self._gate_before = self.memory[:GATE_SIZE].copy()
        self._buffers = numbers, verdict
        self._arguments = [ctypes.c_void_p(each.ctypes.data) for each in (self.memory, numbers, verdict)]
        self._decide, self._reset = loaded[linked[0]], loaded[f"{name}_reset"]
        self._new_target = loaded[f"{name}_new_target"]
        self.reset()

    def reset(self) -> None:
        """Forget everything; the gate is disarmed."""
        self._reset(self._arguments[0])

    def new_target(self) -> None:
        """Forget the target; the gate's mode stays."""
        self._new_target(self._arguments[0])

    def step(self) -> int:
        """Decide; return 0, or 1 where the input is bad."""
        self._gate_before[:] = self.memory[:GATE_SIZE]
        return int(self._decide(*self._arguments))

    def withdraw(self) -> None:
        """Let the gate forget the last decision, whose command was not sent; limits count from what was."""
        self.memory[:GATE_SIZE] = self._gate_before

    def decide(self, given: Mapping[str, Array]) -> tuple[GateVerdict, int]:
        """Decide from `FIELDS`, each of shape () or (size,)."""
        for name, view in self.seen.items():
            view[:] = given[name]
        status = self.step()
        fire, mode, reason, cause = self.codes.tolist()
        return GateVerdict(self.angle.copy(), bool(fire), mode, reason, cause), status


def c_decision(source: Path) -> Library | None:
    """Compile a source file, in its folder, and load it; None without a compiler that can.

    Args:
      source: beside its header.

    Raises:
      InputError: if its self-test fails.
    """
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), "cc")
    words: list[Any] = [compiler, *FLAGS, source, "-o", source.with_suffix(".so"), "-lm"]
    try:
        subprocess.run(words, capture_output=True, check=True)
        return Library(source)
    except (OSError, subprocess.CalledProcessError):
        return None

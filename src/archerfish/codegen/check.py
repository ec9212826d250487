"""Printed decisions against NumPy's: the C file compiled where a compiler is at hand, ONNX where its runtime is."""

import ctypes
import importlib.util
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.arrays import Array
from archerfish.codegen.c99 import prefix
from archerfish.codegen.decision import FIELDS, Gated, example_decisions
from archerfish.errors import InputError

DECISIONS = 200
"""Decisions that are compared."""
CLOSE = 5e-5
"""Difference of a command from NumPy's that is taken as rounding [rad]."""
DIFFERENCE, SHARE = f"largest difference in {DECISIONS} decisions [rad]", f"differ by more than {CLOSE:g} rad [%]"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
"""What the compiler is asked."""
Decide = Callable[[Mapping[str, Array]], tuple[Array, bool, int]]
"""A decision: `FIELDS` to the command [rad], (2,), whether to fire, and what C returns; it has a memory."""


def c_decision(source: Path) -> Decide | None:
    """Compile a source file, in its folder, and return its decision; None without a compiler that can.

    Args:
      source: beside its header.

    Raises:
      InputError: if its self-test fails.
    """
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), "cc")
    words: list[Any] = [compiler, *FLAGS, source, "-o", library := source.with_suffix(".so"), "-lm"]
    try:
        subprocess.run(words, capture_output=True, check=True)
        loaded, name = ctypes.CDLL(str(library)), prefix(source)
    except (OSError, subprocess.CalledProcessError):
        return None
    if failed := loaded[f"{name}_self_test"]():
        raise InputError(f"{source.name}: decision {failed} of its self-test is not that of NumPy; report it")
    kept = ctypes.create_string_buffer(loaded[f"{name}_memory_size"]())
    command, fire = (ctypes.c_float * 2)(), ctypes.c_int()
    linked = re.findall(rf"#define {name}_decide (\w+)", source.with_suffix(".h").read_text(encoding="utf-8"))
    loaded[f"{name}_reset"](kept)

    def decide(given: Mapping[str, Array]) -> tuple[Array, bool, int]:
        numbers = np.concatenate([np.atleast_1d(given[each]) for each in FIELDS]).astype(np.float32)
        # The last of the caller's struct is an integer.
        seen = numbers[:-1].tobytes() + np.int32(numbers[-1]).tobytes()
        status = loaded[linked[0]](kept, seen, command, ctypes.byref(fire))
        return np.array(command), bool(fire.value), status

    return decide


def onnx_decision(model: bytes) -> Decide | None:
    """Return the decision of a model; None without ONNX Runtime."""
    if importlib.util.find_spec("onnxruntime") is None:
        return None
    import onnxruntime

    options: Any = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.log_severity_level = 1, 3
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    wanted = {each.name: each.shape for each in session.get_inputs()}
    kept = {"memory": np.zeros(wanted["memory"], np.float32), "first": np.array([True])}

    def decide(given: Mapping[str, Array]) -> tuple[Array, bool, int]:
        known = {name: np.atleast_1d(value) for name, value in given.items()} | kept
        command, fire, memory = session.run(None, {name: known[name] for name in wanted})
        kept.update(memory=memory, first=np.array([False]))
        return command, bool(fire[0]), 0

    return decide


def compared(decide: Decide | None, gated: Gated) -> dict[str, float]:
    """Compare decisions with NumPy's, each with a memory of its own.

    Returns:
      `DIFFERENCE` of the commands, at least 1 where one fires and the other does not, or the file holds its command;
      `SHARE` of the decisions that differ; medians of the times. Nothing where there is nothing to compare.
    """
    if decide is None:
        return {}
    differences, times = list[float](), [time.perf_counter()]
    for given, command in example_decisions(gated, DECISIONS, seed=1):
        times.append(time.perf_counter())
        made, fire, status = decide(given)
        times.append(time.perf_counter())
        differences.append(float(np.max([*np.abs(made - command.angle), fire != command.fire, status])))
    of_numpy, of_file = (1e6 * float(np.median(np.diff(times)[at::2])) for at in range(2))
    worst, share = float(np.max(differences)), 100.0 * float(np.mean([not each <= CLOSE for each in differences]))
    found = {DIFFERENCE: worst, SHARE: share}
    return found | {"a decision, as called from Python [µs]": of_file, "a decision in NumPy [µs]": of_numpy}

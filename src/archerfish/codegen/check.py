"""Printed decisions against NumPy's, of C and, where its runtime is at hand, of ONNX."""

import importlib.util
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from archerfish.arrays import Array
from archerfish.codegen.decision import Gated, example_decisions
from archerfish.safety.gate import GateVerdict, Mode

DECISIONS = 200
"""Decisions that are compared."""
CLOSE = 5e-5
"""Difference of a command from NumPy's that is taken as rounding [rad]."""
DIFFERENCE, SHARE = f"largest difference in {DECISIONS} decisions [rad]", f"differ by more than {CLOSE:g} rad [%]"
Decide = Callable[[Mapping[str, Array]], tuple[GateVerdict, int]]
"""A decision with a memory of its own: `FIELDS` to the verdict, and 0 or, where C refuses the input, 1."""


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

    def decide(given: Mapping[str, Array]) -> tuple[GateVerdict, int]:
        known = {name: np.atleast_1d(value) for name, value in given.items()} | kept
        command, fire, codes, memory = session.run(None, {name: known[name] for name in wanted})
        kept.update(memory=memory, first=np.array([False]))
        return GateVerdict(command, fire[0], *codes), 0

    return decide


def verdict_difference(one: GateVerdict, other: GateVerdict) -> float:
    """Return the difference of two commands of shape (2,) [rad], or 1 where anything else differs."""
    is_equal = all(float(a) == float(b) for a, b in zip(one[1:], other[1:], strict=True))
    return float(np.max(np.abs(one.angle - other.angle))) if is_equal else 1.0


def compared(decide: Decide | None, gated: Gated) -> dict[str, float]:
    """Compare decisions with NumPy's, each with a memory of its own.

    Returns:
      `DIFFERENCE` of the commands, at least 1 where mode, fire, reason or cause differ, or the file refuses the input;
      `SHARE` of the decisions that differ; medians of the times. Nothing where there is nothing to compare.
    """
    if decide is None:
        return {}
    differences, times = list[float](), [time.perf_counter()]
    for given, verdict in example_decisions(gated, DECISIONS, seed=1):
        times.append(time.perf_counter())
        made, status = decide(given)
        times.append(time.perf_counter())
        difference = max(verdict_difference(made, verdict), float(status))
        # The examples' input is good, so the gate holds only a command that is no number.
        differences.append(float("nan") if verdict.mode >= Mode.HOLD else difference)
    of_numpy, of_file = (1e6 * float(np.median(np.diff(times)[at::2])) for at in range(2))
    worst, share = float(np.max(differences)), 100.0 * float(np.mean([not each <= CLOSE for each in differences]))
    found = {DIFFERENCE: worst, SHARE: share}
    return found | {"a decision, as called from Python [µs]": of_file, "a decision in NumPy [µs]": of_numpy}

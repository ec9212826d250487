"""The gate in random sequences under an independent monitor, in NumPy, C and JAX, and the time of a decision.

`python benchmarks/gate.py [--sequences N]`: N sequences, a million unless given, of 50 decisions each with inputs dense
at the limits, and with NaN, infinities and absurd ages; the monitor counts what must never happen. The gate's trace,
printed as C with the exporter's operations, decides with a state of its own, and each of its numbers is compared bit
for bit; so does JAX, within rounding. Then 10,000 calls of `kalman` behind the gate in C: their time. Takes half an
hour. Writes results/gate.json, unless N is given.
"""

import argparse
import collections
import ctypes
import json
import platform
import runpy
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.arrays import leaves
from archerfish.codegen.c99 import c_number
from archerfish.codegen.decision import Gated, example_decisions
from archerfish.codegen.library import FLAGS, c_decision
from archerfish.codegen.printing import Printer
from archerfish.codegen.trace import Trace, scalars_of, schedule
from archerfish.controllers.registry import make_controller
from archerfish.safety.gate import GateInput, GateState, GateVerdict, gate, resting_gate
from archerfish.safety.rules import Rules, gate_rules
from archerfish.studies.export import export

SEQUENCES, BATCH, DECISIONS = 1_000_000, 20_000, 50
CLOSE = 5e-5  # of JAX [rad]
INFIX = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/", "less": "<", "less_equal": "<=", "greater": ">"}
INFIX |= {"greater_equal": ">=", "equal": "==", "not_equal": "!=", "logical_and": "&&", "logical_or": "||"}
PATTERNS = {
    "negative": "-{0}",
    "logical_not": "!{0}",
    "where": "{0} ? {1} : {2}",
    "absolute": "fabsf({0})",
    "maximum": "{0} != {0} || {0} > {1} ? {0} : {1}",
    "minimum": "{0} != {0} || {0} < {1} ? {0} : {1}",
    "sign": "{0} != {0} ? {0} : (float)(({0} > 0.0f) - ({0} < 0.0f))",
}
"""C of the operations that the gate uses, as decision.c.jinja has them."""
Gate = Callable[[GateState, GateInput], tuple[GateState, GateVerdict]]


def percentiles(times: list[float]) -> dict[str, float]:
    """Return p50 and p99 of times [µs]."""
    p50, p99 = 1e6 * np.percentile(times, [50, 99])
    return {"p50_us": round(float(p50), 2), "p99_us": round(float(p99), 2)}


def gate_in_c(rules: Rules, folder: Path) -> Gate:
    """Return the gate of some rules, traced, printed as C and compiled, for sequences of shape (n,)."""
    trace = Trace()
    begun = resting_gate(np.zeros(2))
    truths = {"fire", "switch_on", "plausible"}
    vectors = {"desired", "angle"}
    usual = [np.zeros((2,) * (name in vectors), bool if name in truths else float) for name in GateInput._fields]
    given, state = trace.like(GateInput(*usual), "input", "given"), trace.like(begun, "input", "state")
    after, verdict = gate(rules, state, given)
    outputs = [*scalars_of(after), *scalars_of(verdict)]
    sizes = [len(scalars_of(tree)) for tree in (given, begun, verdict)]
    printer, lines = Printer(c_number), list[str]()
    for content in map(printer.content, schedule(outputs)):
        operation, of = content["operation"], content["of"]
        value = f"{of[0]} {INFIX[operation]} {of[1]}" if operation in INFIX else ""
        value = value or (
            f"{of}[{content['places'][0]}]"
            if operation == "input"
            else PATTERNS.get(operation, operation + "f({0})").format(*of)
        )
        kind = "int" if content["kind"] == "bool" else "float"
        lines.append(f"    const {kind} {content['name']} = {value};")
    kept, sent = (printer.scalars(values) for values in (outputs[: sizes[1]], outputs[sizes[1] :]))
    lines += [f"    state[{at}] = {name};" for at, name in enumerate(kept)]
    lines += [f"    verdict[{at}] = {name};" for at, name in enumerate(sent)]
    head = "#include <math.h>\nvoid gate(int n, const float *given, float *state, float *verdict) {\n"
    head += f"  for (; n > 0; --n, given += {sizes[0]}, state += {sizes[1]}, verdict += {sizes[2]}) {{\n"
    source, library = folder / "gate.c", folder / "gate.so"
    source.write_text(head + "\n".join(lines) + "\n  }\n}\n")
    subprocess.run(["cc", *FLAGS, source, "-o", library, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).gate

    def rows(tree: Any) -> Any:
        return np.concatenate([np.reshape(array, (len(array), -1)) for array in leaves(tree)], axis=1, dtype=np.float32)

    def columns(array: Any, like: Any) -> Any:
        ends = np.cumsum([np.size(field) for field in like])
        parts = [array[:, end - np.size(field) : end] for field, end in zip(like, ends, strict=True)]
        return type(like)(*(part if part.shape[1] > 1 else part[:, 0] for part in parts))

    def step(state: GateState, given: GateInput) -> tuple[GateState, GateVerdict]:
        numbers, kept = rows(given), rows(state)
        sent = np.zeros((len(kept), sizes[2]), np.float32)
        function(len(kept), *(ctypes.c_void_p(array.ctypes.data) for array in (numbers, kept, sent)))
        return columns(kept, begun), columns(sent, verdict)

    return step


class Compared:
    """The gate in NumPy, and how those in C and JAX differ from it, each with a state of its own."""

    def __init__(self, folder: Path) -> None:
        """Begin to count."""
        self.folder, self.counts, self.largest = folder, collections.Counter[str](), 0.0
        self.c: Gate | None = None
        self.states: tuple[GateState, GateState] | None = None
        self.jax = jax.jit(gate)

    def step(self, rules: Rules, state: GateState, given: GateInput) -> tuple[GateState, GateVerdict]:
        """Decide, compare."""
        self.c = self.c or gate_in_c(rules, self.folder)
        kept, expected = gate(rules, state, given)
        of_c, of_jax = self.states or (state, state)
        of_c, in_c = self.c(of_c, given)
        of_jax, in_jax = jax.device_get(self.jax(rules, of_jax, given))
        self.states = of_c, of_jax
        bits, own_bits = (
            np.ascontiguousarray(verdict.angle, np.float32).view(np.int32) for verdict in (expected, in_c)
        )
        self.counts["C: another bit of a command"] += int(np.sum(bits != own_bits))
        difference = np.max(np.abs(in_jax.angle.astype(float) - expected.angle), axis=-1)
        for name in ("fire", "mode", "reason", "cause"):
            one, c, other = (np.asarray(getattr(verdict, name), float) for verdict in (expected, in_c, in_jax))
            self.counts[f"C: another {name}"] += int(np.sum(one != c))
            self.counts[f"JAX: another {name}"] += int(np.sum(one != other))
            difference = np.where(one == other, difference, 0.0)  # another decision is counted by itself
        self.counts[f"JAX: a command that differs by more than {CLOSE} rad"] += int(np.sum(~(difference <= CLOSE)))
        self.largest = max(self.largest, float(np.max(difference)))
        return kept, expected


def random_sequences(robot: af.Robot, count: int) -> dict[str, Any]:
    """Run sequences in batches, and print what the monitor has counted so far."""
    campaign = runpy.run_path(str(ROOT / "tests" / "safety" / "campaign.py"))["campaign"]
    rules, wrong, done = gate_rules(robot, af.Task.load("any")), collections.Counter[str](), collections.Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        compared = Compared(Path(folder))
        for batch in range(count // BATCH):
            compared.states = None
            with np.errstate(invalid="ignore"):
                monitor = campaign(robot, rules, BATCH, DECISIONS, [7, batch], compared.step)
            wrong.update(monitor.wrong)
            done.update(monitor.done)
            print(f"\r{(batch + 1) * BATCH} sequences, {sum(wrong.values())} violations", end="", flush=True)
    print()
    counts = {
        "violations": dict.fromkeys(monitor.wrong, 0) | wrong,
        "differences": {"JAX: largest of a command [rad]": compared.largest, **compared.counts},
        "of_them": dict(done),
    }
    return {"decisions": count // BATCH * BATCH * DECISIONS, **counts}


def times_of_a_decision(robot: af.Robot) -> dict[str, dict[str, float]]:
    """Return what a decision takes: the gate alone in NumPy, and kalman with the gate in C and in NumPy."""
    task = af.Task.load("any")
    rules = gate_rules(robot, task)
    gated = Gated(make_controller("kalman", robot, task), rules)
    examples = list(example_decisions(gated, 400))
    with tempfile.TemporaryDirectory() as folder:
        export("kalman", Path(folder, "kalman.c"), robot, task, tuning="start")
        library = c_decision(Path(folder, "kalman.c"))
    alone, in_numpy, call, whole = list[float](), list[float](), list[float](), list[float]()
    state, begun = gated.reset(), resting_gate(np.zeros(2, np.float32))
    for given, verdict in examples:
        inputs = GateInput(
            elapsed=given["elapsed"],
            desired=verdict.angle,
            fire=given["found"],
            switch_on=given["switch_on"],
            angle=given["angle"],
            feedback_age=given["gimbal_age"],
            plate_age=given["frame_age"],
            base_yaw=given["base_yaw"],
            shots_left=given["shots_left"],
        )
        times = [time.perf_counter()]
        begun, _ = gate(rules, begun, inputs)
        times.append(time.perf_counter())
        state, _ = gated.step(state, given)
        times.append(time.perf_counter())
        alone.append(times[1] - times[0])
        in_numpy.append(times[2] - times[1])
    found = {"gate in NumPy": percentiles(alone), "kalman and gate in NumPy": percentiles(in_numpy)}
    if library is None:
        return found
    for given, _ in examples * 25:
        for name, view in library.seen.items():
            view[:] = given[name]
        begin = time.perf_counter()
        library.step()
        call.append(time.perf_counter() - begin)
    for given, _ in examples * 25:
        begin = time.perf_counter()
        library.decide(given)
        whole.append(time.perf_counter() - begin)
    return found | {"kalman and gate in C, the call": percentiles(call), "with its arrays": percentiles(whole)}


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=0)
    robot = af.Robot.load(ROOT / "tests" / "infantry")
    times = times_of_a_decision(robot)
    for name, row in times.items():
        print(f"{name:32} p50 {row['p50_us']:8.2f} µs, p99 {row['p99_us']:8.2f} µs")
    begin = time.perf_counter()
    given = parser.parse_args().sequences
    counts = random_sequences(robot, given or SEQUENCES)
    for kind in ("violations", "differences", "of_them"):
        for name, count in counts[kind].items():
            print(f"{name:52} {count:12.9g}")
    if given:
        return
    conditions = {
        "seconds": round(time.perf_counter() - begin),
        "machine": platform.machine(),
        "date": time.strftime("%F"),
    }
    made = json.dumps({"conditions": conditions, "times": times, "sequences": counts}, indent=1)
    (Path(__file__).parent / "results" / "gate.json").write_text(made + "\n")


if __name__ == "__main__":
    main()

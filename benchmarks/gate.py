"""The gate in random sequences under an independent monitor, in NumPy and in C, and the time of a decision.

`python benchmarks/gate.py [--sequences N]`: N sequences, a million unless given, of 50 decisions each with inputs dense
at the limits, and with NaN, infinities and absurd ages; the monitor counts what must never happen. Then 10,000 calls
of `kalman` behind the gate in C: their time. Takes some minutes. Writes results/gate.json.
"""

import argparse
import collections
import json
import platform
import runpy
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.codegen.decision import Gated, example_decisions
from archerfish.codegen.library import c_decision
from archerfish.controllers.registry import make_controller
from archerfish.safety.gate import GateInput, gate, resting_gate
from archerfish.safety.rules import gate_rules
from archerfish.studies.export import export

BATCH, DECISIONS = 20_000, 50


def percentiles(times: list[float]) -> dict[str, float]:
    """Return p50 and p99 of times [µs]."""
    p50, p99 = 1e6 * np.percentile(times, [50, 99])
    return {"p50_us": round(float(p50), 2), "p99_us": round(float(p99), 2)}


def random_sequences(robot: af.Robot, count: int) -> dict[str, Any]:
    """Run sequences in batches, and print what the monitor has counted so far."""
    campaign = runpy.run_path(str(ROOT / "tests" / "safety" / "campaign.py"))["campaign"]
    rules, wrong, done = gate_rules(robot, af.Task.load("any")), collections.Counter[str](), collections.Counter[str]()
    for batch in range(count // BATCH):
        with np.errstate(invalid="ignore"):
            monitor = campaign(robot, rules, BATCH, DECISIONS, seed=[7, batch])
        wrong.update(monitor.wrong)
        done.update(monitor.done)
        print(f"\r{(batch + 1) * BATCH} sequences, {sum(wrong.values())} violations", end="", flush=True)
    print()
    zero = dict.fromkeys(monitor.wrong, 0)
    return {"decisions": count // BATCH * BATCH * DECISIONS, "violations": zero | wrong, "of_them": dict(done)}


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
    parser.add_argument("--sequences", type=int, default=1_000_000)
    robot = af.Robot.load(ROOT / "tests" / "infantry")
    times = times_of_a_decision(robot)
    for name, row in times.items():
        print(f"{name:32} p50 {row['p50_us']:8.2f} µs, p99 {row['p99_us']:8.2f} µs")
    begin = time.perf_counter()
    counts = random_sequences(robot, parser.parse_args().sequences)
    for kind in ("violations", "of_them"):
        for name, count in counts[kind].items():
            print(f"{name:32} {count:12}")
    conditions = {
        "seconds": round(time.perf_counter() - begin),
        "machine": platform.machine(),
        "date": time.strftime("%F"),
    }
    made = json.dumps({"conditions": conditions, "times": times, "sequences": counts}, indent=1)
    (Path(__file__).parent / "results" / "gate.json").write_text(made + "\n")


if __name__ == "__main__":
    main()

"""Controllers as C and as ONNX: their difference from NumPy, the time of a decision, and the size of the file.

`python benchmarks/exported.py` compiles an untrained policy of each kind of observation and the classical controllers
with `cc -std=c99 -O3 -march=native`, and lets a C program decide in 200 situations, with a memory of its own.
Times are medians of decisions, NumPy's of the same run. Goals: 5e-5 rad; 5 µs for history and tracked, 15 µs for
multimodel. Writes results/exported.json.
"""

import json
import platform
import re
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.codegen import check
from archerfish.codegen.c99 import print_c
from archerfish.codegen.decision import FIELDS, TRUTHS, Gated, example_decisions, trace_decision
from archerfish.codegen.library import c_decision
from archerfish.codegen.onnx import print_onnx
from archerfish.controllers.registry import make_controller
from archerfish.safety.rules import gate_rules
from policies import KINDS, untrained

CLASSICAL, DECISIONS, ROUNDS = ("kalman", "kalman-lq", "imm-lq"), 200, 100
PROGRAM = """
#include "x.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
static int compare(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}
int main(void) {
  static x_seen seen[N];
  static double times[N * ROUNDS];
  if (fread(seen, sizeof *seen, N, stdin) != N) return 1;
  x_verdict verdict;
  float sum = 0.0f;
  for (int k = 0; k < N * ROUNDS; ++k) {
    static x_memory memory;
    struct timespec begin, end;
    if (k % N == 0) x_reset(&memory);
    clock_gettime(CLOCK_MONOTONIC, &begin);
    x_decide(&memory, &seen[k % N], &verdict);
    clock_gettime(CLOCK_MONOTONIC, &end);
    times[k] = 1e6 * (double)(end.tv_sec - begin.tv_sec) + 1e-3 * (double)(end.tv_nsec - begin.tv_nsec);
    sum += verdict.angle[1];
  }
  qsort(times, N * ROUNDS, sizeof *times, compare);
  printf("%.3f %.3f %d %f\\n", times[N * ROUNDS / 2], times[N * ROUNDS / 100 * 99], x_self_test(), (double)sum);
}
"""


def measured(gated: Gated) -> dict[str, Any]:
    """Return the figures of a controller."""
    decision = trace_decision(gated)
    limits = [float(each[axis]) for axis in range(2) for each in gated.rules.limits[:4]]
    facts = {"title": "", "made": "", "period_s": float(gated.rules.period), "late_s": float(gated.rules.late)}
    facts |= {"limits": limits, "robot": "", "robot_name": "", "stamp_offset_s": 0.0}
    examples = list(example_decisions(gated, DECISIONS, seed=1))
    rows = [np.concatenate([np.atleast_1d(given[name]) for name in FIELDS]) for given, _ in examples]
    numbers = np.array(rows, np.float32)
    truths = len(TRUTHS)  # which are integers in the struct
    numbers[:, -truths:] = np.int32(numbers[:, -truths:]).view(np.float32)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, content in print_c(decision, facts, folder / "x.c", examples[:36]).items():
            path.write_bytes(content)
        library = c_decision(folder / "x.c")
        found: dict[str, Any] = {"c": check.compared(library.decide if library else None, gated)}
        (folder / "main.c").write_text(f"#define N {DECISIONS}\n#define ROUNDS {ROUNDS}\n{PROGRAM}")
        words = ["cc", "-std=gnu99", "-O3", "-march=native", "-fstack-usage", "x.c", "main.c", "-lm", "-o", "main"]
        subprocess.run(words, cwd=folder, check=True)
        subprocess.run(["cc", "-std=c99", "-O2", "-c", "x.c"], cwd=folder, check=True)
        printed = subprocess.run(
            [folder / "main"], input=numbers.tobytes(), capture_output=True, check=True
        ).stdout.split()
        sizes = subprocess.check_output(["size", "x.o"], cwd=folder, text=True).split()[6:8]
        stack = max(
            int(each) for su in folder.glob("*x.su") for each in re.findall(r"x_decide\w*\s+(\d+)", su.read_text())
        )
    of_model = check.compared(check.onnx_decision(print_onnx(decision, {})), gated)
    return {
        "difference_rad": found["c"][check.DIFFERENCE],
        "p50_us": float(printed[0]),
        "p99_us": float(printed[1]),
        "numpy_us": found["c"]["a decision in NumPy [µs]"],
        "object_bytes": sum(map(int, sizes)),
        "stack_bytes": stack,
        "memory_bytes": 4 * (len(decision.memory) + 3),
        "onnx": {
            "difference_rad": of_model[check.DIFFERENCE],
            "us": of_model["a decision, as called from Python [µs]"],
        },
    }


def main() -> None:
    """Measure, print, write."""
    infantry, task, rows = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any"), dict[str, Any]()
    rules = gate_rules(infantry, task)
    cases = {name: untrained(name) for name in KINDS}
    cases |= {name: Gated(make_controller(name, infantry, task), rules) for name in CLASSICAL}
    print(f"{'':12} {'difference':>10} {'C p50':>9} {'C p99':>9} {'NumPy':>9} {'ONNX':>11} {'object':>9} {'stack':>7}")
    for name, gated in cases.items():
        row = rows[name] = measured(gated)
        times = f"{row['p50_us']:6.2f} µs {row['p99_us']:6.2f} µs {row['numpy_us']:6.0f} µs {row['onnx']['us']:8.0f} µs"
        sizes = f"{row['object_bytes'] / 1024:5.0f} KiB {row['stack_bytes']:7d}"
        print(f"{name:12} {row['difference_rad']:10.1e} {times} {sizes}", flush=True)
    conditions = {"decisions": DECISIONS, "rounds": ROUNDS, "machine": platform.machine(), "date": time.strftime("%F")}
    conditions["compiler"] = subprocess.check_output(["cc", "--version"], text=True).split("\n")[0]
    made = json.dumps({"conditions": conditions, "controllers": rows}, indent=1)
    (Path(__file__).parent / "results" / "exported.json").write_text(made + "\n")


if __name__ == "__main__":
    main()

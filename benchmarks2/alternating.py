"""Both editions measured in pairs: a process each, which take turns on the same work."""

import argparse
import importlib.metadata
import json
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

Work = dict[str, Callable[[], int]]


def run(
    description: str, file: str, editions: dict[str, Callable[[], Work]], names: tuple[str, ...], pairs: int
) -> None:
    """Measure each name in pairs, print a table, and write results/NAME.json beside the benchmark.

    Args:
      description: of the benchmark.
      file: the benchmark's own, which is run again for each edition.
      editions: "first" and "second" → what makes the work: name → a function that returns how much it did.
      names: of the work, in the order of the table.
      pairs: of measurements of each name, if not given on the command line.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=pairs)
    parser.add_argument("--seconds", type=float, default=0.4, help="of each measurement")
    parser.add_argument("--edition", choices=tuple(editions), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.edition:
        _work(editions[options.edition](), options.seconds)
        return
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "TF_CPP_MIN_LOG_LEVEL": "3"}
    words = [sys.executable, file, "--seconds", str(options.seconds), "--edition"]
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": environment}
    processes: dict[str, Any] = {edition: subprocess.Popen([*words, edition], **pipes) for edition in editions}

    def measure(edition: str, name: str) -> tuple[float, float]:
        process = processes[edition]
        process.stdin.write(f"{name}\n")
        process.stdin.flush()
        count, wall, spent = json.loads(process.stdout.readline())
        return count / wall, count / spent

    for process in processes.values():
        process.stdout.readline()
    rows = {}
    print(f"{'':16} {'first':>12} {'second':>12} {'ratio':>7} {'of processor time':>18}   per second, medians")
    for name in names:
        found = []
        for number in range(options.pairs):
            order = ("first", "second") if number % 2 else ("second", "first")
            found.append({edition: measure(edition, name) for edition in order})
        first, second = (statistics.median(pair[edition][0] for pair in found) for edition in ("first", "second"))
        ratios = [statistics.median(pair["second"][k] / pair["first"][k] for pair in found) for k in range(2)]
        rows[name] = {"first": round(first), "second": round(second), "ratio": round(ratios[0], 3)}
        rows[name]["ratio_of_processor_time"] = round(ratios[1], 3)
        print(f"{name:16} {first:12,.0f} {second:12,.0f} {ratios[0]:7.3f} {ratios[1]:18.3f}", flush=True)
    for process in processes.values():
        process.terminate()
    conditions = {
        "pairs": options.pairs,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "load": round(os.getloadavg()[0], 1),
        "versions": {name: importlib.metadata.version(name) for name in ("jax", "numpy")},
    }
    path = Path(file).parent / "results" / f"{Path(file).stem}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"conditions": conditions, "per_second": rows}, indent=2) + "\n")


def _work(functions: Work, seconds: float) -> None:
    """Serve a parent: for each name on standard input do the work and print count, wall and processor time [s]."""
    for function in functions.values():
        function()
    print("ready", flush=True)
    for line in sys.stdin:
        wall, spent, count = time.perf_counter(), time.process_time(), 0
        while time.perf_counter() - wall < seconds:
            count += functions[line.strip()]()
        print(json.dumps([count, time.perf_counter() - wall, time.process_time() - spent]), flush=True)

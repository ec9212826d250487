"""Evaluations as whole processes, from a cold start with kept programs, against the first edition's command.

`python benchmarks2/cold_evaluation.py` alternates `af.evaluate(["kalman"], task="paper", engagements=100)` with
`archerfish evaluate --controllers kalman-tuned --engagements 100` (goal: at most 0.7 of its time).
`--infantry` adds five controllers on tests2/infantry, tuning included (goal: at most 0.5), and again with the kept
tuning (at most 0.1); the first edition takes many minutes for it, or `--first-infantry SECONDS` gives its time of the
same machine. The machine should do nothing else.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIVE = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "oracle")
PAPER = 'import archerfish2 as af; af.evaluate(["kalman"], task="paper", engagements=100)'
INFANTRY = f'import archerfish2 as af; print(af.evaluate({FIVE!r}, "ROBOT", "paper", engagements=100).durations)'
RECORDS = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"


def run(words: list[str], cache: str) -> tuple[float, float]:
    """Run a process to its end and return its wall and processor time [s]."""
    environment = {**os.environ, "ARCHERFISH_CACHE": cache}
    before, begun = os.times(), time.perf_counter()
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - begun, spent


def main() -> None:
    """Measure, print and write results/cold_evaluation.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--infantry", action="store_true")
    parser.add_argument("--first-infantry", type=float)
    options = parser.parse_args()
    program = str(Path(sys.executable).with_name("archerfish"))
    with tempfile.TemporaryDirectory() as folder:
        caches = {edition: f"{folder}/{edition}" for edition in ("first", "second")}
        command = [program, "evaluate", "--controllers", "kalman-tuned", "--engagements", "100", "--overwrite"]
        words = {
            "first": [*command, "--out", f"{folder}/paper"],
            "second": [sys.executable, "-c", PAPER],
        }
        for edition in words:  # programs are compiled and kept
            run(words[edition], caches[edition])
        pairs = [{each: run(words[each], caches[each]) for each in order} for order in _orders(options.pairs)]
        results = {"paper": _row([pair["first"] for pair in pairs], [pair["second"] for pair in pairs])}
        if options.infantry:
            robot = Path(folder) / "infantry"
            robot.mkdir()
            for each in (ROOT / "tests2" / "infantry").glob("*.json"):
                (robot / each.name).write_bytes(each.read_bytes())
            (robot / "tuning.json").unlink(missing_ok=True)
            code = [sys.executable, "-c", INFANTRY.replace("ROBOT", str(robot))]
            tuned = run(code, caches["second"])
            again = [run(code, caches["second"]) for _ in range(3)]
            files = [f"--{name}={RECORDS / name}.json" for name in ("pitch", "yaw", "muzzle", "sensing", "limits")]
            five = [*command[:2], "--controllers", *FIVE, "--engagements", "100", "--robot", "infantry", *files]
            first = options.first_infantry or run([*five, "--out", f"{folder}/first"], caches["first"])[0]
            results["infantry"] = _row([(first, first)], [tuned])
            results["infantry, tuning kept"] = _row([(first, first)], again)
    for name, row in results.items():
        print(f"{name:24} first {row['first_s']:8.2f} s   second {row['second_s']:8.2f} s   ratio {row['ratio']:.3f}")
    conditions = {"pairs": options.pairs, "cores": os.cpu_count(), "machine": platform.machine()}
    path = ROOT / "benchmarks2" / "results" / "cold_evaluation.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"conditions": conditions, "whole_process": results}, indent=2) + "\n")


def _orders(pairs: int) -> list[tuple[str, str]]:
    return [("first", "second") if number % 2 else ("second", "first") for number in range(pairs)]


def _row(first: list[tuple[float, float]], second: list[tuple[float, float]]) -> dict[str, float]:
    medians = [statistics.median(each[0] for each in runs) for runs in (first, second)]
    ratio = statistics.median(b[0] / a[0] for a, b in zip(first, second, strict=False))
    return {"first_s": round(medians[0], 2), "second_s": round(medians[1], 2), "ratio": round(ratio, 3)}


if __name__ == "__main__":
    main()

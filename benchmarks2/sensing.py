"""Camera and link on simulated recordings with known truth: errors and coverage, with the first edition's.

`python benchmarks2/sensing.py` lets the first edition simulate its 240 recordings (benchmarks/sensing_recordings.py)
and identify them, in a process of its own and into a temporary folder, and identifies the same arrays. Goals: each rms
error at most 1.1 times the first edition's; intervals of 95 % that have the truth in 93 to 97 % of the recordings, of
which a perfect method misses a quantity in seven. Writes results/sensing.json.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish2.identification.sensing.identify import identify_sensing
from archerfish2.logs.timing import DetectionLog, GimbalLog
from archerfish2.provenance import provenance

ROOT = Path(__file__).parents[1]
RESULT = Path(__file__).parent / "results" / "sensing.json"
FIRST = """
import json, sys
import numpy as np
from sensing import drawn_robot, outcome, step_recording, sweep_recording

for seed in range(int(sys.argv[2])):
    rng = np.random.default_rng(seed)
    robot = drawn_robot(rng)
    (gimbal, plate), (steps, target, moments) = sweep_recording(robot, rng), step_recording(robot, rng)
    arrays = {"moments": moments}
    for name, log in (("gimbal", gimbal), ("steps", steps)):
        arrays |= {f"{name}.{each}": getattr(log, each) for each in ("time", "yaw", "pitch", "command")}
    for name, log in (("plate", plate), ("target", target)):
        arrays |= {f"{name}.{each}": getattr(log, each) for each in ("time", "position", "receive")}
    np.savez(f"{sys.argv[1]}/{seed}.npz", outcome=json.dumps(outcome(seed)), **arrays)
"""
"""Program of the first edition: recordings, and for each quantity truth, estimate, low and high."""


def identified(arrays: dict[str, NDArray[Any]]) -> dict[str, tuple[float, float, float]]:
    """Return estimate, low and high end of each quantity."""
    gimbal, steps = (
        GimbalLog._make([*(arrays[f"{name}.{each}"] for each in GimbalLog._fields[:4]), name])
        for name in ("gimbal", "steps")
    )
    plate, target = (
        DetectionLog._make([*(arrays[f"{name}.{each}"] for each in DetectionLog._fields[:3]), name])
        for name in ("plate", "target")
    )
    full = identify_sensing(gimbal, plate, steps=[steps], target=target, target_steps=arrays["moments"])
    alone = identify_sensing(gimbal, plate).estimates["camera.latency"]
    return {name: each[:3] for name, each in full.estimates.items()} | {"latency by the sweep alone": alone[:3]}


def figures(outcomes: NDArray[np.float64]) -> dict[str, float]:
    """Return figures of truth, estimate, low and high, shape (recordings, 4)."""
    true, value, low, high = outcomes.T
    error, covered = value - true, (low <= true) & (true <= high)
    return {
        "bias": float(error.mean()),
        "rms": float(np.sqrt(np.mean(error**2))),
        "largest": float(np.abs(error).max()),
        "half_width": float(np.median(high - low) / 2),
        "covered_percent": 100 * float(covered.mean()),
    }


def main() -> None:
    """Simulate, identify, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=240)
    parser.add_argument("--folder", help="has the recordings and what the first edition found; else they are made")
    options, first, second = parser.parse_args(), dict[str, Any](), dict[str, Any]()
    count = options.recordings
    with tempfile.TemporaryDirectory() as folder:
        paths = os.pathsep.join((str(ROOT / "src"), str(ROOT / "benchmarks")))
        if not options.folder:
            words, environment = [sys.executable, "-c", FIRST, folder, str(count)], os.environ | {"PYTHONPATH": paths}
            subprocess.run(words, env=environment, check=True)
        spent = time.process_time()
        for seed in range(count):
            with np.load(f"{options.folder or folder}/{seed}.npz") as file:
                arrays = dict(file)
            found = identified(arrays)
            for name, (true, *theirs) in json.loads(arrays["outcome"].item()).items():
                first.setdefault(name, []).append((true, *theirs))
                second.setdefault(name, []).append((true, *found[name]))
        spent = time.process_time() - spent
    rows = {
        name: {"first": figures(np.array(first[name])), "second": figures(np.array(second[name]))} for name in first
    }
    pooled = {
        edition: float(np.mean([row[edition]["covered_percent"] for row in rows.values()]))
        for edition in ("first", "second")
    }
    print(f"{'':28} {'rms, first':>11} {'second':>9} {'ratio':>6} {'covered, first':>15} {'second':>8} {'bias':>9}")
    for name, row in rows.items():
        one, two = row["first"], row["second"]
        errors = f"{one['rms']:11.2e} {two['rms']:9.2e} {two['rms'] / one['rms']:6.2f}"
        print(f"{name:28} {errors} {one['covered_percent']:13.1f} % {two['covered_percent']:6.1f} % {two['bias']:9.1e}")
    print(f"{'all':28} {'':28} {pooled['first']:13.1f} % {pooled['second']:6.1f} %")
    conditions = {"recordings": count, "cpu_seconds": spent, "machine": platform.machine(), "cores": os.cpu_count()}
    conditions |= {"date": time.strftime("%F"), "provenance": provenance(0)}
    if count >= 240:
        RESULT.write_text(json.dumps({"conditions": conditions, "covered": pooled, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()

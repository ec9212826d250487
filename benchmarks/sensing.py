"""Camera and link on simulated recordings with known truth: errors and coverage, with those of release 0.1.

`python benchmarks/sensing.py` simulates 240 recordings (sensing_recordings.py) and identifies them. Goals: each rms
error at most 1.1 times the reference, which is that of release 0.1 on the same recordings; intervals of 95 % that have
the truth in 93 to 97 % of the recordings, of which a perfect method misses a quantity in seven. Writes
results/sensing.json, where the reference stays.
"""

import argparse
import json
import os
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.sensing.identify import identify_sensing
from archerfish.provenance import provenance
from sensing_recordings import Robot, step_recording, sweep_recording

RESULT = Path(__file__).parent / "results" / "sensing.json"
RECORDINGS = 240


def outcome(seed: int) -> dict[str, tuple[float, ...]]:
    """Return truth, estimate, low and high end of each quantity of a drawn robot."""
    rng = np.random.default_rng(seed)
    robot = Robot.drawn(rng)
    gimbal, plate = sweep_recording(robot, rng)
    steps, target, moments = step_recording(robot, rng)
    full = identify_sensing(gimbal, plate, steps=[steps], target=target, target_steps=moments).estimates
    alone = identify_sensing(gimbal, plate).estimates["camera.latency"]
    found = {**full, "latency by the sweep alone": alone}
    return {name: (true, *found[name][:3]) for name, true in robot.truth().items()}


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
    parser.add_argument("--recordings", type=int, default=RECORDINGS, help="fewer are not written")
    count, reference = parser.parse_args().recordings, json.loads(RESULT.read_text())["reference"]
    spent = time.process_time()
    outcomes = [outcome(seed) for seed in range(count)]
    spent = time.process_time() - spent
    rows = {name: figures(np.array([found[name] for found in outcomes])) for name in outcomes[0]}
    pooled = float(np.mean([row["covered_percent"] for row in rows.values()]))
    print(f"{'':28} {'rms':>9} {'reference':>9} {'ratio':>6} {'covered':>9} {'reference':>11} {'bias':>9}")
    for name, row in rows.items():
        earlier = reference["rows"][name]
        errors = f"{row['rms']:9.2e} {earlier['rms']:9.2e} {row['rms'] / earlier['rms']:6.2f}"
        covered = f"{row['covered_percent']:7.1f} % {earlier['covered_percent']:9.1f} %"
        print(f"{name:28} {errors} {covered} {row['bias']:9.1e}")
    print(f"{'all':28} {'':26} {pooled:7.1f} % {reference['covered_percent']:9.1f} %")
    conditions = {"recordings": count, "cpu_seconds": spent, "machine": platform.machine(), "cores": os.cpu_count()}
    conditions |= {"date": time.strftime("%F"), "provenance": provenance(0)}
    if count >= RECORDINGS:
        content: dict[str, Any] = {"conditions": conditions, "covered_percent": pooled, "rows": rows}
        RESULT.write_text(json.dumps(content | {"reference": reference}, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""Sensing against its bars: simulated recordings with known truth, 5 mm noise, 80 fps; errors and coverage."""

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.identification.sensing.estimate import identify_sensing
from archerfish.records.provenance import provenance
from archerfish.records.sensing import sensing_values
from archerfish.records.storage import write_json
from machine import describe_machine
from sensing_recordings import Robot, step_recording, sweep_recording

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "sensing.json"

RECORDINGS = 240
LARGEST_ERROR = {"camera.time_offset": 0.002, "camera.latency": 0.005, "latency by the sweep alone": 0.005}
"""Bars on the largest error of all recordings [s]."""
COVERAGE = (90.0, 98.0)
"""Bars on the share of the 95 % intervals that hold the truth [%]."""


def drawn_robot(rng: np.random.Generator) -> Robot:
    """Draw a robot: clocks, delays, mounting and plate are anywhere that they may well be."""
    return replace(
        Robot(),
        clock=rng.uniform(-0.5, 0.5),
        latency=rng.uniform(0.015, 0.060),
        feedback_delay=rng.uniform(0.0, 0.008),
        stamp_jitter=rng.uniform(2e-4, 1.5e-3),
        plate=(rng.uniform(1.5, 5.0), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)),
        camera=tuple(rng.uniform(-0.1, 0.1, 3)),
        tilt=rng.uniform(-0.05, 0.05),
    )


def truth(robot: Robot) -> dict[str, float]:
    """Return the values that should be found, by the names of the sensing record."""
    apart = np.array(robot.plate) - robot.camera
    # The plate's distance from the camera changes as the camera swings; its line of sight stays level enough.
    bearing = robot.across / float(np.linalg.norm(apart))
    return {
        "camera.rate_hz": robot.fps,
        "camera.time_offset": robot.feedback_delay - robot.clock,
        "camera.stamp_jitter": robot.stamp_jitter,
        "camera.bearing_sd": bearing,
        "camera.elevation_sd": bearing,
        "camera.range_sd": robot.along,
        "camera.miss_probability": robot.missed,
        "camera.outlier_share": robot.outliers,
        "camera.latency": robot.latency,
        "latency by the sweep alone": robot.latency - robot.feedback_delay,
        "camera.latency_jitter": robot.latency_jitter,
        "link.command_delay": float(np.mean(robot.command_delay)) + robot.feedback_delay,
        "link.command_jitter": float(np.ptp(robot.command_delay) / np.sqrt(12)),
        "link.feedback_delay": robot.feedback_delay,
    }


def outcome(seed: int) -> dict[str, tuple[float, float, float, float]]:
    """Identify one simulated robot; return name → truth, estimate, low and high end of its interval."""
    rng = np.random.default_rng(seed)
    robot = drawn_robot(rng)
    gimbal, plate = sweep_recording(robot, rng)
    steps, target, moments = step_recording(robot, rng)
    both = identify_sensing([gimbal, steps], [plate, target], moments).sensing
    alone = identify_sensing([gimbal], [plate]).sensing
    found = {name: (value, *both.intervals.get(name, (np.nan, np.nan))) for name, value in sensing_values(both).items()}
    found["latency by the sweep alone"] = (sensing_values(alone)["camera.latency"], *alone.intervals["camera.latency"])
    return {name: (value, *found[name]) for name, value in truth(robot).items()}


def main() -> None:
    """Run all recordings, write the results and print them; exit with 1 if a bar is missed."""
    start = time.perf_counter()
    outcomes = [outcome(seed) for seed in range(RECORDINGS)]
    rows = [_row(name, np.array([each[name] for each in outcomes])) for name in outcomes[0]]
    content = {"recordings": RECORDINGS, "seconds_per_recording": (time.perf_counter() - start) / RECORDINGS}
    origin = {"machine": describe_machine(), "provenance": provenance(0)}
    write_json(RESULT, {**content, **origin, "rows": rows})
    for row in rows:
        print(
            f"{row['name']:28} bias {row['bias']:+.2e}  rms error {row['rms_error']:.2e}  largest "
            f"{row['largest_error']:.2e}  half width {row['half_width']:.2e}  covered {row['covered_percent']:5.1f} %"
        )
    missed = [row["name"] for row in rows if row["missed"]]
    if missed:
        sys.exit(f"beside the bar: {', '.join(missed)}")


def _row(name: str, outcomes: np.ndarray) -> dict[str, Any]:
    true, value, low, high = outcomes.T
    error, covered = value - true, 100 * float(np.mean((low <= true) & (true <= high)))
    largest, bar = float(np.abs(error).max()), LARGEST_ERROR.get(name)
    return {
        "name": name,
        "bias": float(error.mean()),
        "rms_error": float(np.sqrt(np.mean(error**2))),
        "largest_error": largest,
        "largest_error_bar": bar,
        "half_width": float(np.median(high - low) / 2),
        "covered_percent": covered,
        "covered_bar_percent": list(COVERAGE),
        "missed": (bar is not None and largest > bar) or not COVERAGE[0] <= covered <= COVERAGE[1],
    }


if __name__ == "__main__":
    main()

"""Hit rates through the bytes of a wire, and of the same controller on the same virtual robot without a wire.

`python benchmarks/rehearsal.py`: kalman, with the settings where its tuning begins, on the infantry with its records in
tests/infantry; a plate that swings by 0.4 m at 3 m and three frequencies. Through bytes the computer dates messages by
when it receives them and estimates the clock of the camera; offline it has their exact stamps. Goal: within 1.5 points
through sp_vision_25, and no violation. Some minutes. Writes results/rehearsal.json.
"""

import argparse
import json
import os
import platform
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import archerfish as af
from alternating import ROOT
from archerfish.controllers.registry import make_controller
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.protocols import Engagement
from archerfish.provenance import provenance
from archerfish.studies.rehearse import COUNTED_FROM_S, SwingingPlate, rehearse
from archerfish.targets.motion import disc

WIRES, FREQUENCIES_HZ, SEEDS, SECONDS, OFFLINE = ("sp_vision_25", "roborts"), (0.25, 0.4, 0.6), 4, 20, 8
RESULT = ROOT / "benchmarks" / "results" / "rehearsal.json"


def offline(robot: af.Robot, target: SwingingPlate, count: int) -> HitRate:
    """Return the hit rate of some robots in lockstep, over the times that a rehearsal counts."""
    task = af.Task.load("any")
    world = af.VirtualRobot.load("infantry").world(robot, task)
    controller = make_controller("kalman", robot, task)
    decisions = round((COUNTED_FROM_S + SECONDS) / task.period_s)
    shape = (count, decisions, world.normals)
    normals = np.random.default_rng(0).standard_normal(shape).astype(np.float32)
    start = np.zeros((count, 2), np.float32)
    engagement = Engagement(disc(target, np.zeros((count, 3))), start, np.zeros(count, int), np.full(count, 1e3))
    running = world.begin(engagement, normals)
    hits: list[NDArray[np.bool_]] = []
    state = None
    for number in range(decisions):
        seen = world.see(running)
        if state is None:
            state = controller.reset(seen)
        state, command = controller.step(state, seen)
        running, shot = world.step(running, command, normals[:, number])
        hits.append(np.asarray(shot.fired & (shot.margin >= 0.0)))
    counted = np.stack(hits[-round(SECONDS / task.period_s) :], axis=1)
    by_second = counted.reshape(count * SECONDS, -1).sum(axis=1)
    return hit_rate(by_second, round(1.0 / task.period_s))


def through_bytes(robot: af.Robot, target: SwingingPlate, wire: str, seeds: int) -> tuple[HitRate, dict[str, int]]:
    """Return the hit rate of rehearsals of several seeds, and their violations."""
    runs = [
        rehearse("kalman", robot, wire=wire, seconds=SECONDS, seed=seed, target=target, tuning="start")
        for seed in range(seeds)
    ]
    violations: dict[str, int] = {}
    for run in runs:
        violations |= {name: violations.get(name, 0) + count for name, count in run.violations.items()}
    return hit_rate([hits for run in runs for hits in run.hits], round(1.0 / runs[0].period_s)), violations


def row(rate: HitRate) -> dict[str, Any]:
    """Return a hit rate in percent."""
    percent = {"percent": 100 * rate.rate, "low": 100 * rate.low, "high": 100 * rate.high}
    return {"hits": rate.hits, "shots": rate.decisions, **percent}


def main() -> None:
    """Shoot, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="through bytes; the result of fewer isn't written")
    seeds = parser.parse_args().seeds
    robot = af.Robot.load(ROOT / "tests" / "infantry")
    rows = []
    print(
        f"{'frequency':10} {'through':14} {'hits':>6} {'shots':>6} {'rate':>7} {'95 %':>15} {'points':>7}  violations"
    )
    for frequency in FREQUENCIES_HZ:
        target = SwingingPlate(frequency_hz=frequency)
        alone = offline(robot, target, OFFLINE)
        found = {"no wire": (alone, {}), **{wire: through_bytes(robot, target, wire, seeds) for wire in WIRES}}
        for wire, (rate, violations) in found.items():
            points = 100 * (rate.rate - alone.rate)
            rows.append(
                {"frequency_hz": frequency, "wire": wire, **row(rate), "points": points, "violations": violations}
            )
            interval = f"{100 * rate.low:.1f}–{100 * rate.high:.1f}"
            text = f"{rate.hits:6} {rate.decisions:6} {100 * rate.rate:6.2f}% {interval:>15} {points:+7.2f}"
            print(f"{frequency:7g} Hz {wire:14} {text}  {violations or 'none'}")
    conditions = {"seeds": seeds, "seconds": SECONDS, "controller": "kalman", "tuning": "start", "robot": "infantry"}
    conditions |= {"machine": platform.machine(), "cores": os.cpu_count(), "date": time.strftime("%F")}
    if seeds >= SEEDS:
        content = {"conditions": conditions | {"provenance": provenance(0)}, "rows": rows}
        RESULT.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()

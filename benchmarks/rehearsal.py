"""Hit rates through the bytes of a wire, and of the same controller on the same virtual robot without a wire.

`python benchmarks/rehearsal.py`: kalman and kalman-lq, with the settings where their tuning begins, and a policy of 1.5
million decisions, on the infantry with its records in tests/infantry. A plate swings by 0.4 m at 3 m and two
frequencies; it is seen for 3 s, then hidden for 2 s, and so on. Through bytes the computer dates messages by when it
receives them and estimates the clock of the camera; offline it has their exact stamps. On both sides the same frames
show nothing, and a controller that has seen no plate for a second begins again. Decisions while the plate is seen
count; one without fire is a miss. The intervals of the differences are of pairs of seconds with the same motion.

Goal: within 1.5 points of the rate offline, 95 % interval within ±3, and no violation. A quarter of an hour. Writes
results/rehearsal.json.
"""

import argparse
import json
import os
import platform
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from archerfish.codegen.export import for_robot
from numpy.typing import NDArray

import archerfish as af
from alternating import ROOT
from archerfish.evaluation.hit_rate import Difference, HitRate, hit_rate, paired_difference
from archerfish.protocols import Command, Engagement
from archerfish.provenance import provenance
from archerfish.studies.rehearse import COUNTED_FROM_S, SwingingPlate, rehearse
from archerfish.targets.motion import disc
from archerfish.tracking.detections import GUESS_AGE_S
from archerfish.tracking.host import Host
from archerfish.virtual_robot.emulator import Fault
from archerfish.virtual_robot.flights import Received
from archerfish.virtual_robot.world import RobotWorld

WIRES, FREQUENCIES_HZ, RUNS, ENGAGEMENTS = ("sp_vision_25", "roborts"), (0.25, 0.4), 3, 10
SEEN_S, HIDDEN_S, STEPS = 3, 2, 1_500_000
SECONDS = ENGAGEMENTS * (SEEN_S + HIDDEN_S)
RESULT = ROOT / "benchmarks" / "results" / "rehearsal.json"
HIDDEN = [
    Fault("hidden", COUNTED_FROM_S + second + SEEN_S, COUNTED_FROM_S + second + SEEN_S + HIDDEN_S)
    for second in range(0, SECONDS, SEEN_S + HIDDEN_S)
]
Counts = NDArray[np.int64]


class Row(NamedTuple):
    """Hits of a controller, in seconds in which the plate is seen."""

    rate: HitRate
    difference: Difference | None  # to the rate offline
    violations: dict[str, int]  # of the robot's limits


class WorldWithHiding(RobotWorld):
    """The virtual robot, whose camera shows no plate while it is hidden."""

    def _with(self, host: Host, received: Received, now_s: float) -> Host:
        arrived, found = received.detections.received_s, received.detections.found
        for hidden in HIDDEN:
            found = found & ~((hidden.begin_s <= arrived) & (arrived < hidden.end_s))[..., None]
        return super()._with(host, received._replace(detections=received.detections._replace(found=found)), now_s)


def seen_seconds(hits: Counts) -> Counts:
    """Return the hits of those seconds in which the plate is seen, of shape (SECONDS,)."""
    return hits.reshape(ENGAGEMENTS, -1)[:, :SEEN_S].ravel()


def offline(controller: Any, robot: af.Robot, target: SwingingPlate, seed: int) -> Counts:
    """Return the hits in each second in which the plate is seen, without a wire and a gate."""
    _, made, task = for_robot(controller, robot, af.Task.load("any"), "start")
    world: Any = WorldWithHiding(af.VirtualRobot.load("infantry").description, robot, task)
    decisions = round((COUNTED_FROM_S + SECONDS) / task.period_s)
    normals = np.random.default_rng(seed).standard_normal((1, decisions, world.normals)).astype(np.float32)
    start = np.zeros((1, 2), np.float32)
    running = world.begin(Engagement(disc(target, np.zeros((1, 3))), start, np.zeros(1, int), np.full(1, 1e3)), normals)
    hits, state = list[bool](), None
    for number in range(decisions):
        if running.robots.time - running.host.plate.exposed_s[0] > GUESS_AGE_S:
            state, command = (
                None,
                Command(running.command, 0.0 * running.command, np.zeros(1, bool), np.full(1, np.nan)),
            )
        else:
            seen = world.see(running)
            state = made.reset(seen) if state is None else state
            state, command = made.step(state, seen)
        running, shot = world.step(running, command, normals[:, number])
        hits.append(bool(shot.fired[0] & (shot.margin[0] >= 0.0)))
    counted = np.array(hits[-round(SECONDS / task.period_s) :])
    return seen_seconds(counted.reshape(SECONDS, -1).sum(axis=1))


def through_bytes(
    controller: Any, robot: af.Robot, target: SwingingPlate, wire: str, seed: int
) -> tuple[Counts, dict[str, int]]:
    """Return the hits in each second in which the plate is seen, and the violations of the robot's limits."""
    found = rehearse(
        controller, robot, wire=wire, seconds=SECONDS, seed=seed, target=target, tuning="start", faults=HIDDEN
    )
    if found.fault:
        raise RuntimeError(f"{found.controller} was replaced by the fallback: {found.fault}")
    return seen_seconds(np.array(found.hits)), found.violations


def compared(controller: Any, robot: af.Robot, target: SwingingPlate, runs: int) -> dict[str, Row]:
    """Return the row without a wire and that of each wire."""
    per_second = round(1.0 / 0.02)
    alone = np.concatenate([offline(controller, robot, target, seed) for seed in range(runs)])
    rows = {"no wire": Row(hit_rate(alone, per_second), None, {})}
    for wire in WIRES:
        pairs = [through_bytes(controller, robot, target, wire, seed) for seed in range(runs)]
        hits = np.concatenate([counts for counts, _ in pairs])
        violations = Counter[str]()
        for _, counts in pairs:
            violations.update(counts)
        rows[wire] = Row(hit_rate(hits, per_second), paired_difference(hits, alone, per_second), dict(violations))
    return rows


def entry(row: Row) -> dict[str, Any]:
    """Return a row in percent and points."""
    rate, difference = row.rate, row.difference
    found: dict[str, Any] = {"hits": rate.hits, "shots": rate.decisions, "violations": row.violations}
    found |= {"percent": 100 * rate.rate, "low": 100 * rate.low, "high": 100 * rate.high}
    if difference is not None:
        points = {"points": difference.difference, "points_low": difference.low, "points_high": difference.high}
        found |= {name: 100 * value for name, value in points.items()}
    return found


def main() -> None:
    """Shoot, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=RUNS, help="of 30 s each; the result of fewer isn't written")
    parser.add_argument("--policy", type=Path, help="trained on tests/infantry; a short training if not given")
    options = parser.parse_args()
    robot = af.Robot.load(ROOT / "tests" / "infantry")
    with tempfile.TemporaryDirectory() as folder:
        policy = options.policy or Path(folder, "policy")
        if options.policy is None:
            af.train(robot, "any", steps=STEPS, out=policy)
        controllers = {"kalman": "kalman", "kalman-lq": "kalman-lq", "policy": af.Policy.load(policy)}
    rows = []
    print(f"{'controller':10} {'frequency':9} {'through':13} {'hits':>6} {'shots':>6} {'rate':>7} {'points':>18}")
    for name, controller in controllers.items():
        for frequency in FREQUENCIES_HZ:
            target = SwingingPlate(frequency_hz=frequency)
            for wire, row in compared(controller, robot, target, options.runs).items():
                rows.append({"controller": name, "frequency_hz": frequency, "wire": wire, **entry(row)})
                rate, difference = row.rate, row.difference
                points = (
                    "" if difference is None else "{:+.2f} ({:+.1f}…{:+.1f})".format(*(100 * x for x in difference))
                )
                text = f"{rate.hits:6} {rate.decisions:6} {100 * rate.rate:6.2f}% {points:>18} {row.violations or ''}"
                print(f"{name:10} {frequency:6g} Hz {wire:13} {text}", flush=True)
    conditions = {"runs": options.runs, "seconds": SECONDS, "seen_s": SEEN_S, "hidden_s": HIDDEN_S, "tuning": "start"}
    conditions |= {"policy_steps": STEPS, "robot": "infantry", "virtual": "infantry"}
    conditions |= {"machine": platform.machine(), "cores": os.cpu_count(), "date": time.strftime("%F")}
    if options.runs >= RUNS:
        content = {"conditions": conditions | {"provenance": provenance(0)}, "rows": rows}
        RESULT.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()

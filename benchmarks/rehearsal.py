"""Hit rates through the bytes of a wire, and of the same controller on the same virtual robot without a wire.

`python benchmarks/rehearsal.py`: kalman and kalman-lq, with the settings where their tuning begins, and a policy of 1.5
million decisions, on the infantry with its records in tests/infantry. A plate swings by 0.4 m at 3 m and two
frequencies; it is seen for 3 s, then hidden for 2 s, and so on. Through bytes the computer dates messages by when it
receives them and estimates the clock of the camera; offline it has their exact stamps. On both sides the robot has the
same noise and the same phase of its camera, the same frames show nothing, and a controller that has seen no plate for a
second begins again. Pellets while the plate is seen count. The gate fires none where the limits change the command by
more than 0.02 rad, and a pilot none before it has seen the plate again, so these are no shots offline either. The
intervals are of the differences between pairs of engagements.

Goal: within 1.5 points of the rate offline, 95 % interval within ±3, and no violation. Twenty minutes. Writes
results/rehearsal.json.
"""

import argparse
import itertools
import json
import math
import os
import platform
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

import archerfish as af
from alternating import ROOT
from archerfish.protocols import Command, Engagement
from archerfish.provenance import provenance
from archerfish.studies.export import for_robot
from archerfish.studies.rehearsal import COUNTED_FROM_S
from archerfish.studies.rehearse import SwingingPlate, rehearse
from archerfish.targets.motion import disc
from archerfish.tracking.detections import GUESS_AGE_S
from archerfish.tracking.host import Host
from archerfish.virtual_robot.emulator import Fault
from archerfish.virtual_robot.flights import Received
from archerfish.virtual_robot.world import RobotWorld

WIRES, FREQUENCIES_HZ, RUNS, ENGAGEMENTS = ("sp_vision_25", "roborts"), (0.4, 0.25), 3, 10
SEEN_S, HIDDEN_S, STEPS = 3, 2, 1_500_000
NOTICEABLE = 0.02  # change of a command by the limits with which the gate fires nothing [rad]
SECONDS = ENGAGEMENTS * (SEEN_S + HIDDEN_S)
RESULT = ROOT / "benchmarks" / "results" / "rehearsal.json"
HIDDEN = [
    Fault("hidden", COUNTED_FROM_S + second + SEEN_S, COUNTED_FROM_S + second + SEEN_S + HIDDEN_S)
    for second in range(0, SECONDS, SEEN_S + HIDDEN_S)
]
Counts = NDArray[np.int64]


class Shots(NamedTuple):
    """Pellets and hits of each engagement, while the plate is seen, and violations of the robot's limits."""

    hits: Counts  # (N,)
    fired: Counts  # (N,)
    violations: Counter[str]

    @property
    def rates(self) -> NDArray[np.float64]:
        """Hits per pellet of each engagement [%], shape (N,)."""
        return 100.0 * self.hits / self.fired


class WorldWithHiding(RobotWorld):
    """The virtual robot, whose camera shows no plate while it is hidden."""

    def _with(self, host: Host, received: Received, now_s: float) -> Host:
        arrived, found = received.detections.received_s, received.detections.found
        for hidden in HIDDEN:
            found = found & ~((hidden.begin_s <= arrived) & (arrived < hidden.end_s))[..., None]
        return super()._with(host, received._replace(detections=received.detections._replace(found=found)), now_s)


def while_seen(by_second: Counts) -> Counts:
    """Return the sums over the seconds in which the plate is seen, shape (SECONDS,) → (ENGAGEMENTS,)."""
    return np.asarray(by_second.reshape(ENGAGEMENTS, -1)[:, :SEEN_S].sum(axis=1))


def offline(controller: Any, robot: af.Robot, target: SwingingPlate, seed: int) -> Shots:
    """Return the shots of a run without a wire and a gate."""
    _, made, task = for_robot(controller, robot, af.Task.load("any"), "start")
    world: Any = WorldWithHiding(af.VirtualRobot.load("infantry").description, robot, task)
    decisions = round((COUNTED_FROM_S + SECONDS) / task.period_s)
    normals = np.random.default_rng(seed).standard_normal((1, decisions, world.normals)).astype(np.float32)
    normals[0, 0, :2] = np.array([0, seed], np.uint32).view(np.float32)  # the world makes of it the seed of its robot
    start = np.zeros((1, 2), np.float32)
    running = world.begin(Engagement(disc(target, np.zeros((1, 3))), start, np.zeros(1, int), np.full(1, 1e3)), normals)
    hits, fired, state = list[bool](), list[bool](), None
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
        is_kept = np.all(np.abs(running.command - command.angle) <= NOTICEABLE)
        fired.append(bool(shot.fired[0] and is_kept))
        hits.append(bool(fired[-1] and shot.margin[0] >= 0.0))
    counted = np.array([hits, fired])[:, -round(SECONDS / task.period_s) :]
    hits_by_second, fired_by_second = counted.reshape(2, SECONDS, -1).sum(axis=-1)
    return Shots(while_seen(hits_by_second), while_seen(fired_by_second), Counter())


def through_bytes(controller: Any, robot: af.Robot, target: SwingingPlate, wire: str, seed: int) -> Shots:
    """Return the shots of a rehearsal."""
    found = rehearse(
        controller,
        robot,
        wire=wire,
        seconds=SECONDS,
        seed=seed,
        target=target,
        tuning="start",
        faults=HIDDEN,
        switch_on_s=[(1.0, math.inf)],  # else off after each
    )
    if found.fault:
        raise RuntimeError(f"{found.controller} was replaced by the fallback: {found.fault}")
    hits, fired = while_seen(np.array(found.hits)), while_seen(np.array(found.fired))
    return Shots(hits, fired, Counter(found.violations))


def joined(runs: list[Shots]) -> Shots:
    """Return the shots of several runs."""
    hits, fired, violations = zip(*runs, strict=True)
    return Shots(np.concatenate(hits), np.concatenate(fired), sum(violations, Counter()))


def entry(shots: Shots, alone: Shots | None) -> dict[str, Any]:
    """Return counts, the rate [%], and the difference to that without a wire, with its 95 % interval [points]."""
    hits, fired = int(shots.hits.sum()), int(shots.fired.sum())
    found: dict[str, Any] = {"hits": hits, "shots": fired, "percent": 100.0 * hits / fired}
    found["violations"] = dict(shots.violations)
    if alone is not None:
        differences = shots.rates - alone.rates
        half = stdtrit(len(differences) - 1, 0.975) * np.std(differences, ddof=1) / np.sqrt(len(differences))
        points = found["percent"] - 100.0 * float(alone.hits.sum()) / float(alone.fired.sum())
        found |= {"points": points, "points_low": points - half, "points_high": points + half}
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
    print(f"{'controller':10} {'frequency':9} {'through':13} {'hits':>6} {'shots':>6} {'rate':>7} {'points':>20}")
    for frequency, (name, controller) in itertools.product(FREQUENCIES_HZ, controllers.items()):
        target, alone = SwingingPlate(frequency_hz=frequency), None
        for wire in ("no wire", *WIRES):
            if wire == "no wire":
                shots = alone = joined([offline(controller, robot, target, seed) for seed in range(options.runs)])
                row = entry(shots, None)
            else:
                pairs = [through_bytes(controller, robot, target, wire, seed) for seed in range(options.runs)]
                row = entry(joined(pairs), alone)
            rows.append({"controller": name, "frequency_hz": frequency, "wire": wire, **row})
            text = f"{row['hits']:6} {row['shots']:6} {row['percent']:6.2f}%"
            if "points" in row:
                text += f"  {row['points']:+.2f} ({row['points_low']:+.2f}…{row['points_high']:+.2f})"
            print(f"{name:10} {frequency:6g} Hz {wire:13} {text} {row['violations'] or ''}", flush=True)
    conditions = {"runs": options.runs, "seconds": SECONDS, "seen_s": SEEN_S, "hidden_s": HIDDEN_S, "tuning": "start"}
    conditions |= {"policy_steps": STEPS, "robot": "infantry", "virtual": "infantry"}
    conditions |= {"machine": platform.machine(), "cores": os.cpu_count(), "date": time.strftime("%F")}
    if options.runs >= RUNS:
        content = {"conditions": conditions | {"provenance": provenance(0)}, "rows": rows}
        RESULT.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()

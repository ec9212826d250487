"""Pairs of faults that overlap, in virtual time and through bytes: what the gate, and all around it, must keep.

`python benchmarks/campaign.py [--seeds N]`: every kind of fault alone and every pair of two, N seeds each, 3 if not
given. The infantry with its records in tests/infantry, through sp_vision_25, at 50 decisions a second. The kinds are
those of the emulator, a computer that stops for 0.3 s, and a controller that raises or has no number, with a fallback
behind it. Begins and lengths (0.04 to 0.8 s) are random, and so is a moment at which the operator switches off for
0.3 s; at 4 s he switches off, and on again at 4.8 s.

Goals, in every run: no violation of the monitor, which has fire on feedback older than 50 ms (and 25 ms of transit) as
one; a fault after at most 100 ms and one decision of bad input; left only with the switch off and after 0.5 s of good
input; shooting again once the switch went off and on. This wire has no time stamps, so reports that the line has kept
back look fresh to a computer when they arrive: in the 0.5 s they count as good input, and runs in which a fault was
left on them are counted apart. Some minutes. Writes results/campaign.json.
"""

import argparse
import collections
import itertools
import json
import math
import os
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import archerfish as af
from archerfish.controllers.registry import make_controller
from archerfish.protocols import Seen
from archerfish.provenance import provenance
from archerfish.runtime.deciders import Decider, WithFallback, make_decider
from archerfish.runtime.pilot import Pilot
from archerfish.safety.gate import Mode
from archerfish.safety.rules import GateConfig
from archerfish.studies.rehearse import SwingingPlate, emulated_robot
from archerfish.virtual_robot.emulator import FAULTS, Fault
from archerfish.virtual_robot.monitor import TRANSIT_S
from archerfish.wires import load_wire

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "campaign.json"
INFANTRY, TASK, WIRE = ROOT / "tests" / "infantry", "any", "sp_vision_25"
PERIOD_S, SECONDS, SEEDS = 0.02, 6.0, 3
OFF_S, ON_S = 4.0, 4.8  # the switch goes off after the faults, and on again
BEGIN_S, LENGTH_S, STOP_S = (1.6, 2.0), (0.04, 0.8), 0.3
OF_THE_COMPUTER = ("stopped", "raises", "no number")
KINDS = (*FAULTS, *OF_THE_COMPUTER)
FAULT_AFTER_S = 0.1 + PERIOD_S  # without good input
STEADY_S, STALE_S = 0.5, 0.05
NUMBERS = (math.nan, 1e9, math.inf)  # of a controller that has none, by the seed [rad]
LINK_S = 0.003  # the oldest that a report is when it arrives


@dataclass
class Trial:
    """What became of the decisions of a run."""

    time: NDArray[np.float64]  # (N,)
    mode: NDArray[np.float64]  # of the gate, (N,)
    fire: NDArray[np.bool_]  # (N,)
    switch_on: NDArray[np.bool_]  # as the newest report had it, (N,)
    age: NDArray[np.float64]  # of the newest undamaged report that has arrived [s], (N,)
    since_report: NDArray[np.float64]  # since an undamaged report arrived, late or not [s], (N,)
    stalled: NDArray[np.bool_]  # whether the computer has stopped since the decision before, (N,)
    violations: dict[str, int]  # of the monitor


class Broken:
    """A Kalman filter that raises, or has another number, in some times."""

    def __init__(self, robot: af.Robot, task: af.Task, faults: Sequence[Fault], number: float = math.nan) -> None:
        """Take the times in which it is broken, of faults of the kinds "raises" and "no number"."""
        self._kalman: Any = make_controller("kalman", robot, task)
        self._faults, self._number = faults, number
        self.time = 0.0
        """Present time, which the trial sets [s]."""

    def reset(self, seen: Seen, truth: Any = None) -> Any:
        """Return the memory of the filter."""
        return self._kalman.reset(seen, truth)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Any]:
        """Decide, or not."""
        state, command = self._kalman.step(state, seen)
        kinds = {fault.kind for fault in self._faults if fault.begin_s <= self.time < fault.end_s}
        if "raises" in kinds:
            raise RuntimeError("broken")
        if "no number" in kinds:
            command = command._replace(angle=np.full_like(np.asarray(command.angle), self._number))
        return state, command


def run(
    faults: Sequence[Fault],
    *,
    seed: int = 1,
    switch_on_s: Sequence[tuple[float, float]] = ((0.8, OFF_S), (ON_S, 9.0)),
    seconds: float = SECONDS,
    number: float = math.nan,
    fallback: bool = True,
    records: tuple[af.Robot, af.Task] | None = None,
) -> Trial:
    """Shoot through bytes with some faults.

    Args:
      faults: of `KINDS`; what arrives while the computer is stopped is discarded, as the loop does after a stall.
      seed: of the robot's noise and of the faults.
      switch_on_s: when the operator's switch is on [s].
      seconds: in all [s].
      number: in the place of the angles where the controller has none.
      fallback: whether there is one behind the controller.
      records: robot and task, where they were loaded before.
    """
    robot, task = records or (af.Robot.load(INFANTRY), af.Task.load(TASK))
    of_the_robot = [fault for fault in faults if fault.kind in FAULTS]
    emulator = emulated_robot(
        "infantry", robot, task, [WIRE], SwingingPlate(), seed=seed, faults=of_the_robot, switch_on_s=switch_on_s
    )
    broken = Broken(robot, task, faults, number)
    decider: Decider = make_decider("broken", broken, robot, task, GateConfig())
    if fallback:
        kalman = make_controller("kalman", robot, task)
        decider = WithFallback(decider, make_decider("kalman", kalman, robot, task, GateConfig()), math.inf)
    pilot = Pilot(decider, robot, task, load_wire(WIRE))
    rows = []
    stalled, reported_s = False, -math.inf
    for count in range(1, round(seconds / PERIOD_S) + 1):
        arrived = emulator.advance(round(1e3 * PERIOD_S))
        broken.time = count * PERIOD_S
        if any(fault.kind == "stopped" and fault.begin_s <= broken.time < fault.end_s for fault in faults):
            stalled = True
            continue
        for delivery in () if stalled else arrived:
            take = pilot.on_datagram if delivery.is_datagram else pilot.on_bytes
            take(1000.0 + delivery.time_s, delivery.data)
            if delivery.informs_s > -math.inf:
                reported_s = delivery.time_s
        ages = emulator.time - emulator.informed_s, emulator.time - reported_s
        emulator.on_bytes(pilot.tick(1000.0 + emulator.time))
        if pilot.verdict is not None:
            mode, fire = int(pilot.verdict.mode), bool(pilot.verdict.fire)
            rows.append((emulator.time, mode, fire, pilot.switch, *ages, stalled))
        stalled = False
    times, modes, fires, switches, age, since_report, stalls = np.array(rows).T
    violations = dict(+emulator.monitor.violations)
    return Trial(times, modes, fires > 0, switches > 0, age, since_report, stalls > 0, violations)


def broken_rules(trial: Trial, *, shoots_again_s: float = ON_S + 0.2) -> collections.Counter[str]:
    """Return how often each rule was broken.

    Args:
      trial: the run.
      shoots_again_s: from here on it must be armed, and fire at more than half of the decisions [s].
    """
    found = collections.Counter(trial.violations)
    is_commanding = (trial.mode == Mode.ARMED) | (trial.mode == Mode.HOLD)
    is_bad = trial.age > FAULT_AFTER_S + LINK_S
    found["no fault after 100 ms and a decision"] += int(np.sum(is_bad & is_commanding))
    found["no fault after a stop"] += int(np.sum(trial.stalled & is_commanding))
    for end, before in left_faults(trial):
        is_good = np.all(trial.since_report[before] <= STALE_S) and not np.any(trial.stalled[before])
        found["fault left with the switch on"] += int(trial.switch_on[end] or trial.mode[end] != Mode.DISARMED)
        found["fault left before 0.5 s of good input"] += int(not is_good)
    after = trial.time > shoots_again_s
    found["not armed again"] += int(np.any(trial.mode[after] != Mode.ARMED))
    found["not shooting again"] += int(np.mean(trial.fire[after]) <= 0.5)
    return +found


def left_faults(trial: Trial) -> list[tuple[int, NDArray[np.bool_]]]:
    """Return the decisions at which a fault was left, and which decisions are in the 0.5 s before, shape (N,)."""
    ends = np.flatnonzero((trial.mode[:-1] == Mode.FAULT) & (trial.mode[1:] != Mode.FAULT)) + 1
    ago = [trial.time[end] - trial.time for end in ends]
    return [(int(end), (since >= 0.0) & (since < STEADY_S - 1e-6)) for end, since in zip(ends, ago, strict=True)]


def overlapping(kinds: Sequence[str], seed: int) -> tuple[list[Fault], list[tuple[float, float]]]:
    """Return faults of some kinds, each of which begins during the one before, and the times of the switch."""
    draws = np.random.default_rng([seed, *(KINDS.index(kind) for kind in kinds)])
    begin = draws.uniform(*BEGIN_S)
    faults = []
    for kind in kinds:
        length = STOP_S if kind == "stopped" else float(np.exp(draws.uniform(*np.log(LENGTH_S))))
        faults.append(Fault(kind, begin, begin + length))
        begin += draws.uniform(0.0, 0.8) * length
    off = draws.uniform(BEGIN_S[0], BEGIN_S[1] + LENGTH_S[1])
    return faults, [(0.8, off), (off + 0.3, OFF_S), (ON_S, math.inf)]


def main() -> None:
    """Run all, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each pair; the result of fewer isn't written")
    seeds = parser.parse_args().seeds
    records = af.Robot.load(INFANTRY), af.Task.load(TASK)
    combinations = [(), *((kind,) for kind in KINDS), *itertools.combinations(KINDS, 2)]
    broken, fired, left_late = collections.Counter[str](), 0, 0
    per_kind = {kind: collections.Counter[str]() for kind in KINDS}
    failures, runs, begun = list[dict[str, Any]](), 0, time.monotonic()
    for kinds, seed in itertools.product(combinations, range(seeds)):
        faults, switch_on_s = overlapping(kinds, seed)
        trial = run(faults, seed=seed, switch_on_s=switch_on_s, number=NUMBERS[seed % len(NUMBERS)], records=records)
        found = broken_rules(trial)
        runs, fired = runs + 1, fired + int(trial.fire.sum())
        left_late += any(np.any(trial.age[before] > STALE_S + TRANSIT_S) for _, before in left_faults(trial))
        is_latched = bool(np.any(trial.mode == Mode.FAULT))
        for kind in kinds:
            per_kind[kind] += collections.Counter({"runs": 1, "latched": is_latched, "broken": bool(found)})
        if found:
            broken += found
            failures.append({"faults": faults, "off_s": switch_on_s[0][1], "seed": seed, "broken": dict(found)})
            print(*(f"{fault.kind} {fault.begin_s:.3f} {fault.end_s:.3f};" for fault in faults), end=" ")
            print(f"off {switch_on_s[0][1]:.3f}; seed {seed}: {dict(found)}", flush=True)
    print(f"\n{'kind':16} {'runs':>5} {'latched a fault':>16} {'broke a rule':>13}")
    for kind, counts in per_kind.items():
        print(f"{kind:16} {counts['runs']:5} {counts['latched']:16} {counts['broken']:13}")
    print(f"{runs} runs, {fired} shots, broken: {dict(broken) or 'none'}; a fault left on late reports: {left_late}")
    conditions = {"seeds": seeds, "seconds": SECONDS, "wire": WIRE, "controller": "kalman", "robot": "infantry"}
    conditions |= {"machine": platform.machine(), "cores": os.cpu_count(), "date": time.strftime("%F")}
    conditions |= {"minutes": round((time.monotonic() - begun) / 60.0, 1), "provenance": provenance(0)}
    if seeds >= SEEDS:
        content = {"conditions": conditions, "runs": runs, "shots": fired, "broken": broken, "left_late": left_late}
        content |= {"kinds": per_kind, "failures": failures}
        RESULT.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()

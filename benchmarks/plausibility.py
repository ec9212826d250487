"""The identified plant as a watchdog on the virtual robots: false alarms, and when faults of the feedback are found.

`python benchmarks/plausibility.py [--seed N]`: kalman and kalman-lq shoot for twelve minutes each at the eight kinds of
motion of the task `any` and at eq (7), on the infantry, on a stranger (the infantry's description with inertias,
friction and gains that are drawn within 0.7…1.4 of it; recorded and identified here), on the worn robot with a plant of
its own, and on the worn robot with the plant of the infantry. The feedback of each decision is compared with the
prediction from the commands sent. Then the same feedback has faults from 1.5 s on.

A fault counts from the first of three decisions in a row in which it moves an axis of the feedback by more than is
noticeable: 20 mrad, half a small plate at 3 m, and at least twice the axis' threshold. That is when the fault begins,
or, of feedback that is late or stuck, when the gimbal has moved so far. A slower target shows nothing, and loses
nothing. Engagements that end before the fault's limit are left out. Takes some minutes. Writes
results/plausibility.json, unless a seed is given.
"""

import argparse
import json
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.dynamics.linear_axis import GimbalModel, gimbal_angle, gimbal_rate
from archerfish.safety.plausibility import compare_with_prediction, resting_prediction, thresholds
from archerfish.virtual_robot.description_file import robot_path

INFANTRY = ROOT / "tests" / "infantry"
ENGAGEMENTS = {"any": 256, "paper": 32}  # of 3 s
PERIOD_MS, BEGIN, NOTICEABLE_RAD = 20, 75, 0.02
DRAWN = "armature damping friction inertia roll_inertia pitch_inertia yaw_inertia angle_gain rate_gain integral_gain"
STRANGER_SEED, FACTOR = 7, 1.4


class Fault(NamedTuple):
    """A fault of the feedback."""

    limit: int  # decisions in which it should be found
    apply: Callable[[Any, int], Any]  # angles of shape (N, T, 2), decision → angles of shape (N, 2)


def stuck(axis: int) -> Callable[[Any, int], Any]:
    """Return the fault of an axis whose angle stays."""
    is_stuck = np.arange(2) == axis
    return lambda angles, at: np.where(is_stuck, angles[:, BEGIN], angles[:, at])


FAULTS = {
    "yaw has the other sign": Fault(5, lambda angles, at: angles[:, at] * [1.0, -1.0]),
    "pitch has the other sign": Fault(5, lambda angles, at: angles[:, at] * [-1.0, 1.0]),
    "degrees": Fault(5, lambda angles, at: np.degrees(angles[:, at])),
    "axes exchanged": Fault(5, lambda angles, at: angles[:, at, ::-1]),
    "yaw 0.05 rad off": Fault(5, lambda angles, at: angles[:, at] + [0.0, 0.05]),
    "pitch 0.05 rad off": Fault(5, lambda angles, at: angles[:, at] + [0.05, 0.0]),
    "0.2 s late": Fault(15, lambda angles, at: angles[:, at - 10]),
    "yaw stuck": Fault(30, stuck(1)),
    "pitch stuck": Fault(30, stuck(0)),
}


def stranger(path: Path) -> af.VirtualRobot:
    """Write the description of another robot, and load it."""
    rng = np.random.default_rng(STRANGER_SEED)
    text = robot_path("infantry").read_text().replace('name = "infantry"', 'name = "stranger"')

    def drawn(line: re.Match[str]) -> str:
        return f"{line[1]} = {float(line[2]) * FACTOR ** rng.uniform(-1.0, 1.0):.6g}"

    path.write_text(re.sub(rf"^((?:{DRAWN.replace(' ', '|')})_\w+) = (\S+)$", drawn, text, flags=re.M))
    return af.VirtualRobot.load(path)


def identified(virtual: af.VirtualRobot, folder: Path) -> af.Robot:
    """Return the records of a virtual robot by its own logs."""
    return af.identify_robot(virtual.record(folder / virtual.name)).record


def feedback(virtual: af.VirtualRobot, robot: af.Robot, controller: str, seed: int) -> tuple[Any, Any, Any]:
    """Return measured angles, their ages and the commands in force of all engagements, shape (N, T, …)."""
    parts = []
    for name, count in ENGAGEMENTS.items():
        task = af.Task.load(name).replace(lengths_s=(3.0,))
        shots = af.rollout(controller, robot, task, engagements=count, seed=seed, world=virtual, tuning="start")
        parts.append((shots.seen.gimbal.angle, shots.seen.gimbal.age, shots.seen.command))
    angles, ages, commands = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return angles, ages, commands


def alarms(model: GimbalModel, threshold: Any, angles: Any, ages: Any, commands: Any) -> tuple[Any, Any]:
    """Return in which decisions the feedback is implausible, shape (N, T), and the residuals [rad], (N, T, 2)."""
    count, decisions, _ = angles.shape
    past, found = resting_prediction(model, angles[:, 0]), np.zeros((count, decisions), bool)
    residuals = np.zeros(angles.shape)
    for at in range(1, decisions):
        past, plausible = compare_with_prediction(
            model, threshold, past, commands[:, at], np.full(count, True), angles[:, at], ages[:, at]
        )
        found[:, at] = ~plausible
        age = ages[:, at, None]
        residuals[:, at] = angles[:, at] - gimbal_angle(model, past.plant) + age * gimbal_rate(model, past.plant)
    return found, residuals


def first(happens: Any) -> Any:
    """Return the first decision in which something happens; infinity where it never does."""
    return np.where(happens.any(axis=1), happens.argmax(axis=1), np.inf)


def in_a_row(happens: Any) -> Any:
    """Return in which decisions something begins that happens in three in a row, shape (N, T)."""
    return happens & np.roll(happens, -1, axis=1) & np.roll(happens, -2, axis=1)


def detection(model: GimbalModel, threshold: Any, fault: Fault, angles: Any, ages: Any, commands: Any) -> Any:
    """Count the engagements in which a fault is noticeable, in which it is found in time, and when."""
    wrong = angles.copy()
    for at in range(BEGIN, angles.shape[1]):
        wrong[:, at] = fault.apply(angles, at)
    noticeable = np.abs(wrong - angles) > np.maximum(NOTICEABLE_RAD, 2.0 * threshold)
    begin = np.minimum(first(in_a_row(noticeable[..., 0])), first(in_a_row(noticeable[..., 1])))
    counts = begin + fault.limit <= angles.shape[1]
    found, _ = alarms(model, threshold, wrong, ages, commands)
    found[:, :BEGIN] = False
    taken = first(found)[counts] - begin[counts] + 1.0  # 1: in the decision in which it is noticeable
    times = PERIOD_MS * np.maximum(taken, 0.0)  # some are found before they are noticeable
    late = np.sort(times[taken > fault.limit])
    return {
        "limit_ms": PERIOD_MS * fault.limit,
        "engagements": int(counts.sum()),
        "in time": int(np.sum(taken <= fault.limit)),
        "median_ms": float(np.median(times)) if len(times) else None,
        "later_ms": [float(each) if np.isfinite(each) else "not found" for each in late[:20]],
    }


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=None)
    seed, rows = parser.parse_args().seed, {}
    with tempfile.TemporaryDirectory() as folder:
        infantry, worn = af.VirtualRobot.load("infantry"), af.VirtualRobot.load("worn")
        other = stranger(Path(folder, "stranger.toml"))
        robots = {
            "infantry": (infantry, af.Robot.load(INFANTRY)),
            "stranger": (other, identified(other, Path(folder))),
            "worn": (worn, identified(worn, Path(folder))),
            "worn, plant of the infantry": (worn, af.Robot.load(INFANTRY)),
        }
    for name, (virtual, robot) in robots.items():
        model, threshold = robot.gimbal(1e-3 * PERIOD_MS), thresholds(robot)
        for controller in ("kalman", "kalman-lq"):
            recorded = feedback(virtual, robot, controller, seed or 0)
            found, residuals = alarms(model, threshold, *recorded)
            sizes = 1e3 * np.abs(residuals[:, 11:])
            row: dict[str, Any] = {
                "minutes": round(found.size * PERIOD_MS / 6e4, 1),
                "threshold_mrad": [round(1e3 * float(each), 1) for each in threshold],
                "residual_p50_p99_max_mrad": np.round(np.quantile(sizes, [0.5, 0.99, 1.0], axis=(0, 1)).T, 2).tolist(),
                "engagements": len(found),
                "with an alarm": int(found.any(axis=1).sum()),
            }
            print(f"{name}, {controller}: {row}", flush=True)
            row["faults"] = {}
            for kind, fault in FAULTS.items():
                row["faults"][kind] = counts = detection(model, threshold, fault, *recorded)
                print(f"  {kind:26} {counts}", flush=True)
            rows[f"{name}, {controller}"] = row
    if seed is None:
        made = json.dumps({"date": time.strftime("%F"), **rows}, indent=1)
        (Path(__file__).parent / "results" / "plausibility.json").write_text(made + "\n")


if __name__ == "__main__":
    main()

"""Residuals of the identified plant as a watchdog, on the virtual robots: false alarms, and when faults are found.

`python benchmarks/plausibility.py`: 64 engagements each of kalman and kalman-lq on the infantry, and on the worn robot
with the plant of the infantry; the prediction from the commands sent is compared with the feedback. Then the same
feedback with faults from the second second on. Writes results/plausibility.json.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import archerfish as af
from alternating import ROOT
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate
from archerfish.safety.plausibility import THRESHOLD_RAD, compare_with_prediction, resting_prediction

BEGIN, SETTLING = 100, 10
FAULTS: dict[str, Callable[[Any, int], Any]] = {
    "none": lambda angles, at: angles[:, at],
    "yaw has the other sign": lambda angles, at: angles[:, at] * [1.0, -1.0],
    "degrees": lambda angles, at: np.degrees(angles[:, at]),
    "axes exchanged": lambda angles, at: angles[:, at, ::-1],
    "yaw 0.05 rad off": lambda angles, at: angles[:, at] + [0.0, 0.05],
    "0.2 s late": lambda angles, at: angles[:, at - 10],
    "stuck": lambda angles, _: angles[:, BEGIN],
}


def largest_residuals(model: GimbalModel, shots: Any) -> Any:
    """Return the larger residual of both axes [rad], shape (engagements, decisions)."""
    angles, ages, commands = shots.seen.gimbal.angle, shots.seen.gimbal.age, shots.seen.command
    plant, found = resting_prediction(model, angles[:, 0]).plant, []
    for at in range(1, angles.shape[1]):
        plant = advance(model, plant, commands[:, at])
        expected = gimbal_angle(model, plant) - ages[:, at, None] * gimbal_rate(model, plant)
        found.append(np.abs(angles[:, at] - expected).max(axis=-1))
    return np.array(found[SETTLING:]).T


def decisions_to_alarm(model: GimbalModel, shots: Any, fault: Callable[[Any, int], Any]) -> list[float]:
    """Return after how many decisions of a fault each engagement has its alarm; infinity without."""
    angles, ages, commands = shots.seen.gimbal.angle, shots.seen.gimbal.age, shots.seen.command
    count = len(angles)
    past, first = resting_prediction(model, angles[:, 0]), np.full(count, np.inf)
    for at in range(1, angles.shape[1]):
        angle = fault(angles, at) if at >= BEGIN else angles[:, at]
        past, plausible = compare_with_prediction(
            model, THRESHOLD_RAD, past, commands[:, at], np.full(count, True), angle, ages[:, at]
        )
        first = np.where(~plausible & np.isinf(first), at - BEGIN + 1.0, first)
    return [float(each) for each in first]


def main() -> None:
    """Measure, print, write."""
    robot, task, rows, faults = af.Robot.load(ROOT / "tests" / "infantry"), af.Task.load("any"), {}, {}
    model = robot.gimbal(task.period_s)
    for name in ("infantry", "worn"):
        for controller in ("kalman", "kalman-lq"):
            world = af.VirtualRobot.load(name)
            shots = af.rollout(controller, robot, task, engagements=64, seed=0, world=world, tuning="start")
            residuals = 1e3 * largest_residuals(model, shots)
            kept = np.minimum(np.minimum(residuals[:, 2:], residuals[:, 1:-1]), residuals[:, :-2])
            row = {"p50": np.median(residuals), "p99": np.quantile(residuals, 0.99), "largest": residuals.max()}
            row |= {"kept for three decisions": kept.max(), "decisions": residuals.size}
            rows[f"{name}, {controller}"] = row = {key: round(float(value), 2) for key, value in row.items()}
            print(f"{name:9} {controller:10} residuals [mrad]: {row}", flush=True)
            if (name, controller) == ("infantry", "kalman"):
                for fault, change in FAULTS.items():
                    found = decisions_to_alarm(model, shots, change)
                    faults[fault] = {"median": float(np.median(found)), "last": max(found), "of": len(found)}
                    faults[fault]["found"] = int(np.isfinite(found).sum())
                    print(f"{fault:24} decisions until the alarm: {faults[fault]}", flush=True)
    made = json.dumps({"date": time.strftime("%F"), "residuals_mrad": rows, "faults": faults}, indent=1)
    (Path(__file__).parent / "results" / "plausibility.json").write_text(made.replace("Infinity", "null") + "\n")


if __name__ == "__main__":
    main()

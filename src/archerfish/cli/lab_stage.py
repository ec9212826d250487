"""The laboratory part of a rehearsal: everything that a team records of its robot, as files.

What comes after reads these files and nothing else of the robot.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.lab_files import LARGE_STEPS_DEG, Tape
from archerfish.cli.range import table_1_angles
from archerfish.cli.workers import Task, run_tasks
from archerfish.records import storage
from archerfish.virtual_robot.description_file import load_robot, robot_path
from archerfish.virtual_robot.lab.log_files import (
    write_axis_log,
    write_columns,
    write_detections,
    write_gimbal_log,
    write_robot_limits,
    write_shots,
)
from archerfish.virtual_robot.lab.recorder import AXES, play, robot_trace
from archerfish.virtual_robot.lab.shooting import Plate, shoot_ground, shoot_plates
from archerfish.virtual_robot.lab.signals import steps, sweep
from archerfish.virtual_robot.lab.timing import record_timing, timing_plan
from archerfish.virtual_robot.robot import VirtualRobot

Array = NDArray[np.float64]
Advance = Callable[[float, str], None]

SWEEP_DEG, SWEEP_HZ, SWEEP_S = 1.0, (2.0, 50.0), 10.0
STEP_DEG, HOLD_S = 2.0, 2.0
LARGE_STEP_S = 1.0
PLATES_M, PLATE_PITCH_DEG, SINGLE, BURST = (1.5, 2.5, 3.5, 4.5), 2.0, 5, 50
LANDINGS = 20
"""Shots at the ground at each of the nine angles of Table I."""
TRIM_PLATE_M, TRIM_SHOTS = 3.0, 50
"""The first shots of a robot that has changed since: a burst at a plate."""


@dataclass(frozen=True)
class LabTask:
    """One recording, as data: it can be handed to another process."""

    kind: str
    """"axis", "timing", "plates", "ground" or "trim"."""
    robot: str
    """Name or file."""
    folder: Path
    """For the logs."""
    seed: int
    """Of noise and dispersion."""
    axis: str = ""
    """Of an "axis" recording."""


def record_robot(robot: str, folder: Path, seed: int, workers: int) -> None:
    """Record everything that an identification needs, and the falling points and steps that it is held against.

    Args:
      robot: name or file.
      folder: for the logs.
      seed: of the robot's noise.
      workers: processes.
    """
    keep_description(robot, folder)
    kinds = ((("ground"), ""), ("axis", "yaw"), ("axis", "pitch"), ("timing", ""), ("plates", ""))
    seeds = np.random.SeedSequence([seed, 401]).generate_state(len(kinds)).tolist()
    jobs: list[Task] = [
        (run_recording, LabTask(kind, robot, folder, each, axis), 1.0)
        for (kind, axis), each in zip(kinds, seeds, strict=True)
    ]
    run_tasks("recording", "logs", jobs, workers)


def keep_description(robot: str, folder: Path) -> None:
    """Copy a robot's description beside its logs, as it is when they are recorded; nobody reads the copy.

    Args:
      robot: name or file.
      folder: of the logs.
    """
    storage.write_bytes(folder / "robot.toml", robot_path(robot).read_bytes())


def run_recording(task: LabTask, advance: Advance = lambda *_: None) -> None:
    """Make one recording and write its files."""
    robot = VirtualRobot(load_robot(task.robot), 1, np.array([task.seed]))
    task.folder.mkdir(parents=True, exist_ok=True)
    {"axis": _axis, "timing": _timing, "plates": _plates, "ground": _ground, "trim": _trim}[task.kind](robot, task)
    advance(1.0, f"{task.kind} {task.axis}".strip())


def _axis(robot: VirtualRobot, task: LabTask) -> None:
    amplitude, step = np.radians([SWEEP_DEG, STEP_DEG])
    for name, held_back in (("", False), ("_validation", True)):
        signals = {
            "sweep": sweep(float(amplitude), *SWEEP_HZ, SWEEP_S, held_back=held_back),
            "step": steps(float(step), HOLD_S, held_back=held_back),
        }
        for kind, signal in signals.items():
            _played(robot, task, signal, f"{task.axis}_{kind}{name}.csv")
    limits = getattr(robot.description.limits, task.axis)
    for degrees in LARGE_STEPS_DEG[task.axis]:
        size = np.radians(np.clip(degrees, limits.low_deg, limits.high_deg))
        rest, held = np.zeros(300), np.full(round(1000 * LARGE_STEP_S), size)
        _played(robot, task, np.concatenate([rest, held]), f"{task.axis}_step_{abs(degrees):g}deg.csv")
    write_robot_limits(task.folder / "limits.json", robot.description)


def _played(robot: VirtualRobot, task: LabTask, signal: Array, name: str) -> None:
    commands = np.zeros((len(signal), 2))
    commands[:, AXES.index(task.axis)] = signal
    robot.reset(commands[:1], Plate(3.0))
    write_axis_log(
        task.folder / name, robot_trace(play(robot, commands, "inject"), commands[0], as_sent=True), task.axis
    )


def _timing(robot: VirtualRobot, task: LabTask) -> None:
    logs = record_timing(robot, timing_plan(robot.description), "robot", task.seed, lambda _: None)
    write_gimbal_log(task.folder / "timing_sweep.csv", logs.sweep)
    write_gimbal_log(task.folder / "timing_steps.csv", logs.steps)
    write_detections(task.folder / "timing_plate.csv", logs.plate)
    write_detections(task.folder / "timing_target.csv", logs.target)
    write_columns(task.folder / "timing_moments.csv", {"time_s": logs.moments})
    for name, (sent, received) in (("commands", logs.commands), ("reports", logs.reports)):
        write_columns(task.folder / f"timing_{name}.csv", {"sent_s": sent, "received_s": received})


def _plates(robot: VirtualRobot, task: LabTask) -> None:
    pitch = float(np.radians(PLATE_PITCH_DEG))
    rows = list(shoot_plates(robot, PLATES_M, pitch, SINGLE, BURST, task.seed))
    write_shots(task.folder / "shots.csv", rows)
    storage.write_json(task.folder / "tape.json", asdict(measured_by_tape(robot)))


def _ground(robot: VirtualRobot, task: LabTask) -> None:
    write_shots(task.folder / "landings.csv", list(shoot_ground(robot, table_1_angles(), LANDINGS, task.seed)))


def _trim(robot: VirtualRobot, task: LabTask) -> None:
    keep_description(task.robot, task.folder)
    pitch = float(np.radians(PLATE_PITCH_DEG))
    rows = list(shoot_plates(robot, (TRIM_PLATE_M,), pitch, 0, TRIM_SHOTS, task.seed))
    write_shots(task.folder / "first_shots.csv", rows)


def measured_by_tape(robot: VirtualRobot) -> Tape:
    """Measure the robot to the millimetre."""
    muzzle = robot.description.muzzle
    return Tape(round(muzzle.forward_m, 3), round(muzzle.height_m + muzzle.up_m, 3))

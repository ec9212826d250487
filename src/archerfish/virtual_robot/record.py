"""Everything that a team records of its robot: one folder of logs, which `identify_robot` reads."""

import functools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish import storage
from archerfish.paper.tables import landing_table
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.firing_range import Plate, shoot_landings, shoot_plates
from archerfish.virtual_robot.recorder import Played, between_rests, chirp, inject_commands, send_commands, steps

Array = NDArray[np.float64]
_AXES = ("pitch", "yaw")
SWEEP_DEG, SWEEP_HZ, SWEEP_S = 1.0, (2.0, 50.0), 10.0
STEP_DEG, HOLD_S = 2.0, 2.0
LARGE_STEPS_DEG = {"pitch": (2.0, -5.0, -15.0), "yaw": (2.0, 10.0, 30.0)}
"""Steps that no fit uses: small ones, and such as saturate the motor."""
PLATES_M, PLATE_PITCH_DEG, SINGLE, BURST = (1.5, 2.5, 3.5, 4.5), 2.0, 5, 50
LANDINGS = 20
"""Shots at the ground at each of the nine pairs of angles of Table I."""
TIMING_SWEEP_S, TIMING_HZ, TIMING_STEPS, TIMING_PLATE_M, TARGET_STEP_M = 20.0, (0.2, 2.0), 20, 4.0, 0.3
TIMING_SWEEP_DEG, TIMING_STEP_DEG = 15.0, 7.0
_REACH = 0.8  # share of the yaw range that timing uses at most
_HOLD_S, _TARGET_S = 0.6, (0.9, 1.1)  # of a command step; between two steps of the target, at all phases of the frames
Files = Iterator[tuple[str, Mapping[str, Any]]]


def recordings(description: RobotDescription, seed: int) -> dict[str, Callable[[], Files]]:
    """Return the recordings by the names in `PARTS`: each yields file names and their columns.

    Args:
      description: of the robot.
      seed: of its noise and of the dispersion.
    """
    made: dict[str, Callable[[], Files]] = {}
    seeds = np.random.SeedSequence([seed, 401]).generate_state(len(PARTS)).tolist()
    for (part, function), own in zip(PARTS.items(), seeds, strict=True):
        made[part] = functools.partial(_recorded, function, description, own)
    return made


def _recorded(function: Callable[[RobotBatch, int], Files], description: RobotDescription, seed: int) -> Files:
    return function(RobotBatch(description, 1, np.array([seed])), seed)


def write_columns(path: Path, columns: Mapping[str, Any], digits: int) -> None:
    """Write columns of numbers, shape (N,) each, as CSV with their names in the first line."""
    rows = zip(*(np.round(np.asarray(values, np.float64), digits).tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    storage.write_bytes(path, ("\n".join(lines) + "\n").encode())


def write_limits(path: Path, description: RobotDescription) -> None:
    """Write what may be commanded, which a team has without any identification."""
    axes = list[AxisLimits]()
    for name in _AXES:
        limits = getattr(description.limits, name)
        low, high = np.radians([limits.low_deg, limits.high_deg]).tolist()
        rate, acceleration = limits.max_rate_rad_per_s, limits.max_acceleration_rad_per_s2
        axes.append(AxisLimits(low=low, high=high, max_rate=rate, max_acceleration=acceleration))
    pitch, yaw = axes
    LimitsRecord(pitch=pitch, yaw=yaw, source=f"the description of {description.schema.name}").save(path)


def write_tape(path: Path, description: RobotDescription) -> None:
    """Write the lengths that a tape measures, to the millimetre."""
    muzzle = description.muzzle
    lengths = {"muzzle_length_m": muzzle.forward_m, "muzzle_height_m": muzzle.height_m + muzzle.up_m}
    rounded = {name: round(length, 3) for name, length in lengths.items()}
    storage.write_bytes(path, (json.dumps(rounded, indent=1) + "\n").encode())


def _axis(axis: str, robot: RobotBatch, _: int) -> Files:
    amplitude, size = np.radians([SWEEP_DEG, STEP_DEG]).tolist()
    low_hz, high_hz = SWEEP_HZ
    signals = {
        "sweep": chirp(amplitude, low_hz, high_hz, SWEEP_S),
        "step": steps(size, HOLD_S),
        "sweep_validation": chirp(-amplitude, high_hz, low_hz, SWEEP_S),  # the other way round: no fit has seen it
        "step_validation": steps(size, HOLD_S, held_back=True),
    }
    for degrees in LARGE_STEPS_DEG[axis]:
        signals[f"step_{abs(degrees):g}deg"] = np.concatenate([np.zeros(300), np.full(1000, np.radians(degrees))])
    limits = getattr(robot.description.limits, axis)
    low, high = np.radians([limits.low_deg, limits.high_deg])
    for name, signal in signals.items():
        commands = np.zeros((len(signal), 2))
        place = _AXES.index(axis)
        commands[:, place] = np.clip(signal, low, high)  # the firmware would bound it, and the log not have it
        robot.reset(commands[:1], Plate(3.0))
        played = inject_commands(robot, commands)
        reports = played.received.feedback
        columns = {"time_s": reports.sampled_s, "u": played.in_force(commands[0])[:, place]}
        yield f"{axis}_{name}.csv", {**columns, "y": reports.angle[:, place], "rate": reports.rate[:, place]}


def _landings(robot: RobotBatch, seed: int) -> Files:
    # The paper's yaw is to the right.
    angles = [(np.radians(row.pitch_deg), np.radians(-row.yaw_deg)) for row in landing_table().rows]
    yield "landings.csv", _by_column(list(shoot_landings(robot, angles, LANDINGS, seed)))


def _shots(robot: RobotBatch, seed: int) -> Files:
    pitch = float(np.radians(PLATE_PITCH_DEG))
    yield "shots.csv", _by_column(list(shoot_plates(robot, PLATES_M, pitch, SINGLE, BURST, seed)))


def _by_column(rows: Sequence[Any]) -> dict[str, Any]:
    return dict(zip(rows[0]._fields, zip(*rows, strict=True), strict=True))


class _SteppingPlate:
    """A plate that jumps to and fro sideways at known moments."""

    def __init__(self, size: float, moments: Array) -> None:
        self._size, self._moments = size, moments

    def position(self, time: Array) -> Array:
        """Return its position [m] at times [s], shape (B,) → (B, 3)."""
        side = np.searchsorted(self._moments, time, side="right") % 2 - 0.5
        return np.stack([TIMING_PLATE_M + 0.0 * side, self._size * side, 0.0 * side], axis=-1)


def _timing(robot: RobotBatch, seed: int) -> Files:
    """Record a still plate while the yaw sweeps; then steps of the command, and steps of the plate."""
    limits = robot.description.limits.yaw
    reach = _REACH * float(np.radians(min(-limits.low_deg, limits.high_deg)))
    amplitude, size = (min(float(np.radians(degrees)), reach) for degrees in (TIMING_SWEEP_DEG, TIMING_STEP_DEG))
    low_hz, high_hz = TIMING_HZ
    swept = _sent(robot, _SteppingPlate(0.0, np.empty(0)), chirp(amplitude, low_hz, high_hz, TIMING_SWEEP_S))
    yield "timing_sweep.csv", _of_both_axes(swept)
    yield "timing_plate.csv", _detected(swept)
    levels = np.repeat(size * (np.arange(TIMING_STEPS) % 2 == 0), round(_HOLD_S / TICK_S))
    settling = np.zeros(2 * round(0.5 / TICK_S))  # the last step must have settled before the plate begins to step
    stepping = np.concatenate([between_rests(levels), settling])
    begin_s = len(stepping) * TICK_S
    moments = begin_s + np.cumsum(np.random.default_rng(seed).uniform(*_TARGET_S, TIMING_STEPS))
    rest = np.zeros(round((moments[-1] + 1.0) / TICK_S) - len(stepping))
    stepped = _sent(robot, _SteppingPlate(TARGET_STEP_M, moments), np.concatenate([stepping, rest]))
    yield "timing_steps.csv", _of_both_axes(stepped)
    yield "timing_target.csv", _detected(stepped, begin_s)
    yield "timing_moments.csv", {"time_s": moments}
    commands, reports = stepped.received.commands, stepped.received.feedback
    yield "timing_commands.csv", {"sent_s": commands.sent_s, "received_s": commands.received_s}
    yield "timing_reports.csv", {"sent_s": reports.sampled_s, "received_s": reports.received_s}


def _sent(robot: RobotBatch, target: _SteppingPlate, yaw: Array) -> Played:
    robot.reset(np.zeros((1, 2)), target)
    return send_commands(robot, np.stack([0.0 * yaw, yaw], axis=-1))


def _of_both_axes(played: Played) -> dict[str, Array]:
    reports = played.received.feedback
    angles = {"yaw": reports.angle[:, 1], "pitch": reports.angle[:, 0]}
    return {"time_s": reports.sampled_s, **angles, "yaw_command": played.in_force(np.zeros(2))[:, 1]}


def _detected(played: Played, after_s: float = -np.inf) -> dict[str, Array]:
    frames = played.received.detections
    shown = frames.found[:, 0] & (frames.received_s > after_s)
    x, y, z = frames.position[shown, 0].T
    return {"time_s": frames.exposed_s[shown], "receive_s": frames.received_s[shown], "x": x, "y": y, "z": z}


PARTS: dict[str, Callable[[RobotBatch, int], Files]] = {
    "landings": _landings,
    "yaw": functools.partial(_axis, "yaw"),
    "pitch": functools.partial(_axis, "pitch"),
    "timing": _timing,
    "shots": _shots,
}
"""What is recorded, in an order that is part of the seeds."""

"""The laboratory's logs as CSV files, in the formats that `archerfish identify` reads."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archerfish2 import storage
from archerfish2.records.limits import AxisLimits, LimitsRecord
from archerfish2.virtual_robot.description import LimitsAxis, RobotDescription
from archerfish2.virtual_robot.lab.recorder import AXES, Trace
from archerfish2.virtual_robot.lab.shooting import ShotRow
from archerfish2.virtual_robot.lab.timing import Detected

Array = NDArray[np.float64]


def write_columns(path: Path, columns: Mapping[str, Array], digits: int = 9) -> None:
    """Write columns of numbers, shape (N,) each, with their names in the first line."""
    rows = zip(*(np.round(values, digits).tolist() for values in columns.values()), strict=True)
    text = "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)]) + "\n"
    storage.write_bytes(path, text.encode())


def write_axis_log(path: Path, trace: Trace, axis: str) -> None:
    """Write the log of one axis for `archerfish identify gimbal`: time_s, u, y and rate, in radians."""
    index = AXES.index(axis)
    columns = {"u": trace.command[:, index], "y": trace.angle[:, index], "rate": trace.rate[:, index]}
    write_columns(path, {"time_s": trace.time, **columns})


def write_gimbal_log(path: Path, trace: Trace) -> None:
    """Write the log of both axes for `archerfish identify sensing`, in radians."""
    columns = {"yaw": trace.angle[:, 1], "pitch": trace.angle[:, 0], "yaw_command": trace.command[:, 1]}
    write_columns(path, {"time_s": trace.time, **columns})


def write_detections(path: Path, seen: Detected) -> None:
    """Write detections for `archerfish identify sensing`, in the camera's frame."""
    x, y, z = seen.position.T
    write_columns(path, {"time_s": seen.stamp, "receive_s": seen.received, "x": x, "y": y, "z": z})


def write_shots(path: Path, shots: Sequence[ShotRow]) -> None:
    """Write shots for `archerfish identify muzzle`: hits on a plane, or landing points."""
    column = {name: np.array([getattr(shot, name) for shot in shots], dtype=np.float64) for name in ShotRow._fields}
    aim = {"pitch_deg": np.degrees(column["pitch"]), "yaw_deg": np.degrees(column["yaw"])}
    measured = {"lateral_m": column["lateral"], "speed_m_s": column["speed"]}
    if np.isnan(column["plane_distance"]).any():
        where = {"distance_m": column["landing_distance"]}
    else:
        where = {"plane_distance_m": column["plane_distance"], "hit_height_m": column["hit_height"]}
        measured["burst"] = column["burst"]
    write_columns(path, {**aim, **where, **measured}, digits=4)


def write_robot_limits(path: Path, robot: RobotDescription) -> None:
    """Write what the team knows that it may ask of its robot, as a limits record."""
    source = f"what the team of {robot.schema.name} knows of its robot"
    LimitsRecord(pitch=_limits(robot.limits.pitch), yaw=_limits(robot.limits.yaw), source=source).save(path)


def _limits(axis: LimitsAxis) -> AxisLimits:
    low, high = np.radians([axis.low_deg, axis.high_deg]).tolist()
    return AxisLimits(
        low=low, high=high, max_rate=axis.max_rate_rad_per_s, max_acceleration=axis.max_acceleration_rad_per_s2
    )

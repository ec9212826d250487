"""Logs of what a robot saw: the gimbal's angles, the detections of a plate, and the moments of known target steps."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from archerfish.records.csv_table import CsvTable, read_csv_columns
from archerfish.records.errors import InputError, file_error

Array = NDArray[np.float64]
Frame = Literal["optical", "camera", "base"]
"""Frame of logged detections: "optical" is x right, y down, z forward (OpenCV); "camera" is x forward, y left, z up;
"base" is x forward, y left, z up, already rotated by a gimbal angle that is logged beside each detection."""


@dataclass(frozen=True)
class GimbalColumns:
    """Names of the columns of a gimbal log."""

    time: str = "time_s"
    """Time stamp [s]."""
    yaw: str = "yaw"
    """Measured yaw, left positive."""
    pitch: str = "pitch"
    """Measured pitch, muzzle up positive; the column may be missing."""
    command: str = "yaw_command"
    """Commanded yaw, in force from its line's stamp on; the column may be missing."""


@dataclass(frozen=True)
class DetectionColumns:
    """Names of the columns of a detections log."""

    time: str = "time_s"
    """Stamp of the frame on the camera's clock [s]."""
    receive: str = "receive_s"
    """When the detection reached the program, on the clock of the gimbal log [s]; the column may be missing."""
    position: tuple[str, str, str] = ("x", "y", "z")
    """Position of the plate [m]."""
    rotated_yaw: str = "rotated_yaw"
    """Yaw by which a detection in the base frame was rotated."""
    rotated_pitch: str = "rotated_pitch"
    """Pitch by which it was rotated; the column may be missing."""


@dataclass(frozen=True)
class GimbalLog:
    """Angles of a gimbal, as a program logged them."""

    time: Array
    """Stamps on the gimbal log's clock [s], increasing, shape (N,)."""
    yaw: Array
    """Measured yaw, left positive, without jumps at ±π [rad], shape (N,)."""
    pitch: Array
    """Measured pitch, muzzle up positive, zero if it was not logged [rad], shape (N,)."""
    command: Array | None = None
    """Commanded yaw, in force from its stamp on, without jumps at ±π [rad], shape (N,), if it was logged."""
    source: str = ""
    """Where the log comes from, for messages and titles."""


@dataclass(frozen=True)
class Detections:
    """Detections of one plate, at most one per frame."""

    time: Array
    """Stamps on the camera's clock [s], increasing, shape (K,)."""
    position: Array
    """Plate in the camera's frame: x forward, y left, z up [m], shape (K, 3)."""
    receive: Array | None = None
    """When each reached the program, on the gimbal log's clock [s], shape (K,), if it was logged."""
    source: str = ""
    """Where the log comes from, for messages and titles."""


def read_gimbal_log_csv(path: Path, columns: GimbalColumns | None = None, *, degrees: bool = False) -> GimbalLog:
    """Read a gimbal log from named columns of a CSV file.

    Args:
      path: the file.
      columns: names of the columns; one that may be missing is required once it is given another name.
      degrees: whether angles are in degrees instead of radians.

    Raises:
      InputError: if a column or a number is missing or bad, or time does not increase.
    """
    columns, default = columns or GimbalColumns(), GimbalColumns()
    table = _read(path, columns, default, ["time", "yaw"], ["pitch", "command"])
    unit = np.pi / 180 if degrees else 1.0
    command = table.columns.get(columns.command)
    return GimbalLog(
        time=_increasing(path, table, columns.time, "remove the repeated or disordered lines"),
        yaw=np.unwrap(unit * table.columns[columns.yaw]),
        pitch=unit * table.columns.get(columns.pitch, np.zeros(len(table.lines))),
        command=None if command is None else np.unwrap(unit * command),
        source=path.name,
    )


def read_detections_csv(
    path: Path, columns: DetectionColumns | None = None, *, frame: Frame = "camera", degrees: bool = False
) -> Detections:
    """Read the detections of one plate from named columns of a CSV file, into the camera's frame.

    Args:
      path: the file.
      columns: names of the columns; one that may be missing is required once it is given another name.
      frame: frame in which positions were logged.
      degrees: whether the angles beside positions in the base frame are in degrees instead of radians.

    Raises:
      InputError: if a column or a number is missing or bad, time does not increase, most positions lie behind the
        camera, or positions in the base frame come without the angle that rotated them.
    """
    columns, default = columns or DetectionColumns(), DetectionColumns()
    optional = ["receive", "rotated_yaw", "rotated_pitch"] if frame == "base" else ["receive"]
    table = _read(path, columns, default, ["time"], optional, columns.position)
    stamps = _increasing(path, table, columns.time, "keep one plate, at most one detection of it per frame")
    position = np.column_stack([table.columns[name] for name in columns.position])
    if frame == "optical":
        position = np.column_stack([position[:, 2], -position[:, 0], -position[:, 1]])
    if frame == "base":
        position = _unrotated(path, table, columns, position, np.pi / 180 if degrees else 1.0)
    if np.mean(position[:, 0] <= 0) > 0.5:
        problem = f"most positions lie behind the camera (read in the {frame} frame)"
        raise file_error(path, problem, "name the frame that they were logged in: optical, camera or base")
    return Detections(stamps, position, table.columns.get(columns.receive), path.name)


def read_target_steps_csv(path: Path, time: str = "time_s") -> Array:
    """Read the moments at which a target was halfway through each of its steps, on the clock of receipts.

    Args:
      path: the file.
      time: column of the moments [s].

    Returns:
      Moments [s], increasing, shape (S,).

    Raises:
      InputError: if the column or a number is missing or bad, or time does not increase.
    """
    return _increasing(path, read_csv_columns(path, [time]), time, "list the steps in order, each once")


def _read(
    path: Path,
    columns: GimbalColumns | DetectionColumns,
    default: GimbalColumns | DetectionColumns,
    wanted: list[str],
    optional: list[str],
    more: tuple[str, ...] = (),
) -> CsvTable:
    renamed = [name for name in optional if getattr(columns, name) != getattr(default, name)]
    required = [*(getattr(columns, name) for name in [*wanted, *renamed]), *more]
    # A column may serve twice: a frame that is stamped on receipt has one time for both.
    may_miss = [getattr(columns, name) for name in optional if name not in renamed]
    return read_csv_columns(path, list(dict.fromkeys(required)), [name for name in may_miss if name not in required])


def _increasing(path: Path, table: CsvTable, name: str, remedy: str) -> Array:
    stamps = table.columns[name]
    worst = np.flatnonzero(np.diff(stamps) <= 0)
    if worst.size:
        at = int(worst[0]) + 1
        problem = f"line {table.lines[at]}: time {stamps[at]:.9g} s does not come after {stamps[at - 1]:.9g} s"
        raise file_error(path, problem, remedy)
    return stamps


def _unrotated(path: Path, table: CsvTable, columns: DetectionColumns, position: Array, unit: float) -> Array:
    """Turn positions in the base frame back by the angles that had rotated them."""
    if columns.rotated_yaw not in table.columns:
        raise InputError(
            f"{path}: positions in the base frame need the gimbal angle that rotated each; there is no column "
            f'"{columns.rotated_yaw}"; log that angle, or the detections in the camera frame'
        )
    yaw = unit * table.columns[columns.rotated_yaw]
    pitch = unit * table.columns.get(columns.rotated_pitch, np.zeros_like(yaw))
    x, y, z = position.T
    forward, left = np.cos(yaw) * x + np.sin(yaw) * y, -np.sin(yaw) * x + np.cos(yaw) * y
    return np.column_stack(
        [np.cos(pitch) * forward + np.sin(pitch) * z, left, -np.sin(pitch) * forward + np.cos(pitch) * z]
    )

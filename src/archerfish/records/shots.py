"""Shots: where pellets landed, and how fast they left the muzzle."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import InputError, file_error

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShotColumns:
    """Names of the columns of a shots CSV file."""

    pitch_deg: str = "pitch_deg"
    """Barrel's elevation [°], muzzle up positive."""
    yaw_deg: str = "yaw_deg"
    """Barrel's azimuth [°], left positive; without the column every shot is straight ahead."""
    distance_m: str = "distance_m"
    """Horizontal distance from the muzzle to the landing point on the ground [m]."""
    speed_m_s: str = "speed_m_s"
    """Measured muzzle speed [m/s]; the column may be missing."""
    lateral_m: str = "lateral_m"
    """Landing point's distance from the vertical plane of the barrel [m], left positive; may be missing."""


@dataclass(frozen=True)
class Shots:
    """Landing points on level ground, one entry per shot."""

    pitch: Array
    """Barrel's elevation [rad], muzzle up positive, shape (N,)."""
    yaw: Array
    """Barrel's azimuth [rad], left positive, shape (N,)."""
    distance: Array
    """Horizontal distance from the muzzle to the landing point [m], shape (N,)."""
    speed: Array | None = None
    """Measured muzzle speed [m/s], shape (N,), where it was measured."""
    lateral: Array | None = None
    """Landing point's distance from the vertical plane of the barrel [m], left positive, shape (N,), if measured."""
    source: str = ""
    """Where the shots come from, for messages and titles."""

    def __len__(self) -> int:
        return int(self.distance.size)


def read_shots_csv(path: Path, columns: ShotColumns | None = None) -> Shots:
    """Read shots from a CSV file.

    Args:
      path: the file.
      columns: names of the columns, where they are not those of `ShotColumns`. A column that may be missing is
        required once it is given another name.

    Raises:
      InputError: if a column or a number is missing or bad, an angle is beyond ±90°, or a distance or a speed is not
        above zero.
    """
    columns = columns or ShotColumns()
    default = ShotColumns()
    may_miss = ("yaw_deg", "speed_m_s", "lateral_m")
    renamed = [getattr(columns, name) for name in may_miss if getattr(columns, name) != getattr(default, name)]
    optional = [getattr(columns, name) for name in may_miss if getattr(columns, name) not in renamed]
    table = read_csv_columns(path, [columns.pitch_deg, columns.distance_m, *renamed], optional)
    found = table.columns
    angles, sizes = (columns.pitch_deg, columns.yaw_deg), (columns.distance_m, columns.speed_m_s)
    for name in found:
        for line, value in zip(table.lines, found[name], strict=True):
            if name in angles and abs(value) >= 90:
                raise _out_of_range(path, line, name, value, "an angle inside ±90°")
            if name in sizes and value <= 0:
                raise _out_of_range(path, line, name, value, "a value above 0")
    pitch = np.radians(found[columns.pitch_deg])
    return Shots(
        pitch=pitch,
        yaw=np.radians(found[columns.yaw_deg]) if columns.yaw_deg in found else np.zeros_like(pitch),
        distance=found[columns.distance_m],
        speed=found.get(columns.speed_m_s),
        lateral=found.get(columns.lateral_m),
        source=path.name,
    )


def _out_of_range(path: Path, line: int, name: str, value: float, expected: str) -> InputError:
    problem = f'line {line}: column "{name}" is {value:g}, expected {expected}'
    return file_error(path, problem, "mend the value or remove the line")


def merge_shots(several: list[Shots]) -> Shots:
    """Join shots of one muzzle from several files.

    Raises:
      InputError: if some files have measured speeds (or lateral distances) and others don't.
    """
    for name in ("speed", "lateral"):
        having = [shots.source for shots in several if getattr(shots, name) is not None]
        if 0 < len(having) < len(several):
            raise InputError(
                f"{having[0]}: has measured {name}s and other files have none; give only files of the same columns"
            )

    def joined(name: str) -> Array | None:
        parts = [getattr(shots, name) for shots in several]
        return None if parts[0] is None else np.concatenate(parts)

    pitch, yaw, distance = (
        np.concatenate([getattr(s, name) for s in several]) for name in ("pitch", "yaw", "distance")
    )
    source = ", ".join(shots.source for shots in several)
    return Shots(pitch, yaw, distance, joined("speed"), joined("lateral"), source)

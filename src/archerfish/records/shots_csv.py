"""Shots from CSV files: one shot per line, landing points or hits on a target plane (docs/shots.md)."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from archerfish.records.csv_table import CsvTable, Header, read_csv_columns, read_header
from archerfish.records.errors import InputError, file_error
from archerfish.records.shots import Shots


@dataclass(frozen=True)
class ShotColumns:
    """Names of the columns of a shots CSV file."""

    pitch_deg: str = "pitch_deg"
    """Barrel's elevation [°], muzzle up positive."""
    yaw_deg: str = "yaw_deg"
    """Barrel's azimuth [°], left positive; without the column every shot is straight ahead."""
    distance_m: str = "distance_m"
    """Landing points: horizontal distance from the muzzle to the landing point on the ground [m]."""
    speed_m_s: str = "speed_m_s"
    """Measured muzzle speed [m/s]; the column may be missing."""
    lateral_m: str = "lateral_m"
    """How far left of the aim the pellet went [m], see `Shots.lateral`; the column may be missing."""
    plane_distance_m: str = "plane_distance_m"
    """Hits on a plane: horizontal distance from the muzzle straight ahead to the target plane [m]."""
    hit_height_m: str = "hit_height_m"
    """Hits on a plane: height of the hit above the muzzle [m]."""
    missed: str = "missed"
    """1 where a pellet missed the measuring area, 0 elsewhere; the column may be missing."""


DEFAULT_COLUMNS = ShotColumns()

_MAY_MISS = ("yaw_deg", "speed_m_s", "lateral_m")
_LANDING, _PLANE = ("distance_m",), ("plane_distance_m", "hit_height_m")
_UNIT = re.compile(r"^(pitch|yaw|distance|speed|lateral|plane_distance|hit_height)_(\w+)$")


def read_shots_csv(path: Path, columns: ShotColumns | None = None) -> Shots:
    """Read shots from a CSV file.

    Args:
      path: the file.
      columns: names of the columns, where they are not those of `ShotColumns`. A column that may be missing is
        required once it is given another name.

    Raises:
      InputError: if a column or a number is missing or bad, a column is in another unit, landing points and hits on a
        plane are mixed, a shot missed the measuring area, an angle is beyond ±90°, or a distance or a speed is not
        above zero.
    """
    columns = columns or DEFAULT_COLUMNS
    header = read_header(path)
    _check_units(path, header, columns)
    kind = _kind(path, header, columns)
    _check_misses(path, header, columns)
    wanted = [getattr(columns, name) for name in ("pitch_deg", *kind, *_renamed(columns, _MAY_MISS))]
    optional = [getattr(columns, name) for name in _MAY_MISS if getattr(columns, name) not in wanted]
    table = read_csv_columns(path, wanted, optional)
    _check_ranges(path, table, columns)
    return _shots(path, table, columns)


def _renamed(columns: ShotColumns, names: Iterable[str]) -> list[str]:
    return [name for name in names if getattr(columns, name) != getattr(DEFAULT_COLUMNS, name)]


def _check_units(path: Path, header: Header, columns: ShotColumns) -> None:
    """Refuse a column such as distance_mm: what it measures is known, but not in this unit."""
    named = [getattr(columns, name) for name in vars(columns)]
    for name in header.names:
        found = _UNIT.match(name)
        expected = [known for known in vars(DEFAULT_COLUMNS) if found and known.startswith(f"{found[1]}_")]
        if not found or not expected or name in (*named, *vars(DEFAULT_COLUMNS)):
            continue
        if getattr(columns, expected[0]) not in header.names:
            problem = f'line {header.line}: column "{name}" has the unit "{name.removeprefix(found[1] + "_")}"'
            remedy = f"convert the values and name the column {expected[0]}"
            raise file_error(path, f"{problem}, expected {expected[0]}", remedy, "unknown-unit")


def _kind(path: Path, header: Header, columns: ShotColumns) -> tuple[str, ...]:
    """Return the fields that say where the pellets went: those of landing points, or of hits on a plane."""
    landing = getattr(columns, _LANDING[0]) in header.names or bool(_renamed(columns, _LANDING))
    plane = any(getattr(columns, name) in header.names for name in _PLANE) or bool(_renamed(columns, _PLANE))
    if landing and plane:
        names = ", ".join(getattr(columns, name) for name in (*_LANDING, *_PLANE))
        problem = f"line {header.line}: columns of landing points and of hits on a plane in one file ({names})"
        raise file_error(path, problem, "write them into two files and identify from one of them", "mixed-columns")
    return _PLANE if plane else _LANDING


def _check_misses(path: Path, header: Header, columns: ShotColumns) -> None:
    """Refuse a set with misses: the remaining shots alone would make the dispersion too small."""
    if columns.missed not in header.names:
        return
    table = read_csv_columns(path, [columns.missed])
    missed = table.lines[table.columns[columns.missed] != 0]
    if missed.size:
        lines = ", ".join(str(line) for line in missed[:5]) + (", …" if missed.size > 5 else "")
        problem = (
            f"line {lines}: {missed.size} of {table.lines.size} shots missed the measuring area, and the others alone "
            "would understate the dispersion"
        )
        remedy = "shoot at a larger area or from nearer, so that every pellet is measured"
        raise file_error(path, problem, remedy, "censored-misses")


def _check_ranges(path: Path, table: CsvTable, columns: ShotColumns) -> None:
    angles = (columns.pitch_deg, columns.yaw_deg)
    positive = (columns.distance_m, columns.speed_m_s, columns.plane_distance_m)
    for name, values in table.columns.items():
        for line, value in zip(table.lines, values, strict=True):
            if name in angles and abs(value) >= 90:
                raise _out_of_range(path, line, name, value, "an angle inside ±90°", "angle-out-of-range")
            if name in positive and value <= 0:
                raise _out_of_range(path, line, name, value, "a value above 0", "not-positive")


def _out_of_range(path: Path, line: int, name: str, value: float, expected: str, code: str) -> InputError:
    problem = f'line {line}: column "{name}" is {value:g}, expected {expected}'
    return file_error(path, problem, "mend the value or remove the line", code)


def _shots(path: Path, table: CsvTable, columns: ShotColumns) -> Shots:
    found = table.columns
    pitch = np.radians(found[columns.pitch_deg])
    on_plane = columns.hit_height_m in found
    return Shots(
        pitch=pitch,
        yaw=np.radians(found[columns.yaw_deg]) if columns.yaw_deg in found else np.zeros_like(pitch),
        distance=found[columns.plane_distance_m if on_plane else columns.distance_m],
        speed=found.get(columns.speed_m_s),
        lateral=found.get(columns.lateral_m),
        hit_height=found.get(columns.hit_height_m),
        source=path.name,
        places=tuple(f"{path.name} line {line}" for line in table.lines),
    )

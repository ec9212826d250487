"""Shots from text tables, one a line: landing points on level ground, or hits on vertical target planes."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from archerfish.logs.recording import Finding, log_fault
from archerfish.logs.text import read_text

Array = NDArray[np.float64]
_LANDING, _PLANE = "distance_m", ("plane_distance_m", "hit_height_m")

_SIGNED = {"pitch_deg": 90.0, "yaw_deg": 90.0, "hit_height_m": np.inf, "lateral_m": np.inf}
"""Array that may be negative, and what they are smaller than in size."""


@dataclass(frozen=True, eq=False)
class Shots:
    """Where N pellets went, in the order of fire, and how fast they left the muzzle."""

    pitch: Array  # barrel's elevation [rad], muzzle up positive, (N,)
    yaw: Array  # barrel's azimuth [rad], left positive, (N,)
    distance: Array  # level, from below the muzzle to the landing point, or straight ahead to the plane [m], (N,)
    hit_height: Array | None = None  # of the hit on the plane above the muzzle [m], (N,); None for landing points
    speed: Array | None = None  # measured muzzle speed [m/s], (N,)
    lateral: Array | None = None  # left of the barrel's vertical plane, or of straight ahead on a plane [m], (N,)
    files: tuple[Path, ...] = ()  # that they were read from
    places: tuple[str, ...] = ()  # where each is written, "shots.csv line 7"; empty where they are only numbered
    findings: tuple[Finding, ...] = ()  # what was repaired in the files

    def __len__(self) -> int:
        return self.distance.size

    @property
    def source(self) -> str:
        """The files, for messages."""
        return ", ".join(file.name for file in self.files) or "shots"

    def settings(self) -> tuple[NDArray[np.intp], list[str]]:
        """Return the number of each shot's setting, from 0, shape (N,), and their names, as "3.0°" or "3.0°, 4.00 m".

        A setting is a pitch, and the distance of a plane.
        """
        plane = np.round(self.distance, 3) * (self.hit_height is not None)
        kinds, number = np.unique([np.round(self.pitch, 6), plane], axis=1, return_inverse=True)
        return number, [f"{np.degrees(pitch):.1f}°" + f", {far:.2f} m" * bool(far) for pitch, far in kinds.T]

    def place(self, index: int) -> str:
        """Name a shot for a message."""
        return self.places[index] if self.places else f"shot {index + 1}"

    def select(self, kept: NDArray[np.bool_]) -> Self:
        """Return some of the shots: those that are kept, shape (N,)."""
        arrays: dict[str, Any] = {name: v[kept] for name, v in vars(self).items() if isinstance(v, np.ndarray)}
        return replace(self, **arrays, places=tuple(self.place(index) for index in np.flatnonzero(kept).tolist()))


@dataclass(frozen=True)
class ShotColumns:
    """Names of the columns: of landing points, or of hits on a plane; yaw, lateral, speed and missed are optional."""

    pitch_deg: str = "pitch_deg"  # barrel's elevation [°], muzzle up positive
    yaw_deg: str = "yaw_deg"  # barrel's azimuth [°], left positive; straight ahead without it
    distance_m: str = "distance_m"  # landing points: see `Shots.distance` [m]
    plane_distance_m: str = "plane_distance_m"  # hits: straight ahead to the plane [m]
    hit_height_m: str = "hit_height_m"  # hits: above the muzzle [m]
    lateral_m: str = "lateral_m"  # see `Shots.lateral` [m]
    speed_m_s: str = "speed_m_s"  # measured muzzle speed [m/s]
    missed: str = "missed"  # 1 where a pellet missed the measuring area


COLUMNS = ShotColumns()
"""The usual names."""


def read_shots(*paths: str | Path, columns: ShotColumns = COLUMNS) -> Shots:
    """Read shots of one muzzle, in the order of fire, from text tables with the same columns.

    Args:
      paths: of the files, at least one.
      columns: names of their columns. An optional one is required once it has another name than the usual one.

    Raises:
      InputError: with a code, if a column or a value is missing or out of range, a column is in another unit, landing
        points and hits on a plane are mixed, or a shot missed the measuring area.
    """
    files = tuple(map(Path, paths))
    found, places, findings = zip(*(_read(path, columns) for path in files), strict=True)
    if differing := set.union(*map(set, found)) - set.intersection(*map(set, found)):
        raise log_fault(files[-1], f"{min(differing)} is not in all files", "give the same columns", "mixed-columns")
    joined = {name: np.concatenate([arrays[name] for arrays in found], dtype=np.float64) for name in found[0]}
    height, speed, lateral = map(joined.get, ("hit_height_m", "speed_m_s", "lateral_m"))
    pitch, yaw = joined["pitch_deg"], joined.get("yaw_deg", 0.0 * joined["pitch_deg"])
    distance, rest = joined[_LANDING if height is None else _PLANE[0]], (files, sum(places, ()), sum(findings, ()))
    return Shots(np.radians(pitch), np.radians(yaw), distance, height, speed, lateral, *rest)


def _read(path: Path, columns: ShotColumns) -> tuple[dict[str, Array], tuple[str, ...], tuple[Finding, ...]]:
    """Return what a file has by field, the place of each shot, and what was repaired."""
    # A person who writes a table may leave out the last line break.
    table = read_text(path, lambda names: _wanted(path, names, columns), whole=True)
    rows = np.flatnonzero(np.any(np.isfinite([*table.columns.values()]), axis=0))  # a line of separators is no shot
    fields = {name: field for field, name in vars(columns).items()}
    found = {fields[name]: np.asarray(values[rows], float) for name, values in table.columns.items()}
    places = tuple(f"{path.name} line {table.places[row]}" for row in rows.tolist())
    if lost := np.count_nonzero(found.pop("missed", 0)):
        problem = f"{lost} of {len(places)} shots missed the measuring area; the others understate the dispersion"
        raise log_fault(path, problem, "shoot at a larger area, or from nearer", "censored-misses")
    for field, values in found.items():
        limit = _SIGNED.get(field)
        good = np.abs(values) < limit if limit else values > 0
        if not good.all():
            row, expected = int(np.argmin(good)), f"within ±{limit:g}" if limit else "above 0"
            problem = f'"{getattr(columns, field)}" is {values[row]:g}, expected a number {expected}'
            code = "missing-values" if np.isnan(values[row]) else "angle-out-of-range" if limit else "not-positive"
            raise log_fault(places[row], problem, "correct it or remove the line", code)
    return found, places, table.findings


def _wanted(path: Path, there: list[str], columns: ShotColumns) -> list[str]:
    """Return the columns to read; refuse another unit than the expected one, and two kinds of shots in one file."""
    for field in (field for field, name in vars(columns).items() if name not in there):
        pattern = re.sub("_(deg|m_s|m)$", r"_\\w+", field)
        for other in (name for name in there if re.fullmatch(pattern, name) and name not in vars(COLUMNS)):
            raise log_fault(path, f'"{other}" has another unit than {field}', f"convert it to {field}", "unknown-unit")
    wanted = {field for field, name in vars(columns).items() if name in there or name != field} | {"pitch_deg"}
    kind = {_LANDING} if wanted.isdisjoint(_PLANE) else {*_PLANE}
    if _LANDING in wanted - kind:
        raise log_fault(path, "has both landing points and hits on a plane", "give them two files", "mixed-columns")
    return [name for field, name in vars(columns).items() if field in wanted | kind]

"""The muzzle record: speed, dispersion and drag of the pellets, eq (6)."""

import math
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

SCHEMA = "archerfish.muzzle/1"


@dataclass(frozen=True)
class MuzzleRecord:
    """What a muzzle does to a pellet; angles are offsets from the barrel's direction."""

    speed: float
    """Mean muzzle speed μ_v [m/s]."""
    speed_sd: float
    """Standard deviation of the muzzle speed σ_v [m/s]."""
    pitch_offset: float
    """Mean disturbance angle μ_0 in elevation [rad], muzzle up positive."""
    pitch_sd: float
    """Standard deviation σ_0 of the disturbance angle in elevation [rad]."""
    yaw_offset: float
    """Mean disturbance angle μ_1 in azimuth [rad], left positive."""
    yaw_sd: float
    """Standard deviation σ_1 of the disturbance angle in azimuth [rad]."""
    drag: float
    """Quadratic drag coefficient k [1/m]."""
    length: float = 0.0
    """Distance from the gimbal's pivot to the muzzle [m]."""
    height: float = 0.0
    """Height of the muzzle above the ground with the barrel level [m]; only landing points need it."""
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    """95 % interval of each estimated field."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""

    def __post_init__(self) -> None:
        for name in ("pitch_offset", "yaw_offset", "speed"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"muzzle.{name} must be finite, got {getattr(self, name)}; identify the muzzle anew")
        for name in ("speed_sd", "pitch_sd", "yaw_sd", "drag", "length", "height"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InputError(f"muzzle.{name} must be ≥ 0, got {getattr(self, name)}; identify the muzzle anew")
        if not self.speed > 0:
            raise InputError(f"muzzle.speed must be > 0 m/s, got {self.speed}; identify the muzzle anew")


def write_muzzle(path: Path, muzzle: MuzzleRecord) -> None:
    """Write a muzzle record to `path` (.json)."""
    storage.write_json(path, {"schema": SCHEMA, **asdict(muzzle)})


def read_muzzle(path: Path) -> MuzzleRecord:
    """Read a muzzle record.

    Raises:
      InputError: if the file is not a muzzle record, or a field is missing, unknown or out of range.
    """
    facts = storage.read_facts(path, SCHEMA)
    numbers = {each.name for each in fields(MuzzleRecord)} - {"intervals", "provenance"}
    unknown = facts.keys() - numbers - {"intervals", "provenance"}
    if unknown:
        raise InputError(f'{path}: unknown field "{sorted(unknown)[0]}"; known are {", ".join(sorted(numbers))}')
    values = {name: float(storage.field(path, facts, name, (int, float))) for name in sorted(numbers)}
    try:
        intervals = {name: (float(low), float(high)) for name, (low, high) in facts.get("intervals", {}).items()}
    except (AttributeError, TypeError, ValueError) as error:
        problem = 'field "intervals" must map names to [low, high]'
        raise file_error(path, problem, "identify the muzzle anew") from error
    try:
        return MuzzleRecord(**values, intervals=intervals, provenance=facts.get("provenance", {}))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error

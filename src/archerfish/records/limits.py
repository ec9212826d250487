"""The limits record: what a gimbal may be asked, in angle, rate and acceleration."""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from archerfish.records import storage
from archerfish.records.errors import InputError

SCHEMA = "archerfish.limits/1"


@dataclass(frozen=True)
class AxisLimits:
    """What one axis may be asked."""

    low: float
    """Smallest angle [rad]."""
    high: float
    """Largest angle [rad]."""
    max_rate: float
    """Largest rate of the commanded angle [rad/s]."""
    max_acceleration: float
    """Largest acceleration of the commanded angle [rad/s²]."""

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(f"limits.low must be below limits.high, got {self.low} and {self.high} rad")
        for name in ("max_rate", "max_acceleration"):
            if not getattr(self, name) > 0:
                raise InputError(f"limits.{name} must be > 0, got {getattr(self, name)}")


@dataclass(frozen=True)
class LimitsRecord:
    """The limits of a gimbal's two axes."""

    pitch: AxisLimits
    """Pitch axis, muzzle up positive."""
    yaw: AxisLimits
    """Yaw axis, left positive."""
    source: str = ""
    """Where the figures come from."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""


def write_limits(path: Path, limits: LimitsRecord) -> None:
    """Write a limits record to `path` (.json)."""
    storage.write_json(path, {"schema": SCHEMA, **asdict(limits)})


def read_limits(path: Path) -> LimitsRecord:
    """Read a limits record.

    Raises:
      InputError: if the file is not a limits record, or a field is missing, unknown or out of range.
    """
    facts = storage.read_facts(path, SCHEMA)
    _check_known(path, facts, LimitsRecord)
    axes = {name: _axis(path, storage.field(path, facts, name, dict)) for name in ("pitch", "yaw")}
    return LimitsRecord(**axes, source=facts.get("source", ""), provenance=facts.get("provenance", {}))


def _axis(path: Path, facts: dict[str, Any]) -> AxisLimits:
    _check_known(path, facts, AxisLimits)
    values = {each.name: float(storage.field(path, facts, each.name, (int, float))) for each in fields(AxisLimits)}
    try:
        return AxisLimits(**values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _check_known(path: Path, facts: dict[str, Any], record: type[AxisLimits] | type[LimitsRecord]) -> None:
    known = [each.name for each in fields(record)]
    for name in facts:
        if name not in known:
            raise InputError(f'{path}: unknown field "{name}"; known are {", ".join(known)}')

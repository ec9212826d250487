"""The rigid-axis record: inertia, damping and gravity of one gimbal axis, eqs (1)–(3), with their intervals."""

import math
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

SCHEMA = "archerfish.rigid_axis/1"

AxisKind = Literal["pitch", "yaw"]
"""Pitch swings against gravity, eq (1); yaw does not, eq (3)."""

UNITS = {
    "inertia": "kg m²",
    "damping": "N m s/rad",
    "gravity_moment": "N m",
    "gravity_phase": "rad",
    "torque_offset": "N m",
    "friction": "N m",
}
"""Unit of each parameter, if the torque was given in N m."""


@dataclass(frozen=True)
class RigidAxisRecord:
    """A rigid axis under a torque.

    inertia · θ̈ + damping · θ̇ + friction · sign(θ̇) + gravity_moment · sin(θ − gravity_phase) = torque + torque_offset
    """

    axis_kind: AxisKind
    """Whether gravity acts."""
    inertia: float
    """m l² [kg m²]."""
    damping: float
    """b [N m s/rad]."""
    gravity_moment: float = 0.0
    """m g l, the largest moment of gravity [N m]; zero for yaw."""
    gravity_phase: float = 0.0
    """Angle at which the arm hangs straight down [rad]; zero for yaw."""
    torque_offset: float = 0.0
    """Constant torque beside the logged one: a cable's pull, a current sensor's zero [N m]; zero for pitch."""
    friction: float = 0.0
    """Moment of Coulomb friction, which at rest holds the axis up to its size [N m]; zero where it was not estimated,
    and in files that know nothing of it."""
    axis: str = "axis"
    """Name of the axis."""
    standard_errors: dict[str, float] = field(default_factory=dict)
    """Standard error of each estimated parameter, right under coloured residuals too."""
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    """95 % interval of each estimated parameter."""
    units: dict[str, str] = field(default_factory=lambda: dict(UNITS))
    """Unit of each parameter."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""

    def __post_init__(self) -> None:
        if self.axis_kind not in get_args(AxisKind):
            raise InputError(f"rigid_axis.axis_kind must be pitch or yaw, got {self.axis_kind!r}")
        for name in UNITS:
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"rigid_axis.{name} must be finite, got {getattr(self, name)}; identify the axis anew")
        if not self.inertia > 0:
            raise InputError(f"rigid_axis.inertia must be > 0, got {self.inertia}; identify the axis anew")
        if self.friction < 0:
            raise InputError(f"rigid_axis.friction must be ≥ 0, got {self.friction}; identify the axis anew")
        if self.gravity_moment < 0:
            raise InputError(f"rigid_axis.gravity_moment must be ≥ 0, got {self.gravity_moment}; turn the phase by π")


def write_rigid_axis(path: Path, record: RigidAxisRecord) -> None:
    """Write a rigid-axis record to `path` (.json)."""
    storage.write_json(path, {"schema": SCHEMA, **asdict(record)})


def read_rigid_axis(path: Path) -> RigidAxisRecord:
    """Read a rigid-axis record.

    Raises:
      InputError: if the file is not a rigid-axis record, or a field is missing, unknown or out of range.
    """
    facts = storage.read_facts(path, SCHEMA)
    known = {each.name for each in fields(RigidAxisRecord)}
    unknown = facts.keys() - known
    if unknown:
        raise InputError(f'{path}: unknown field "{sorted(unknown)[0]}"; known are {", ".join(sorted(known))}')
    facts = {"friction": 0.0, **facts}  # of files that were written before it was estimated
    values = {name: float(storage.field(path, facts, name, (int, float))) for name in UNITS}
    try:
        intervals = {name: (float(low), float(high)) for name, (low, high) in facts.get("intervals", {}).items()}
        errors = {name: float(value) for name, value in facts.get("standard_errors", {}).items()}
    except (AttributeError, TypeError, ValueError) as error:
        problem = 'fields "intervals" and "standard_errors" must map names to [low, high] and to numbers'
        raise file_error(path, problem, "identify the axis anew") from error
    kind: AxisKind = storage.field(path, facts, "axis_kind", str)
    try:
        return RigidAxisRecord(
            axis_kind=kind,
            axis=storage.field(path, facts, "axis", str),
            standard_errors=errors,
            intervals=intervals,
            units=storage.field(path, facts, "units", dict),
            provenance=facts.get("provenance", {}),
            **values,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error

"""The limits record: the angles, rates and accelerations that may be commanded to a gimbal."""

from typing import Annotated

from msgspec import Meta, field

from archerfish.errors import InputError
from archerfish.records.record import Angle, Provenance, Record, Struct

Largest = Annotated[float, Meta(gt=0.0, le=1e6)]


class AxisLimits(Struct, frozen=True, kw_only=True):
    """The limits of the command of one axis."""

    low: Angle
    """Smallest angle [rad]."""
    high: Angle
    """Largest angle [rad]."""
    max_rate: Largest
    """Largest rate of the commanded angle [rad/s]."""
    max_acceleration: Largest
    """Largest acceleration of the commanded angle [rad/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.low < self.high:
            raise InputError(f"AxisLimits: expected low < high, got {self.low:g} and {self.high:g} rad; correct it")


class LimitsRecord(Record, frozen=True, kw_only=True):
    """The limits of both axes of a gimbal."""

    schema = "archerfish.limits/2"
    pitch: AxisLimits
    """Pitch axis, muzzle up positive."""
    yaw: AxisLimits
    """Yaw axis, left positive."""
    source: str = ""
    """Where the figures come from."""
    provenance: Provenance = field(default_factory=dict)

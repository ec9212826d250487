"""The limits record: the angles, rates and accelerations that may be commanded to a gimbal."""

from typing import Annotated

from msgspec import Meta, field

from archerfish.errors import InputError
from archerfish.records.record import Angle, Provenance, Record, Struct

UNLIMITED = 1e6
"""A limit that never acts: rad, rad/s, rad/s²."""
Largest = Annotated[float, Meta(gt=0.0, le=1e6)]


class AxisLimits(Struct, frozen=True, kw_only=True):
    """The limits of the command of one axis."""

    low: Angle | None
    """Smallest angle [rad]; None, as is `high`, where a slip ring lets the axis turn without end."""
    high: Angle | None
    """Largest angle [rad]."""
    max_rate: Largest
    """Largest rate of the commanded angle [rad/s]."""
    max_acceleration: Largest
    """Largest acceleration of the commanded angle [rad/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.low is None) != (self.high is None):
            raise InputError("AxisLimits: expected low and high, or null for both, got one of them; correct it")
        low, high = self.ends
        if not low < high:
            raise InputError(f"AxisLimits: expected low < high, got {low:g} and {high:g} rad; correct it")

    @property
    def ends(self) -> tuple[float, float]:
        """Smallest and largest angle [rad], ∓`UNLIMITED` where the axis turns without end."""
        if self.low is None or self.high is None:
            return -UNLIMITED, UNLIMITED
        return self.low, self.high


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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.pitch.low is None:
            raise InputError("LimitsRecord: field pitch: expected a range, got null for low and high; give both in rad")

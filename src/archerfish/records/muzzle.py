"""The muzzle record: speed, dispersion and drag of the pellets, eq (6)."""

from typing import Annotated

from msgspec import Meta, field

from archerfish.records.record import Deviation, Intervals, Provenance, Record, check_intervals

Offset = Annotated[float, Meta(ge=-3.2, le=3.2)]


class MuzzleRecord(Record, frozen=True, kw_only=True):
    """How pellets leave a muzzle; angles are offsets from the barrel's direction."""

    schema = "archerfish.muzzle/2"
    speed: Annotated[float, Meta(ge=0.1, le=2000.0)]
    """Mean muzzle speed μ_v [m/s]."""
    speed_sd: Annotated[float, Meta(ge=0.0, le=1000.0)]
    """Standard deviation of the muzzle speed σ_v [m/s]."""
    pitch_offset: Offset = 0.0
    """Mean disturbance angle μ_0 in elevation [rad], muzzle up positive."""
    pitch_sd: Deviation
    """Standard deviation σ_0 of the disturbance angle in elevation [rad]."""
    yaw_offset: Offset = 0.0
    """Mean disturbance angle μ_1 in azimuth [rad], left positive."""
    yaw_sd: Deviation
    """Standard deviation σ_1 of the disturbance angle in azimuth [rad]."""
    drag: Annotated[float, Meta(ge=0.0, le=100.0)]
    """Quadratic drag coefficient k [1/m]."""
    length: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """Distance from the gimbal's pivot to the muzzle [m]."""
    height: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Height of the muzzle above the ground with the barrel level [m]; only landing points need it."""
    intervals: Intervals = field(default_factory=dict)
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_intervals(self.intervals, self.__struct_fields__)

"""The sensing record: when and how well a robot sees, and how late it moves."""

from typing import Annotated, Literal

from msgspec import Meta, field

from archerfish.errors import InputError
from archerfish.records.record import Deviation, Duration, Intervals, Provenance, Record, Struct, Time, check_intervals

_Rate = Annotated[float, Meta(ge=0.01, le=1e6)]
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]


class CameraRecord(Struct, frozen=True, kw_only=True):
    """From a plate to its detection; a value that was not measured is None."""

    rate_hz: _Rate
    """Frames per second [Hz]."""
    time_offset: Annotated[float, Meta(ge=-1e10, le=1e10)]
    """What is added to a detection's stamp to get the moment of its exposure on the gimbal log's clock [s]; some 1e9
    where one of the clocks counts from 1970."""
    stamp_jitter: Duration
    """Standard deviation of that sum about the true moment [s]."""
    bearing_sd: Deviation
    """Standard deviation of a detection's azimuth, across the line of sight [rad]."""
    elevation_sd: Deviation
    """Standard deviation of a detection's elevation, across the line of sight [rad]."""
    range_sd: Deviation
    """Standard deviation of a detection's distance, along the line of sight [m], at `noise_range`."""
    noise_range: Annotated[float, Meta(ge=0.01, le=1000.0)]
    """Distance of the plate at which the noise was measured [m]; one distance doesn't show how it grows."""
    miss_probability: _Share
    """Share of the frames in which the plate was not found."""
    outlier_share: _Share
    """Share of the detections that are something other than the plate."""
    latency: Time | None = None
    """Mean time from exposure to receipt of the detection [s]."""
    latency_jitter: Duration | None = None
    """Standard deviation of that time [s]."""
    latency_basis: Literal["", "exposure", "feedback"] = ""
    """What `latency` counts from: "exposure" or "feedback", the latter less the delay of the gimbal's feedback."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.latency_basis) != (self.latency is not None):
            expected = 'expected "exposure" or "feedback" with a latency and "" without'
            raise InputError(f'CameraRecord: field latency_basis: {expected}, got "{self.latency_basis}"; correct it')


class LinkRecord(Struct, frozen=True, kw_only=True):
    """From a command to the motion that the log shows; a value that was not measured is None."""

    feedback_rate_hz: _Rate
    """Rate at which the logged angle is refreshed [Hz]."""
    feedback_quantum: Deviation | None = None
    """Step of the logged angle [rad], where it is visible."""
    command_delay: Time | None = None
    """Mean time from a logged command to the logged motion [s]: the sum of command and feedback delay, as a plant
    record has it too, so it is never to be added to a plant that was identified from such a log."""
    command_jitter: Duration | None = None
    """Standard deviation of that time from command to command [s]."""
    feedback_delay: Time | None = None
    """Delay of the feedback alone [s]: how much later than the moment that it shows a logged angle is stamped."""
    command_latency: Duration | None = None
    """Mean time from sending a command to its receipt by the gimbal [s], where the gimbal stamps what it receives."""
    command_latency_jitter: Duration | None = None
    """Standard deviation of that time [s]."""
    feedback_latency: Duration | None = None
    """Mean time from the gimbal's stamp of a feedback to its receipt by the program [s]."""
    feedback_latency_jitter: Duration | None = None
    """Standard deviation of that time [s]."""


class SensingRecord(Record, frozen=True, kw_only=True):
    """What a robot's program receives, and when."""

    schema = "archerfish.sensing/2"
    camera: CameraRecord
    """From plate to detection."""
    link: LinkRecord
    """From command to motion and back."""
    intervals: Intervals = field(default_factory=dict)
    """By a name such as "camera.latency"."""
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        camera = [f"camera.{name}" for name in CameraRecord.__struct_fields__]
        link = [f"link.{name}" for name in LinkRecord.__struct_fields__]
        check_intervals(self.intervals, [*camera, *link])

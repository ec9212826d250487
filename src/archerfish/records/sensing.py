"""The sensing record: when and how well a robot sees, and how late it moves; the simulator's camera and link models."""

import math
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

SCHEMA = "archerfish.sensing/1"


@dataclass(frozen=True)
class CameraRecord:
    """What lies between a plate and its detection; a value that was not measured is None."""

    rate_hz: float
    """Frames per second [Hz]."""
    time_offset: float
    """What is added to a detection's stamp to get the moment of its exposure on the gimbal log's clock [s]."""
    stamp_jitter: float
    """Standard deviation of that sum about the true moment [s]."""
    bearing_sd: float
    """Standard deviation of a detection's azimuth, across the line of sight [rad]."""
    elevation_sd: float
    """Standard deviation of a detection's elevation, across the line of sight [rad]."""
    range_sd: float
    """Standard deviation of a detection's distance, along the line of sight [m], at `noise_range`."""
    noise_range: float
    """Distance of the plate at which the noise was measured [m]; one distance doesn't show how it grows."""
    miss_probability: float
    """Share of the frames in which the plate was not found."""
    outlier_share: float
    """Share of the detections that are something other than the plate."""
    latency: float | None = None
    """Mean time from exposure to receipt of the detection [s]."""
    latency_jitter: float | None = None
    """Standard deviation of that time [s]."""
    latency_basis: str = ""
    """What `latency` counts from: "exposure" or "feedback", the latter less the delay of the gimbal's feedback."""


@dataclass(frozen=True)
class LinkRecord:
    """What lies between a command and the motion that the log shows; a value that was not measured is None."""

    feedback_rate_hz: float
    """Rate at which the logged angle is refreshed [Hz]."""
    feedback_quantum: float | None = None
    """Step of the logged angle [rad], where it is visible."""
    command_delay: float | None = None
    """Mean time from a logged command to the logged motion [s]: the sum of command and feedback delay, as a plant
    record holds it too, so it is never to be added to a plant that was identified from such a log."""
    command_jitter: float | None = None
    """Standard deviation of that time from command to command [s]."""
    feedback_delay: float | None = None
    """Delay of the feedback alone [s]: how much later than the moment that it shows a logged angle is stamped."""
    command_latency: float | None = None
    """Mean time from sending a command to its receipt by the gimbal [s], where the gimbal stamps what it receives."""
    command_latency_jitter: float | None = None
    """Standard deviation of that time [s]."""
    feedback_latency: float | None = None
    """Mean time from the gimbal's stamp of a feedback to its receipt by the program [s]."""
    feedback_latency_jitter: float | None = None
    """Standard deviation of that time [s]."""


@dataclass(frozen=True)
class SensingRecord:
    """What a robot's program gets to know, and when."""

    camera: CameraRecord
    """From plate to detection."""
    link: LinkRecord
    """From command to motion and back."""
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    """95 % interval of each estimated field, by a name such as "camera.latency"."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""

    def __post_init__(self) -> None:
        _check(self)


_ANY_SIGN = {"camera.time_offset", "camera.latency", "link.command_delay", "link.feedback_delay"}
_ABOVE_ZERO = {"camera.rate_hz", "camera.noise_range", "link.feedback_rate_hz"}
_SHARES = {"camera.miss_probability", "camera.outlier_share"}
_BASES = ("", "exposure", "feedback")
_PARTS = {"camera": CameraRecord, "link": LinkRecord}


def sensing_values(record: SensingRecord) -> dict[str, float]:
    """Return the measured values by their names in `intervals`, such as "camera.latency"."""
    return {
        f"{part}.{name}": value
        for part in _PARTS
        for name, value in asdict(getattr(record, part)).items()
        if name != "latency_basis" and value is not None
    }


def _check(record: SensingRecord) -> None:
    values = sensing_values(record)
    for name, value in values.items():
        low = -math.inf if name in _ANY_SIGN else 0.0
        high = 1.0 if name in _SHARES else math.inf
        inside = math.isfinite(value) and low <= value <= high and not (name in _ABOVE_ZERO and value == 0)
        if not inside:
            expected = "> 0" if name in _ABOVE_ZERO else "finite" if name in _ANY_SIGN else "≥ 0"
            expected = "within 0…1" if name in _SHARES else expected
            raise InputError(f"sensing.{name} must be {expected}, got {value}; identify the sensing anew")
    if record.camera.latency_basis not in _BASES or bool(record.camera.latency_basis) != ("camera.latency" in values):
        raise InputError(
            f'sensing.camera.latency_basis must be "exposure" or "feedback" with a latency and "" without, got '
            f'"{record.camera.latency_basis}"; identify the sensing anew'
        )


def write_sensing(path: Path, sensing: SensingRecord) -> None:
    """Write a sensing record to `path` (.json)."""
    storage.write_json(path, {"schema": SCHEMA, **asdict(sensing)})


def read_sensing(path: Path) -> SensingRecord:
    """Read a sensing record.

    Raises:
      InputError: if the file is not a sensing record, or a field is missing, unknown or out of range.
    """
    facts = storage.read_facts(path, SCHEMA)
    _check_known(path, facts, SensingRecord, "")
    try:
        camera, link = CameraRecord(**_part(path, facts, "camera")), LinkRecord(**_part(path, facts, "link"))
        return SensingRecord(camera, link, _intervals(path, facts), facts.get("provenance", {}))
    except InputError as error:
        raise error if str(error).startswith(str(path)) else InputError(f"{path}: {error}") from error


def _part(path: Path, facts: dict[str, Any], part: str) -> dict[str, Any]:
    found = storage.field(path, facts, part, dict)
    kind = _PARTS[part]
    _check_known(path, found, kind, f"{part}.")
    values: dict[str, Any] = {}
    for each in fields(kind):
        if each.type is str:
            values[each.name] = storage.field(path, found, each.name, str)
        elif found.get(each.name) is None and each.default is None:
            values[each.name] = None
        else:
            values[each.name] = float(storage.field(path, found, each.name, (int, float)))
    return values


def _check_known(path: Path, facts: dict[str, Any], kind: type, prefix: str) -> None:
    known = [each.name for each in fields(kind)]
    for name in facts:
        if name not in known:
            raise InputError(f'{path}: unknown field "{prefix}{name}"; known are {", ".join(known)}')


def _intervals(path: Path, facts: dict[str, Any]) -> dict[str, tuple[float, float]]:
    try:
        return {name: (float(low), float(high)) for name, (low, high) in facts.get("intervals", {}).items()}
    except (AttributeError, TypeError, ValueError) as error:
        problem = 'field "intervals" must map names to [low, high]'
        raise file_error(path, problem, "identify the sensing anew") from error

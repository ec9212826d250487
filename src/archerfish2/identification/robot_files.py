"""The folder of a robot's logs: what its files are called, and what logs.toml and tape.json say of them."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from archerfish2.errors import file_error
from archerfish2.records.json_files import fault, read_json
from archerfish2.records.limits import AxisLimits, LimitsRecord
from archerfish2.records.record import Struct

AXES = ("pitch", "yaw")
Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Range = tuple[float, float]
Both = Positive | Annotated[tuple[Positive, ...], Meta(min_length=2, max_length=2)]
"""One figure for both axes, or [pitch, yaw]; a tuple of fixed length beside a number crashes msgspec 0.22."""
T = TypeVar("T", bound=Struct)


class AxisFiles(Struct, frozen=True, kw_only=True):
    """Section [pitch] or [yaw] of logs.toml: which logs, and how they name what."""

    fit: tuple[str, ...] = ()
    """Files to be fitted; AXIS_sweep.csv and AXIS_step.csv if not given."""
    validate: tuple[str, ...] = ()
    """Files to be held back; AXIS_sweep_validation.csv and AXIS_step_validation.csv if not given."""
    input: str = "u"
    """Signal of the command."""
    output: str = "y"
    """Signal of the angle."""
    time: str = "time_s"
    """Stamps."""
    unit: Literal["rad", "deg"] = "rad"
    """Of both signals."""


class MuzzleFiles(Struct, frozen=True, kw_only=True):
    """Section [muzzle] of logs.toml."""

    shots: tuple[str, ...] = ()
    """Files of shots; shots.csv if not given."""
    length_m: Positive | None = None
    """From the pivot to the muzzle [m]; that of tape.json if not given."""
    height_m: Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]; that of tape.json if not given."""


class LimitsFigures(Struct, frozen=True, kw_only=True):
    """Section [limits] of logs.toml."""

    pitch_deg: Range
    """Smallest and largest pitch, muzzle up positive [°]."""
    yaw_deg: Range
    """Smallest and largest yaw, left positive [°]."""
    max_rate_deg_s: Both
    """Largest rate of a command [°/s]."""
    max_acceleration_deg_s2: Both
    """Largest acceleration of a command [°/s²]."""

    def record(self) -> LimitsRecord:
        """Return the limits in radians."""
        rates, accelerations = (
            np.radians(np.broadcast_to(each, 2)) for each in (self.max_rate_deg_s, self.max_acceleration_deg_s2)
        )
        ranges = np.radians([self.pitch_deg, self.yaw_deg])
        axes = [
            AxisLimits(low=low, high=high, max_rate=rate, max_acceleration=acceleration)
            for low, high, rate, acceleration in np.column_stack([ranges, rates, accelerations]).tolist()
        ]
        return LimitsRecord(pitch=axes[0], yaw=axes[1], source="logs.toml")


class LogFolder(Struct, frozen=True, kw_only=True):
    """Content of logs.toml."""

    pitch: AxisFiles = AxisFiles()
    """Pitch axis."""
    yaw: AxisFiles = AxisFiles()
    """Yaw axis."""
    muzzle: MuzzleFiles = MuzzleFiles()
    """Shots and tape measures."""
    limits: LimitsFigures | None = None
    """Limits of the commands; limits.json if not given."""


class Tape(Struct, frozen=True, kw_only=True):
    """Content of tape.json: what a tape measure says."""

    muzzle_length_m: Positive | None = None
    """From the pivot to the muzzle [m]."""
    muzzle_height_m: Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]."""


def read_folder(folder: Path) -> tuple[LogFolder, Tape]:
    """Read logs.toml and tape.json, both of which may be missing.

    Raises:
      InputError: if the folder is missing, or a file is damaged or has an unknown field.
    """
    if not folder.is_dir():
        raise file_error(folder, "there is no such folder", "name the folder of the logs")
    settings, tape = folder / "logs.toml", folder / "tape.json"
    try:
        content = tomllib.loads(settings.read_text(encoding="utf-8")) if settings.exists() else {}
    except (OSError, ValueError) as error:
        raise file_error(settings, f"is not TOML ({error})", "correct it") from error
    return _struct(settings, content, LogFolder), _struct(tape, read_json(tape) if tape.exists() else {}, Tape)


def axis_logs(folder: Path, axis: str, files: AxisFiles) -> tuple[list[Path], list[Path]]:
    """Return the logs of an axis that are fitted and held back: those that are named, or the usual ones that are there.

    Args:
      folder: of the logs.
      axis: "pitch" or "yaw".
      files: section of logs.toml.
    """
    usual = ([f"{axis}_{kind}{end}.csv" for kind in ("sweep", "step")] for end in ("", "_validation"))
    pairs = zip((files.fit, files.validate), usual, strict=True)
    fitted, held_back = (
        [folder / each for each in named or names if named or (folder / each).exists()] for named, names in pairs
    )
    return fitted, held_back


def _struct(path: Path, content: object, kind: type[T]) -> T:
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise file_error(path, fault(error, content), "correct it") from error

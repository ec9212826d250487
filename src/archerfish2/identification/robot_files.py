"""The folder of a robot's logs: what its files are called, and what logs.toml and tape.json say of them."""

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from archerfish2.errors import InputError, file_error
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Log
from archerfish2.logs.timing import Frame
from archerfish2.records.json_files import read_json, read_struct, to_struct
from archerfish2.records.limits import AxisLimits, LimitsRecord
from archerfish2.records.record import Struct

AXES = ("pitch", "yaw")
EXPECTED = "{pitch,yaw}_{sweep,step}[_validation].csv, {pitch,yaw}_step_{N}deg.csv, shots.csv, timing_{sweep,plate}.csv"
"""What logs are called."""
LOGS = (".csv", ".txt", ".tsv", ".npz", ".mat", ".bag", ".db3", ".mcap")
"""Endings of files that somebody means to be read."""
Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Both = Positive | Annotated[tuple[Positive, ...], Meta(min_length=2, max_length=2)]
"""One figure for both axes, or [pitch, yaw]; a tuple of fixed length beside a number crashes msgspec 0.22."""


class AxisFiles(Struct, frozen=True, kw_only=True):
    """Section [pitch] or [yaw] of logs.toml: which logs, and how they name what."""

    fit: tuple[str, ...] = ()
    """Files to be fitted; AXIS_sweep.csv and AXIS_step.csv if not given."""
    validate: tuple[str, ...] = ()
    """Files to be held back; AXIS_sweep_validation.csv and AXIS_step_validation.csv if not given."""
    input: str = "u"
    """Signal of the command; after a minus, with its sign changed."""
    output: str = "y"
    """Signal of the angle; after a minus, with its sign changed."""
    time: str = "time_s"
    """Stamps."""
    unit: Literal["rad", "deg"] = "rad"
    """Of both signals."""
    dc_gain: float | Literal["plateaus"] = "plateaus"
    """Steady angle per steady command, if it is known."""


class MuzzleFiles(Struct, frozen=True, kw_only=True):
    """Section [muzzle] of logs.toml."""

    shots: tuple[str, ...] = ()
    """Files of shots; shots.csv if not given."""
    length_m: Positive | None = None
    """From the pivot to the muzzle [m]; that of tape.json if not given."""
    height_m: Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]; that of tape.json if not given."""


class SensingFiles(Struct, frozen=True, kw_only=True):
    """Section [sensing] of logs.toml; see `identify_sensing`."""

    frame: Frame = "camera"
    """Of the positions of detections."""
    degrees: bool = False
    """Whether angles are in degrees."""
    gimbal_clock: Literal["receipt", "own"] = "receipt"
    """Who stamped the gimbal's logs."""


class LimitsFigures(Struct, frozen=True, kw_only=True):
    """Section [limits] of logs.toml."""

    pitch_deg: tuple[float, float]
    """Smallest and largest pitch, muzzle up positive [°]."""
    yaw_deg: tuple[float, float]
    """Smallest and largest yaw, left positive [°]."""
    max_rate_deg_s: Both
    """Largest rate of a command [°/s]."""
    max_acceleration_deg_s2: Both
    """Largest acceleration of a command [°/s²]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for low, high in (self.pitch_deg, self.yaw_deg):
            if not low < high:
                raise InputError(f"[limits]: expected the lowest angle before the highest, got {low:g}, {high:g}")

    def record(self) -> LimitsRecord:
        """Return the limits in radians."""
        rows: Any = (*zip(self.pitch_deg, self.yaw_deg, strict=True), self.max_rate_deg_s, self.max_acceleration_deg_s2)
        by_axis = np.radians([np.broadcast_to(each, 2) for each in rows]).T.tolist()
        pitch, yaw = (AxisLimits(**dict(zip(AxisLimits.__struct_fields__, each, strict=True))) for each in by_axis)
        return LimitsRecord(pitch=pitch, yaw=yaw, source="logs.toml")


class LogFolder(Struct, frozen=True, kw_only=True):
    """Content of logs.toml."""

    pitch: AxisFiles = AxisFiles()
    """Pitch axis."""
    yaw: AxisFiles = AxisFiles()
    """Yaw axis."""
    muzzle: MuzzleFiles = MuzzleFiles()
    """Shots and tape measures."""
    sensing: SensingFiles = SensingFiles()
    """Frame, unit and clock of the timing logs."""
    limits: LimitsFigures | None = None
    """Limits of the commands; limits.json if not given."""


class Tape(Struct, frozen=True, kw_only=True):
    """Content of tape.json: what a tape measure says."""

    muzzle_length_m: Positive | None = None
    """From the pivot to the muzzle [m]."""
    muzzle_height_m: Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]."""


def check_output(folder: Path, out: Path) -> None:
    """Refuse to write a robot into the folder of its logs.

    Raises:
      InputError: if it is that, or in it.
    """
    if folder.resolve() in (out.resolve(), *out.resolve().parents):
        raise file_error(out, "is the folder of the logs, which are only read", "choose another folder for the robot")


def read_folder(folder: Path) -> tuple[LogFolder, Tape, LimitsRecord | None]:
    """Read logs.toml, tape.json and the limits of logs.toml or limits.json, all of which may be missing.

    Raises:
      InputError: if the folder is missing, or a file is damaged or has an unknown field.
    """
    if not folder.is_dir():
        raise file_error(folder, "there is no such folder", "name the folder of the logs")
    path, tape, limits = (folder / each for each in ("logs.toml", "tape.json", "limits.json"))
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except (OSError, ValueError) as error:
        raise file_error(path, f"is not TOML ({error})", "correct it") from error
    keys = [", ".join(each.__struct_fields__) for each in (AxisFiles, MuzzleFiles, SensingFiles, LimitsFigures, Tape)]
    remedy = "correct it; [pitch] and [yaw] may have {}, [muzzle] {}, [sensing] {}, [limits] {}".format(*keys)
    settings = to_struct(content, path, LogFolder, None, remedy)
    lengths = read_json(tape) if tape.exists() else {}
    measured = to_struct(lengths, tape, Tape, None, f"correct it; it may have {keys[4]}")
    if settings.limits or not limits.exists():
        return settings, measured, settings.limits.record() if settings.limits else None
    remedy = f"write its figures to [limits] in logs.toml, then: archerfish2 identify {folder}"
    return settings, measured, read_struct(limits, LimitsRecord, LimitsRecord.schema, remedy)


def logs_there(folder: Path) -> dict[str, Path]:
    """Return the logs in a folder by their names in lower case."""
    return {each.name.lower(): each for each in sorted(folder.iterdir()) if each.suffix.lower() in LOGS}


def files_there(folder: Path, named: Sequence[str], *usual: str) -> list[Path]:
    """Return the files that are named, else the usual ones that are there."""
    there = logs_there(folder)
    return [folder / each for each in named] or [there[each] for each in usual if each in there]


def axis_logs(folder: Path, axis: str, files: AxisFiles) -> tuple[list[Path], list[Path]]:
    """Return the logs of an axis that are fitted and held back.

    Args:
      folder: of the logs.
      axis: "pitch" or "yaw".
      files: section of logs.toml.

    Raises:
      InputError: if a log is both.
    """
    usual = [[f"{axis}_{kind}{end}.csv" for kind in ("sweep", "step")] for end in ("", "_validation")]
    fitted, held_back = files_there(folder, files.fit, *usual[0]), files_there(folder, files.validate, *usual[1])
    for both in set(fitted).intersection(held_back):
        problem = f"[{axis}] has {both.name} both fitted and held back, expected one of the two"
        raise file_error(folder / "logs.toml", problem, "take it out of fit, or name other logs in validate")
    return fitted, held_back


def read_axis(path: Path, files: AxisFiles) -> Log:
    """Read a log of an axis in radians, with the signs that logs.toml gives.

    Raises:
      InputError: if it can't be used.
    """
    u, y = (each.removeprefix("-") for each in (files.input, files.output))
    log, unit = read_log(path, inputs=u, outputs=y, time=files.time), np.radians(1.0) if files.unit == "deg" else 1.0
    scale_u, scale_y = (-unit if each.startswith("-") else unit for each in (files.input, files.output))
    recordings = (replace(e, inputs=scale_u * e.inputs, outputs=scale_y * e.outputs) for e in log.recordings)
    return replace(log, recordings=tuple(recordings))

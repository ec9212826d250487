"""The folder of a robot's logs: what its files are called, and what logs.toml, tape.json and limits.json hold."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, field
from msgspec.structs import asdict

from archerfish.errors import InputError, file_error
from archerfish.identification.axis.identify import AxisResult
from archerfish.logs.log import Unit, read_log, signals_in
from archerfish.logs.recording import BAGS, Finding, Log, listed
from archerfish.logs.shots import COLUMNS
from archerfish.logs.timing import Frame
from archerfish.records.json_files import read_json, read_toml, to_struct
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.records.record import Struct
from archerfish.robot import Part

AXES: tuple[Literal["pitch", "yaw"], ...] = ("pitch", "yaw")
EXPECTED = "{pitch,yaw}_{sweep,step}[_validation].csv, {pitch,yaw}_step_{N}deg.csv, shots.csv, timing_{sweep,plate}.csv"
"""What logs are called."""
_TIMING = [f"timing_{name}.csv" for name in ("sweep", "plate", "steps", "target", "moments", "commands", "reports")]
"""Logs of camera and link."""
_USUAL = re.compile(r"(pitch|yaw)_step_[1-9]\d*deg\.csv|landings\.csv")
LOGS = (".csv", ".txt", ".tsv", ".jsonl", ".ndjson", ".npz", ".mat", *BAGS.values())
"""Endings of files that somebody means to be read."""
_Positive = Annotated[float, Meta(gt=0.0, le=1e6)]
Both = _Positive | Annotated[tuple[_Positive, ...], Meta(min_length=2, max_length=2)]
"""One figure for both axes, or [pitch, yaw]; a tuple of fixed length beside a number crashes msgspec 0.22."""
_FIGURES = "pitch_deg = [-25, 10], yaw_deg = [-75, 75], max_rate_deg_s = 690, max_acceleration_deg_s2 = 3400"
_BEYOND = 0.1  # of the range between two limits, up to which commands may be beyond them
_FARTHEST_DEG = {"pitch": 90.0, "yaw": 720.0}  # commands beyond which are hardly in the unit that they are said to be


class FileNames(Struct, frozen=True, kw_only=True):
    """Section [pitch.files."NAME"] of logs.toml: what one log names otherwise; the rest is as in [pitch] or [yaw]."""

    input: str | None = None
    """Signal of the command; after a minus, with its sign changed."""
    output: str | None = None
    """Signal of the angle; after a minus, with its sign changed."""
    time: str | None = None
    """Stamps."""
    unit: Unit | None = None
    """Of both signals."""
    input_unit: Unit | None = None
    """Of the command, if it is another one."""
    output_unit: Unit | None = None
    """Of the angle, if it is another one."""


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
    unit: Unit | None = None
    """Of both signals; degrees of a signal whose name says `deg`, else radians, if not given."""
    input_unit: Unit | None = None
    """Of the command, if it is another one."""
    output_unit: Unit | None = None
    """Of the angle, if it is another one."""
    dc_gain: float | Literal["plateaus"] = "plateaus"
    """Steady angle per steady command, if it is known."""
    files: dict[str, FileNames] = field(default_factory=dict)
    """Names of files → what they name otherwise."""

    def of(self, file: str) -> "AxisFiles":
        """Return how a file names what."""
        given = asdict(self.files[file]) if file in self.files else {}
        given = {field: value for field, value in given.items() if value is not None}
        units = dict.fromkeys(("input_unit", "output_unit")) if "unit" in given else {}  # of the section's other logs
        return self.replace(**units | given)


class MuzzleFiles(Struct, frozen=True, kw_only=True):
    """Section [muzzle] of logs.toml."""

    shots: tuple[str, ...] = ()
    """Files of shots; shots.csv if not given."""
    length_m: _Positive | None = None
    """From the pivot to the muzzle [m]; that of tape.json if not given."""
    height_m: _Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]; that of tape.json if not given."""
    columns: dict[str, str] = field(default_factory=dict)
    """Usual names of the shots' columns → those of the files, where they are others."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.columns.keys() - vars(COLUMNS).keys():
            raise InputError(f"columns: there is no {name}, expected some of {', '.join(vars(COLUMNS))}")


class SensingFiles(Struct, frozen=True, kw_only=True):
    """Section [sensing] of logs.toml; see `identify_sensing`."""

    frame: Frame = "camera"
    """Of the positions of detections."""
    degrees: bool = False
    """Whether angles are in degrees."""
    gimbal_clock: Literal["receipt", "own"] = "receipt"
    """Who stamped the gimbal's logs."""
    max_offset_s: _Positive | None = None
    """Largest time offset that is searched [s]."""


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
        rates = np.radians(np.broadcast_to(self.max_rate_deg_s, 2)).tolist()
        accelerations = np.radians(np.broadcast_to(self.max_acceleration_deg_s2, 2)).tolist()
        limits = list[AxisLimits]()
        for travel, rate, acceleration in zip((self.pitch_deg, self.yaw_deg), rates, accelerations, strict=True):
            low, high = np.radians(travel).tolist()
            limits.append(AxisLimits(low=low, high=high, max_rate=rate, max_acceleration=acceleration))
        pitch, yaw = limits
        return LimitsRecord(pitch=pitch, yaw=yaw, source="logs.toml")


class LogFolder(Struct, frozen=True, kw_only=True):
    """Content of logs.toml."""

    pitch: AxisFiles = AxisFiles()
    """Pitch axis."""
    yaw: AxisFiles = AxisFiles()
    """Yaw axis."""
    muzzle: MuzzleFiles = MuzzleFiles()
    """Shots and lengths."""
    sensing: SensingFiles = SensingFiles()
    """Frame, unit and clock of the timing logs."""
    limits: LimitsFigures | None = None
    """Limits of the commands; limits.json if not given."""

    def names_logs(self, part: Part) -> bool:
        """Return whether the section of a part says what its logs, or their signals, are called."""
        if part == "muzzle":
            return bool(self.muzzle.shots or self.muzzle.columns)
        return part in AXES and asdict(self.axis(part)) != asdict(AxisFiles())

    def axis(self, axis: str) -> AxisFiles:
        """Return the section of an axis."""
        return self.pitch if axis == "pitch" else self.yaw


class Lengths(Struct, frozen=True, kw_only=True):
    """Content of tape.json: measured lengths."""

    muzzle_length_m: _Positive | None = None
    """From the pivot to the muzzle [m]."""
    muzzle_height_m: _Positive | None = None
    """Of the muzzle above the ground with the barrel level [m]."""


def read_folder(folder: Path) -> LogFolder:
    """Read logs.toml, with the lengths of tape.json where it has none; both may be missing.

    Raises:
      InputError: if the folder is missing, or a file is damaged or has an unknown field.
    """
    if not folder.is_dir():
        raise file_error(folder, "there is no such folder", "name the folder of the logs")
    path = folder / "logs.toml"
    content = read_toml(path, "correct it") if path.exists() else {}
    keys = [", ".join(kind.__struct_fields__) for kind in (AxisFiles, MuzzleFiles, SensingFiles, LimitsFigures)]
    remedy = "correct it; [pitch] and [yaw] may have {}, [muzzle] {}, [sensing] {}, [limits] {}".format(*keys)
    settings = to_struct(content, path, LogFolder, None, remedy)
    path = folder / "tape.json"
    if not path.exists():
        return settings
    remedy = f"correct it; it may have {', '.join(Lengths.__struct_fields__)}"
    tape = to_struct(read_json(path), path, Lengths, None, remedy)
    muzzle = settings.muzzle
    length_m = muzzle.length_m or tape.muzzle_length_m
    height_m = muzzle.height_m or tape.muzzle_height_m
    return settings.replace(muzzle=muzzle.replace(length_m=length_m, height_m=height_m))


def read_limits(folder: Path, settings: LogFolder) -> dict[Part, LimitsRecord]:
    """Return the limits of logs.toml, else those of limits.json, also of version 0.1; nothing without either.

    Raises:
      InputError: if limits.json is damaged, with the line of logs.toml that can take its place.
    """
    path = folder / "limits.json"
    if settings.limits:
        return {"limits": settings.limits.record()}
    if not path.exists():
        return {}
    remedy = f"take it out, or begin logs.toml with your figures: limits = {{{_FIGURES}}}"
    content = read_json(path, remedy)
    if isinstance(content, dict) and content.get("schema") == "archerfish.limits/1":
        content["schema"] = LimitsRecord.schema  # whose fields are the same
    return {"limits": to_struct(content, path, LimitsRecord, LimitsRecord.schema, remedy)}


def not_understood(folder: Path) -> InputError:
    """Return the error for a folder of which no part takes a file, with a line of logs.toml that names one."""
    paths = logs_there(folder).values()
    problem, remedy = f"expected {EXPECTED}, found {listed(path.name for path in paths)}", "name the logs so"
    for path in paths:
        with suppress(InputError):
            signals = signals_in(path)
            keys = ["input", "output"] if path.suffix in BAGS.values() else ["time", "input", "output"]
            fields = [f'fit = ["{path.name}"]']
            fields += [f'{key} = "{signal}"' for key, signal in zip(keys, signals, strict=False)]
            remedy += f", or say which is which in logs.toml, for instance: yaw = {{{', '.join(fields)}}}"
            return file_error(folder, f"{problem}; {path.name} has {listed(signals)}", remedy)
    return file_error(folder, problem, f"{remedy}, or in logs.toml")


def unused(folder: Path, settings: LogFolder, used: Sequence[Path]) -> list[Finding]:
    """Return findings of files in a folder that no part uses.

    Args:
      folder: of the logs.
      settings: of logs.toml.
      used: logs that are used.
    """
    findings, left = list[Finding](), list[str]()
    taken = {path.resolve() for path in used}
    for name, path in logs_there(folder).items():
        # Logs by the usual names of parts that are absent or not usable need no other name.
        if path.resolve() not in taken and not _USUAL.fullmatch(name):
            left.append(path.name)
    if left:
        message = f"not used: {listed(left)}"
        remedy = f"rename them, or name them in logs.toml; expected names are {EXPECTED}"
        findings.append(Finding("unused", "warning", str(folder), message, remedy))
    if settings.limits and (folder / "limits.json").exists():
        message = "not used: limits.json, since logs.toml has [limits]"
        findings.append(Finding("unused", "warning", str(folder), message, "take one of the two out"))
    return findings


def logs_there(folder: Path) -> dict[str, Path]:
    """Return the logs in a folder by their names in lower case."""
    return {path.name.lower(): path for path in sorted(folder.iterdir()) if path.suffix.lower() in LOGS}


def logs_of_parts(folder: Path, settings: LogFolder) -> dict[Part, list[Path]]:
    """Return the logs of each part of which a folder has enough to identify it."""
    logs = dict[Part, list[Path]]()
    for axis in AXES:
        fitted, held_back = axis_logs(folder, axis, settings.axis(axis))
        if fitted:
            logs[axis] = [*fitted, *held_back]
    if shots := _files_there(folder, settings.muzzle.shots, "shots.csv"):
        logs["muzzle"] = shots
    timing = {path.name.lower(): path for path in _files_there(folder, (), *_TIMING)}
    target = {"timing_target.csv", "timing_moments.csv"}
    if not target <= timing.keys():  # neither says anything without the other
        timing = {name: path for name, path in timing.items() if name not in target}
    if {"timing_sweep.csv", "timing_plate.csv"} <= timing.keys():
        logs["sensing"] = list(timing.values())
    return logs


def _files_there(folder: Path, named: Sequence[str], *usual: str) -> list[Path]:
    """Return the files that are named, else the usual ones that are there."""
    there = logs_there(folder)
    return [folder / name for name in named] or [there[name] for name in usual if name in there]


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
    fitted, held_back = _files_there(folder, files.fit, *usual[0]), _files_there(folder, files.validate, *usual[1])
    for name in files.files.keys() - {path.name for path in [*fitted, *held_back]}:
        remedy = "name it in fit or validate, or correct its name"
        raise file_error(folder / "logs.toml", f'[{axis}.files."{name}"] is of none of its logs', remedy)
    for both in set(fitted).intersection(held_back):
        problem = f"[{axis}] has {both.name} both fitted and held back, expected one of the two"
        raise file_error(folder / "logs.toml", problem, "take it out of fit, or name other logs in validate")
    return fitted, held_back


def read_axis(path: Path, files: AxisFiles) -> Log:
    """Read a log of an axis in radians, with the signs that logs.toml gives.

    Raises:
      InputError: if it can't be used.
    """
    names = files.of(path.name)
    u, y = units_of(names)
    log = read_log(path, inputs=names.input, outputs=names.output, time=names.time, input_unit=u, output_unit=y)
    u_name, y_name = (name.removeprefix("-") for name in (files.input, files.output))  # those of all logs
    named = [replace(log, input_names=(u_name,), output_names=(y_name,)) for log in log.recordings]
    return replace(log, recordings=tuple(named))


def units_of(files: AxisFiles) -> tuple[Unit, Unit]:
    """Return the units of command and angle: those that are given, else those that their names say."""
    input_unit = files.input_unit or files.unit or _named_unit(files.input)
    return input_unit, files.output_unit or files.unit or _named_unit(files.output)


def _named_unit(signal: str) -> Unit:
    return "deg" if re.search(r"(?i)(^|[^a-z])deg(rees?)?($|[^a-z])", signal) else "rad"


def corrections(result: AxisResult, files: AxisFiles) -> tuple[list[str], list[str]]:
    """Return what is wrong with columns, sign and units of an axis, and what logs.toml has to say instead."""
    messages = {finding.code: finding.message for finding in result.findings}
    if "swapped" in messages:  # which the report names, and of which all else follows
        return [], [f'input = "{files.output}"', f'output = "{files.input}"']
    reasons, changes, gain = list[str](), list[str](), result.record.dc_gain.item()
    if gain < 0 and (result.report.usable or not {"sign-flip", "degrees-radians"}.isdisjoint(messages)):
        reasons.append(f"The steady gain is {gain:.3g}: the angle moves against the command.")
        output = files.output
        changes.append(f'output = "{output[1:] if output.startswith("-") else "-" + output}"')
    if "degrees-radians" in messages:
        reasons.append(f"{messages['degrees-radians']}.")
        unit = "deg" if units_of(files)[1] == "rad" else "rad"
        signal = "output" if (abs(gain) > 1) == (unit == "deg") else "input"
        changes.append(f'{signal}_unit = "{unit}"')
    return reasons, changes


def far_commands(axis: AxisResult, limits: LimitsRecord | None) -> list[Finding]:
    """Warn of commands far beyond an axis' limits, or of many turns: units or signs are the likely cause."""
    u = np.degrees(np.concatenate([fit.recording.inputs for fit in axis.fits]))
    low, high = float(u.min()), float(u.max())
    lowest, highest = -_FARTHEST_DEG[axis.part], _FARTHEST_DEG[axis.part]
    slack, expected = 0.0, "expected"
    most = limits and (limits.pitch if axis.part == "pitch" else limits.yaw)
    if most and most.low is not None:
        lowest, highest = np.degrees(most.ends).tolist()
        slack, expected = _BEYOND * (highest - lowest), "its limits are"
    if lowest - slack <= low and high <= highest + slack:
        return []
    message = f"commands of {axis.part} go from {low:.3g} to {high:.3g}°, {expected} {lowest:.3g} to {highest:.3g}°"
    remedy = f'check signs, units and limits; of a log in degrees, write unit = "deg" to [{axis.part}] in logs.toml'
    return [Finding("limits", "warning", axis.part, message, remedy)]

"""A robot from its logs: a folder in, every part that it has logs of identified, the rest assumed and named."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
from msgspec.structs import asdict

from archerfish2 import storage
from archerfish2.errors import InputError, file_error
from archerfish2.identification import robot_files, robot_report
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.muzzle.identify import identify_muzzle
from archerfish2.identification.result import Result
from archerfish2.identification.robot_files import AxisFiles, LogFolder, SensingFiles
from archerfish2.identification.sensing.identify import SensingResult, identify_sensing
from archerfish2.logs.recording import Finding
from archerfish2.records.json_files import plain, write_json
from archerfish2.records.limits import LimitsRecord
from archerfish2.reports.progress import bar
from archerfish2.reports.report import Report, Reported
from archerfish2.reports.style import Figure
from archerfish2.robot import Part, PartVerdict, Robot, axis_fault

PARTS: tuple[Part, ...] = get_args(Part)
_DECISIONS_S = 0.02  # between decisions; the sampling period of a plant divides it
_BEYOND = 0.1  # of the range between two limits, up to which commands may be beyond them
_FARTHEST_DEG = {"pitch": 90.0, "yaw": 720.0}  # commands beyond which are hardly in the unit that they are said to be


@dataclass(frozen=True, eq=False, repr=False)
class RobotResult(Reported):
    """A robot, and what was found of each part that there were logs of."""

    record: Robot
    parts: dict[Part, Result]  # that were identified
    reports: dict[Part, Report]  # of all that there were logs of, judged as parts of a robot
    report: Report  # the parts in one table, and what to do next

    def save(self, folder: str | Path) -> None:
        """Write the robot's records, a page for each part, robot.html and report.json.

        Raises:
          InputError: if a file can't be written.
        """
        folder = Path(folder)
        for part, report in self.reports.items():
            report.write_page(folder / f"{part}.html")
        self.record.save(folder)
        self.report.write_page(folder / "robot.html")
        write_json(folder / "report.json", plain(self.report.to_dict()))

    def plot(self) -> Figure:
        """Draw the step responses of the axes."""
        return robot_report.step_responses(self.record)


def identify_robot(
    folder: str | Path, *, out: str | Path | None = None, name: str = "", seed: int = 0, overwrite: bool = False
) -> RobotResult:
    """Identify everything of a robot that a folder has logs of; what it has none of is the paper's, and is named.

    A part whose logs can't be used is assumed, too, with a verdict that says why; the others are identified.

    Args:
      folder: of the logs, with the names that docs2/your_robot.md lists, or a logs.toml that says which is which.
      out: another folder, for the records and their pages; nothing is written if not given.
      name: of the robot; that of the folder `out`, or of the logs, if not given.
      seed: of the draws.
      overwrite: whether files in `out` that no identification wrote may be replaced.

    Raises:
      InputError: if no part can be identified, logs.toml or tape.json is wrong, or `out` can't be written.
    """
    folder = Path(folder)
    name = (name or Path(out or folder).resolve().name or "robot")[:100]
    if out is None:
        return _identified(folder, name, seed)
    robot_files.check_output(folder, Path(out))
    facts, names = {"logs": str(folder), "name": name, "seed": seed}, ("robot.json", "robot.html")
    with storage.output_folder(Path(out), "identify", folder.glob("*"), overwrite, facts, names) as written:
        found = _identified(folder, name, seed)
        found.save(written)
    return found


def _identified(folder: Path, name: str, seed: int) -> RobotResult:
    settings, there = robot_files.read_folder(folder), robot_files.logs_there(folder)
    jobs, used = _jobs(folder, settings, seed)
    if not jobs:
        raise file_error(folder, *robot_files.not_understood(list(there.values())))
    found, reports = dict[Part, Any](), dict[Part, Report]()
    with bar("identifying", len(jobs), "parts") as advance:
        for part, job in jobs.items():
            advance(len(reports), part)
            try:
                result = job()
                reports[part], found[part] = _judged(result, settings), result
            except InputError as error:
                reports[part] = _failed(part, error)
    if not found:
        raise InputError("; ".join(f"{part}: {report.reasons[0]}" for part, report in reports.items()))
    limits = None
    try:
        limits = robot_files.read_limits(folder, settings)
    except InputError as error:
        reports["limits"] = _failed("limits", error)
    records = {part: result.record for part, result in found.items()} | ({"limits": limits} if limits else {})
    assumed = tuple(part for part in PARTS if part not in records)
    verdicts = {part: _verdict(part, report) for part, report in reports.items()}
    robot = Robot.paper().replace(name=name, assumed=assumed, parts=verdicts, **records)

    axes = [result for result in found.values() if isinstance(result, AxisResult)]
    tables, unread, compared = robot_report.compare_unfitted(folder, settings, robot)
    findings = [finding for axis in axes for finding in _beyond(limits, axis)]
    findings += [*unread, *robot_files.unused(folder, settings, [*used, *compared])]
    not_validated = [axis.part for axis in axes if not any(log.held_back for log in axis.fits)]
    remarks = [f"none held back: {', '.join(not_validated)}"] if not_validated else []
    no_length = ["length of the muzzle (0 m)"] if "muzzle" in found and settings.muzzle.length_m is None else []
    remarks += [f"assumed: {', '.join([*assumed, *no_length])}"] if assumed or no_length else []
    report = robot_report.robot_report(robot, reports, remarks, tables, findings)
    return RobotResult(robot, found, reports, report)


def _jobs(folder: Path, settings: LogFolder, seed: int) -> tuple[dict[Part, Callable[[], Result]], list[Path]]:
    """Return what identifies each part that there are logs of, and these logs."""
    jobs, used, there = dict[Part, Callable[[], Result]](), list[Path](), robot_files.logs_there(folder)
    axes: tuple[tuple[Part, AxisFiles], ...] = ("pitch", settings.pitch), ("yaw", settings.yaw)
    for axis, files in axes:
        fitted, held_back = robot_files.axis_logs(folder, axis, files)
        if fitted:
            jobs[axis] = partial(_axis, axis, files, fitted, held_back, seed)
            used += [*fitted, *held_back]
    muzzle = settings.muzzle
    if shots := robot_files.files_there(folder, muzzle.shots, "shots.csv"):
        lengths: Any = {"length_m": muzzle.length_m or 0.0, "height_m": muzzle.height_m}
        jobs["muzzle"] = partial(identify_muzzle, shots, **lengths, seed=seed)
        used += shots
    timing = {name: there[f"timing_{name}.csv"] for name in robot_files.TIMING if f"timing_{name}.csv" in there}
    if {"sweep", "plate"} <= timing.keys():
        jobs["sensing"] = partial(_sensing, timing, settings.sensing, seed)
        used += timing.values()
    return jobs, used


def _axis(axis: str, files: AxisFiles, fitted: list[Path], held_back: list[Path], seed: int) -> AxisResult:
    return identify_axis(
        [robot_files.read_axis(path, files) for path in fitted],
        validate=[robot_files.read_axis(path, files) for path in held_back],
        axis=axis,
        feedthrough=False,  # an axis has inertia: a plant that may jump makes up for states that it lacks
        dc_gain=files.dc_gain,
        divides_s=_DECISIONS_S,
        seed=seed,
    )


def _sensing(timing: dict[str, Path], files: SensingFiles, seed: int) -> SensingResult:
    for name, other in (("target", "moments"), ("moments", "target")):
        if name in timing and other not in timing:
            remedy = f"record timing_{other}.csv, too, or take timing_{name}.csv out"
            raise file_error(timing[name], f"is there without timing_{other}.csv", remedy)
    return identify_sensing(
        timing["sweep"],
        timing["plate"],
        steps=[timing["steps"]] if "steps" in timing else [],
        target=timing.get("target"),
        target_steps=timing.get("moments"),
        commands=timing.get("commands"),
        feedback=timing.get("reports"),
        seed=seed,
        **asdict(files),
    )


def _failed(part: Part, error: InputError) -> Report:
    """Report a part whose logs can't be used."""
    problem, _, remedy = str(error).rpartition("; ")
    if error.code == "no-column" and part in ("muzzle", "sensing"):
        remedy = "rename it in the first line of the file"
    reasons, title = (f"{problem}; {remedy}",), f"{part}: what the logs say"
    return Report(title, "could not be used, see why", usable=False, reasons=reasons, next_steps=(remedy,))


def _judged(result: Result, settings: LogFolder) -> Report:
    """Return the report of a part, judged as that of a robot: an axis follows its command, in the same unit."""
    report: Report = result.report
    if not isinstance(result, AxisResult):
        return report
    files = settings.pitch if result.part == "pitch" else settings.yaw
    reasons, changes = _corrections(result, files)
    if changes:
        step = f"Write {' and '.join(changes)} to [{result.part}] in logs.toml."
        return replace(report, usable=False, reasons=(*reasons, *report.reasons), next_steps=(step, *report.next_steps))
    fault = axis_fault(result.record, result.part)
    return replace(report, usable=False, reasons=(f"{fault}.",)) if report.usable and fault else report


def _corrections(result: AxisResult, files: AxisFiles) -> tuple[list[str], list[str]]:
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
        unit = "deg" if (files.output_unit or files.unit) == "rad" else "rad"
        signal = "output" if (abs(gain) > 1) == (unit == "deg") else "input"
        changes.append(f'{signal}_unit = "{unit}"')
    return reasons, changes


def _beyond(limits: LimitsRecord | None, axis: AxisResult) -> list[Finding]:
    """Warn of commands far beyond an axis' limits, or of many turns: units or signs are the likely cause."""
    u = np.degrees(np.concatenate([fit.recording.inputs for fit in axis.fits]))
    low, high = float(u.min()), float(u.max())
    if limits:
        most = limits.pitch if axis.part == "pitch" else limits.yaw
        lowest, highest = np.degrees([most.low, most.high]).tolist()
        slack, place, expected = _BEYOND * (highest - lowest), limits.source or "limits.json", "its limits are"
    else:
        lowest, highest = -_FARTHEST_DEG[axis.part], _FARTHEST_DEG[axis.part]
        slack, place, expected = 0.0, axis.part, "expected"
    if lowest - slack <= low and high <= highest + slack:
        return []
    message = f"commands of {axis.part} go from {low:.3g} to {high:.3g}°, {expected} {lowest:.3g} to {highest:.3g}°"
    remedy = f'check signs and units; of a log in degrees, write unit = "deg" to [{axis.part}] in logs.toml'
    return [Finding("limits", "warning", place, message, remedy)]


def _verdict(part: Part, report: Report) -> PartVerdict:
    return PartVerdict(
        usable=report.usable is not False,
        headline=report.headline,
        reasons=report.reasons,
        next_step=next(iter(report.next_steps), ""),
        page=f"{part}.html",
    )

"""A robot from its logs: a folder in, every part that it has logs of identified, the rest assumed and named."""

import contextlib
import itertools
import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import asdict

from archerfish import storage
from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.identification import robot_files
from archerfish.identification.axis.identify import AxisResult, identify_axis
from archerfish.identification.muzzle.estimate import expected_vertical, measured_vertical
from archerfish.identification.muzzle.identify import identify_muzzle
from archerfish.identification.robot_files import AXES, LogFolder
from archerfish.identification.sensing.identify import identify_sensing
from archerfish.identification.simulation import free_run, simulate
from archerfish.identification.statistics import sample_mean
from archerfish.logs.recording import Finding
from archerfish.logs.shots import ShotColumns, read_shots
from archerfish.logs.stamps import resampled
from archerfish.records.json_files import plain, write_json
from archerfish.records.plant import PlantRecord
from archerfish.reports.progress import bar
from archerfish.reports.report import PageLink, Report, Reported, Result, Verdict
from archerfish.reports.style import Figure, new_figure, plot_style
from archerfish.reports.table import Entry, Estimate, Table
from archerfish.robot import RECORDS, Part, PartVerdict, Robot, axis_fault

_DECISIONS_S = 0.02  # between decisions; the sampling period of a plant divides it
_ARGUMENTS = {"plate": "detections", "moments": "target_steps", "reports": "feedback"}
"""Of `identify_sensing`, for timing logs of another name."""
_RECORD: dict[Part, str] = {
    **{axis: f"{axis}_sweep.csv and {axis}_step.csv (archerfish excite {axis})" for axis in AXES},
    "muzzle": "shots.csv: hits on a plate, with speeds",
    "sensing": "timing_sweep.csv and timing_plate.csv",
    "limits": "limits.json, or [limits] in logs.toml",
}
_UNKNOWN = (np.nan, np.nan)  # ends of an interval
_SHOWN_S, _PLATE_M = 0.5, 3.0  # of a step response; distance at which offsets are given as lengths, too


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
        self.record.save(folder)
        links = (PageLink(self.record.name, "robot.html"), *(link for link in self.report.links if link.page))
        for part, report in self.reports.items():
            replace(report, links=links).write_page(folder / f"{part}.html")
        self.report.write_page(folder / "robot.html")
        write_json(folder / "report.json", plain(self.report.to_dict()))

    def plot(self) -> Figure:
        """Draw the step responses of the axes."""
        return _step_responses(self.record)


@checked_arguments
def identify_robot(
    folder: str | Path, *, out: str | Path | None = None, name: str = "", seed: int = 0, overwrite: bool = False
) -> RobotResult:
    """Identify everything of a robot that a folder has logs of; what it has none of is the paper's, and is named.

    A part whose logs can't be used is assumed, too, with a verdict that says why; the others are identified.
    They are written even if a part ends with an error that its logs can't explain, which is raised afterwards.

    Args:
      folder: of the logs, with the names that docs/your_robot.md lists, or a logs.toml that says which is which.
      out: another folder, for the records and their pages; nothing is written if not given.
      name: of the robot; that of the folder `out`, or of the logs, if not given.
      seed: of the draws.
      overwrite: whether files in `out` that no identification wrote may be replaced.

    Raises:
      InputError: if no part can be identified, logs.toml or tape.json is wrong, or `out` can't be written.
    """
    folder = Path(folder)
    name = (name or Path(out or folder).resolve().name or "robot")[:100]
    output: contextlib.AbstractContextManager[Path | None] = contextlib.nullcontext()
    if out is not None:
        if folder.resolve() in (Path(out).resolve(), *Path(out).resolve().parents):
            raise file_error(out, "is the folder of the logs, which are only read", "choose another one for the robot")
        facts, names = {"logs": str(folder), "name": name, "seed": seed}, ("robot.json", "robot.html")
        output = storage.output_folder(Path(out), "identify", folder.glob("*"), overwrite, facts, names)
    with output as written:
        found, faults = _identified(folder, name, seed)
        if written is not None:
            found.save(written)
    if faults:
        raise faults[0]
    return found


def _identified(folder: Path, name: str, seed: int) -> tuple[RobotResult, list[Exception]]:
    """Identify a robot; also return the errors that are none of the logs, with their tracebacks."""
    settings = robot_files.read_folder(folder)
    logs = robot_files.logs_of_parts(folder, settings)
    if not logs:
        raise robot_files.not_understood(folder)
    found = dict[Part, Result]()
    reports = dict[Part, Report]()
    faults = list[Exception]()
    with bar("identifying", len(logs), "parts") as advance:
        for part, paths in logs.items():
            advance(len(reports), part)
            try:
                result = _identified_part(part, paths, folder, settings, seed)
                reports[part] = _judged(result, settings)
                found[part] = result
            except InputError as error:
                if error.code in ("no-column", "no-such-file") and settings.names_logs(part):
                    raise  # logs.toml is wrong
                reports[part] = _failed(part, error)
            except Exception as error:  # a fault of the program: it is raised when the other parts are written
                error.add_note(f"while the {part} was identified")
                faults.append(error)
                problem = InputError(f"archerfish failed with {error!r}; report this with its logs")
                reports[part] = _failed(part, problem)
    if faults and not found:
        raise faults[0]
    if not found:
        raise InputError("; ".join(f"{part}: {report.reasons[0]}" for part, report in reports.items()))
    records = {part: result.record for part, result in found.items()}
    try:
        records |= robot_files.read_limits(folder, settings)
    except InputError as error:
        reports["limits"] = _failed("limits", error)
    assumed = tuple(part for part in RECORDS if part not in records)
    verdicts = {part: _verdict(part, report) for part, report in reports.items()}
    robot = Robot.paper().replace(name=name, assumed=assumed, parts=verdicts, **records)

    tables, unread, compared = _compare_unfitted(folder, settings, robot)
    findings, not_validated = list[Finding](), list[str]()
    for result in found.values():
        if isinstance(result, AxisResult):
            findings += robot_files.far_commands(result, records.get("limits"))
            if not any(log.held_back for log in result.fits):
                not_validated.append(result.part)
    used = itertools.chain(compared, *logs.values())
    findings += [*unread, *robot_files.unused(folder, settings, list(used))]
    unknown: list[str] = [*assumed]
    if "muzzle" in found and settings.muzzle.length_m is None:
        unknown.append("length of the muzzle (0 m)")
    named = {"none held back": not_validated, "assumed": unknown}
    remarks = [f"{remark}: {', '.join(parts)}" for remark, parts in named.items() if parts]
    return RobotResult(robot, found, reports, _report(robot, reports, remarks, tables, findings)), faults


def _identified_part(part: Part, logs: list[Path], folder: Path, settings: LogFolder, seed: int) -> Result:
    """Identify a part from the logs that a folder has of it."""
    if part == "muzzle":
        length_m, height_m = settings.muzzle.length_m or 0.0, settings.muzzle.height_m
        shots = read_shots(*logs, columns=ShotColumns(**settings.muzzle.columns))
        return identify_muzzle(shots, length_m=length_m, height_m=height_m, seed=seed)
    if part == "sensing":
        timing = {log.stem.lower().removeprefix("timing_"): log for log in logs}
        arguments: dict[str, Any] = {_ARGUMENTS.get(name, name): path for name, path in timing.items()}
        arguments["steps"] = [timing["steps"]] if "steps" in timing else []
        return identify_sensing(**arguments, **asdict(settings.sensing), seed=seed)
    files = settings.axis(part)
    fitted, held_back = robot_files.axis_logs(folder, part, files)
    return identify_axis(
        [robot_files.read_axis(path, files) for path in fitted],
        validate=[robot_files.read_axis(path, files) for path in held_back],
        axis=part,
        feedthrough=False,  # an axis has inertia: a plant that may jump makes up for states that it lacks
        dc_gain=files.dc_gain,
        divides_s=_DECISIONS_S,
        seed=seed,
    )


def _failed(part: Part, error: InputError) -> Report:
    """Report a part whose logs can't be used."""
    problem, _, remedy = str(error).rpartition("; ")
    if error.code == "no-column" and part == "muzzle":
        remedy = "rename it in the first line of the file, or name it in logs.toml: [muzzle] columns"
    elif error.code == "no-column" and part == "sensing":
        remedy = "rename it in the first line of the file"
    elif error.code == "no-column":
        _, _, lines = remedy.partition("in logs.toml: ")
        remedy = f"begin logs.toml with {part} = {{{lines}}}, if all logs of {part} have these, else rename the columns"
    reasons, title = (f"{problem}; {remedy}",), f"{part}: what the logs say"
    return Report(title, "could not be used, see why", usable=False, reasons=reasons, next_steps=(remedy,))


def _judged(result: Result, settings: LogFolder) -> Report:
    """Return the report of a part, judged as that of a robot: an axis follows its command, in the same unit."""
    report: Report = result.report
    if not isinstance(result, AxisResult):
        return report
    reasons, changes = robot_files.corrections(result, settings.axis(result.part))
    if changes:
        step = f"Write {' and '.join(changes)} to [{result.part}] in logs.toml."
        return replace(report, usable=False, reasons=(*reasons, *report.reasons), next_steps=(step, *report.next_steps))
    fault = axis_fault(result.record, result.part)
    if not (report.usable and fault):
        return report
    remedy = fault.rpartition("; ")[2]
    return replace(report, usable=False, reasons=(f"{fault}.",), next_steps=(remedy, *report.next_steps))


def _verdict(part: Part, report: Report) -> PartVerdict:
    usable, next_step = report.usable is not False, next(iter(report.next_steps), "")
    return PartVerdict(
        usable=usable, headline=report.headline, reasons=report.reasons, next_step=next_step, page=f"{part}.html"
    )


def _report(
    robot: Robot, reports: dict[Part, Report], remarks: list[str], tables: list[Table], findings: list[Finding]
) -> Report:
    """Report an identified robot; `remarks` stand beside the parts in the headline, `tables` are of unfitted logs."""
    verdicts = dict(sorted(robot.parts.items(), key=lambda item: item[1].usable))  # those that are not usable first
    not_usable = [part for part, verdict in verdicts.items() if not verdict.usable]
    steps = [f"{part}: {step}" for part in verdicts for step in reports[part].next_steps[:2]]
    steps += [f"{part}: record {_RECORD[part]}." for part in robot.assumed if part not in reports]
    if not not_usable:
        steps.append("Train a policy (archerfish train ROBOT), and compare it (archerfish evaluate ROBOT).")
    words: dict[bool, Verdict] = {True: "usable", False: "not usable"}
    links = [PageLink(part, verdict.page, words[verdict.usable]) for part, verdict in verdicts.items()]
    links += [PageLink(part, verdict="assumed") for part in robot.assumed if part not in verdicts]
    rows = [(f"{part}: {verdict.headline}", words[verdict.usable]) for part, verdict in verdicts.items()]
    for part in robot.assumed:
        rows.append((f"{part}: {'immediate and perfect' if part == 'sensing' else 'that of the paper'}", "assumed"))
    return Report(
        title=f"{robot.name}: what the logs say",
        headline="; ".join([", ".join(not_usable or verdicts), *remarks]),
        usable=not not_usable,
        reasons=tuple(f"{part}: {reason}" for part in not_usable for reason in verdicts[part].reasons),
        links=tuple(links),
        doubts=tuple(f"{part}: {doubt}" for part, report in reports.items() for doubt in report.doubts),
        next_steps=tuple(steps),
        tables=(*_offsets(robot), Table("Parts", ("part", "verdict"), tuple(rows)), *tables),
        figures=(("Angles after a step of the command.", partial(_step_responses, robot)),),
        findings=_merged(itertools.chain(findings, *(report.findings for report in reports.values()))),
    )


def _offsets(robot: Robot) -> list[Table]:
    """Return where pellets leave, and by how much stamps are off, of what is identified."""
    rows = list[tuple[Entry, ...]]()
    if "muzzle" in robot.parts and "muzzle" not in robot.assumed:
        for field, above, below in (("pitch_offset", "above", "below"), ("yaw_offset", "left of", "right of")):
            offset, ends = getattr(robot.muzzle, field), robot.muzzle.intervals.get(field, _UNKNOWN)
            sign = 1 if offset > 0 else -1
            low, high = sorted(sign * np.degrees(ends))
            angle = Estimate(float(np.degrees(abs(offset))), float(low), float(high), "°")
            length = f"{100 * _PLATE_M * abs(offset):.1f} cm at {_PLATE_M:g} m"
            rows.append((f"muzzle: pellets leave {above if offset > 0 else below} the barrel", angle, length))
    if "sensing" in robot.parts and robot.sensing:
        name, camera = "camera.time_offset", robot.sensing.camera
        low, high = robot.sensing.intervals.get(name, _UNKNOWN)
        time = Estimate(1e3 * camera.time_offset, 1e3 * low, 1e3 * high, "ms")
        rows.append(("sensing: a frame is exposed after its stamp", time, "by the clock of the gimbal's log"))
    return [Table("Offsets, which controllers correct", ("offset", "95 % interval", ""), tuple(rows))] if rows else []


def _merged(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Join findings that differ in their place alone."""
    samples = defaultdict[Finding, dict[str, int]](dict)
    for finding in findings:
        samples[finding._replace(place="", samples=0)][finding.place] = finding.samples
    merged = []
    for finding, by_place in samples.items():
        places, others = list(by_place)[:3], len(by_place) - 3
        place = ", ".join(places) + (f" and {others} more" if others > 0 else "")
        merged.append(finding._replace(place=place, samples=sum(by_place.values())))
    return tuple(merged)


def _step_responses(robot: Robot) -> Figure:
    """Draw the angles of a robot's axes after a step of their commands; of plants of no gimbal nothing."""
    with plot_style():
        figure, ((panel,),) = new_figure()
        for axis, plant in (("pitch", robot.pitch), ("yaw", robot.yaw)):
            if not axis_fault(plant, axis):
                time = plant.sample_period_s * np.arange(-plant.delay_samples, _SHOWN_S / plant.sample_period_s)
                angle = simulate(plant, 1.0 * (time >= 0)[:, None])[:, 0]
                panel.plot(time, angle, label=f"{axis}, assumed" if axis in robot.assumed else axis)
        panel.set(xlabel="time since the step [s]", ylabel="angle per commanded angle [°/°]")
        if panel.lines:
            panel.legend()
    return figure


def _compare_unfitted(folder: Path, settings: LogFolder, robot: Robot) -> tuple[list[Table], list[Finding], list[Path]]:
    """Compare a robot with logs that no fit uses: landing points, and steps of other sizes.

    Returns:
      Tables, findings of logs that can't be read, and the logs; of parts that are not usable none.
    """
    tables, findings, used = list[Table](), list[Finding](), list[Path]()
    rows = list[tuple[str, int, float]]()
    for name, path in robot_files.logs_there(folder).items():
        match = re.fullmatch(r"(pitch|yaw)_step_([1-9]\d*)deg\.csv|landings\.csv", name)
        part: Any = match and (match[1] or "muzzle")
        if match is None or part not in robot.parts or not robot.parts[part].usable:
            continue
        used.append(path)
        try:
            if part == "muzzle" and not robot.muzzle.height:
                remedy = "write height_m to [muzzle] in logs.toml, or muzzle_height_m to tape.json"
                raise InputError(f"the muzzle's height above the ground is not known; {remedy}")
            if part == "muzzle":
                tables.append(_landing_errors(path, robot))
            else:
                plant: PlantRecord = getattr(robot, part)
                recording = robot_files.read_axis(path, settings.axis(part)).recordings[0]
                log = resampled(recording, plant.sample_period_s)
                fit = free_run(plant, log.inputs, log.outputs).fit_percent
                rows.append((part, int(match[2]), float(fit[0])))
        except InputError as error:
            message, _, remedy = str(error).rpartition("; ")
            findings.append(Finding("unused", "warning", path.name, f"not used: {message}", remedy))
    if rows:
        note = "Large steps reach the motor's limits, which a linear plant lacks; the limits of commands avoid them."
        columns = "axis", "size [°]", "fit [%]"
        tables.append(Table("Steps of other sizes, which no fit has used", columns, tuple(sorted(rows)), note))
    return tables, findings, used


def _landing_errors(path: Path, robot: Robot) -> Table:
    """Compare the mean landing distance of each setting with that of pellets of mean speed."""
    shots = replace(read_shots(path), speed=None)
    expected = expected_vertical(shots, asdict(robot.muzzle))
    number, names = shots.settings()
    rows = list[tuple[Entry, ...]]()
    for setting in range(len(names)):
        here = number == setting
        measured = sample_mean(measured_vertical(shots)[here], "")
        predicted = float(expected[here].mean())
        pitch = f"{np.degrees(shots.pitch[here].mean()):.2f}°"
        rows.append((pitch, int(here.sum()), measured, predicted, 100 * (predicted / measured.value - 1)))
    columns = ("pitch", "shots", "measured [m]", "predicted [m]", "error [%]")
    return Table("Landing points, which no fit has used", columns, tuple(rows))

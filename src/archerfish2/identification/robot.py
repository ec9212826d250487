"""A robot from its logs: a folder in, every part that it has logs of identified, the rest assumed and named."""

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np
from msgspec.structs import asdict

from archerfish2.errors import file_error
from archerfish2.identification import robot_files
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.axis.plots import run_plot
from archerfish2.identification.muzzle.flight import flown, vertical
from archerfish2.identification.muzzle.identify import MuzzleResult, identify_muzzle
from archerfish2.identification.robot_files import AXES, AxisFiles, LogFolder, read_axis
from archerfish2.identification.sensing.identify import SensingResult, identify_sensing
from archerfish2.identification.simulation import FreeRun, simulate
from archerfish2.identification.statistics import mean_estimate
from archerfish2.logs.recording import Finding, listed
from archerfish2.logs.shots import read_shots
from archerfish2.records.json_files import plain, write_json
from archerfish2.records.limits import LimitsRecord
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.progress import bar
from archerfish2.reports.report import Report
from archerfish2.reports.table import Entry, Table
from archerfish2.robot import RECORDS, PartVerdict, Robot

Figures: TypeAlias = tuple[tuple[str, Callable[[], Any]], ...]
_RECORD = {
    "muzzle": "shots.csv: hits on a plate, with speeds",
    "sensing": "timing_sweep.csv and timing_plate.csv",
    "limits": "limits.json, or [limits] in logs.toml",
}


def robot_report(
    robot: Robot, reports: dict[str, Report], tables: list[Table], figures: Figures, findings: list[Finding]
) -> Report:
    """Report an identified robot.

    Args:
      robot: with its verdicts.
      reports: of the parts.
      tables: of what no fit has seen.
      figures: of the same.
      findings: of the folder.
    """
    bad = [part for part, each in robot.parts.items() if not each.usable]

    def of_parts(name: str, most: int | None = None) -> list[str]:
        return [f"{part}: {each}" for part, report in reports.items() for each in getattr(report, name)[:most]]

    record = {part: f"{part}_sweep.csv and {part}_step.csv (archerfish2 excite {part})" for part in AXES} | _RECORD
    steps = [*of_parts("next_steps", 2), *(f"{part}: record {record[part]}." for part in robot.assumed)]
    steps += [] if bad else ["Train a policy (archerfish2 train ROBOT), and compare it (archerfish2 evaluate ROBOT)."]
    rows = [(f"{part}: {e.headline}", ("not usable", "usable")[e.usable]) for part, e in robot.parts.items()]
    absent = {"sensing": "sensing: immediate and perfect"}
    rows += [(absent.get(part, f"{part}: the paper's"), "assumed") for part in robot.assumed]
    pages = f"Their pages: {', '.join(each.page for each in robot.parts.values())}."
    alike = defaultdict[Finding, dict[str, int]](dict)  # samples by place
    for each in (*findings, *(each for report in reports.values() for each in report.findings)):
        alike[each._replace(place="", samples=0)][each.place] = each.samples
    places = {each: ", ".join([*at][:3]) + f" and {len(at) - 3} more" * (len(at) > 3) for each, at in alike.items()}
    every = (each._replace(place=places[each], samples=sum(at.values())) for each, at in alike.items())
    return Report(
        title=f"{robot.name}: what the logs say",
        headline=", ".join(bad or robot.parts) + (f"; assumed: {', '.join(robot.assumed)}" if robot.assumed else ""),
        usable=not bad,
        reasons=tuple(f"{part}: {reason}" for part in bad for reason in robot.parts[part].reasons),
        known=tuple(f"{part}: {each.headline}" for part, each in reports.items()),
        doubts=tuple(of_parts("doubts")),
        next_steps=tuple(steps),
        tables=(Table("Parts", ("part", ""), tuple(rows), pages), *tables),
        figures=figures,
        findings=tuple(every),
    )


def landing_errors(path: Path, muzzle: MuzzleRecord) -> Table:
    """Compare the mean landing distance of each setting with that of pellets of mean speed."""
    shots, rows = replace(read_shots(path), speed=None), list[tuple[Entry, ...]]()
    (number, names), flights = shots.settings(), flown(shots, msgspec.structs.asdict(muzzle))
    for mine in (number == each for each in range(len(names))):
        pitch, measured = np.degrees(shots.pitch[mine].mean()), mean_estimate(vertical(shots)[mine])._replace(unit="")
        predicted = float(flights[mine].mean())
        error = 100 * (predicted / measured.value - 1)
        rows.append((f"{pitch:.2f}°", int(mine.sum()), measured, predicted, error))
    columns = ("pitch", "shots", "measured [m]", "predicted [m]", "error [%]")
    return Table("Landing points, which no fit has seen", columns, tuple(rows))


def large_steps(folder: Path, settings: LogFolder, plants: dict[str, PlantRecord]) -> tuple[list[Table], Figures]:
    """Simulate steps of other sizes; nothing is fitted, so that what a saturated motor lacks shows.

    Returns:
      A table of all, if there are some, and a figure of each axis' largest.
    """
    rows, figures = list[tuple[Entry, ...]](), dict[str, Any]()
    for axis, plant in plants.items():
        names = (re.fullmatch(rf"(?i){axis}_step_([1-9]\d*)deg\.csv", each.name) for each in folder.iterdir())
        for size, name in sorted((int(match[1]), match[0]) for match in names if match):
            log = read_axis(folder / name, getattr(settings, axis)).recordings[0]
            begin = int(np.argmax(log.inputs[:, 0] != log.inputs[0, 0]))
            offset = log.outputs[: max(begin, 1)].mean(0)
            simulated = simulate(plant, np.asarray(log.inputs - log.inputs[0])) + offset
            measured, left = log.outputs[begin:], (log.outputs - simulated)[begin:]
            fit = 100 * (1 - np.linalg.norm(left, axis=0) / np.linalg.norm(measured - measured.mean(0), axis=0))
            rows.append((axis, size, float(fit[0])))
            figures[axis] = f"{name}, not fitted.", partial(run_plot, log, FreeRun(simulated, fit, offset))
    note = "Large steps reach the motor's limits, which a linear plant lacks; the limits of commands avoid them."
    title = "Steps of other sizes, which no fit has seen"
    return [Table(title, ("axis", "size [°]", "fit [%]"), tuple(rows), note)] * bool(rows), tuple(figures.values())


_AXIS: Any = {"feedthrough": False, "divides_s": 0.02}
"""Of `identify_axis`. An axis has inertia, so that its angle never jumps: a plant that may jump makes up for states
that it lacks. Its sampling period divides the time between decisions [s]."""
_TIMING = {"target": "target", "target_steps": "moments", "commands": "commands", "feedback": "reports"}
"""Arguments of `identify_sensing`, and which timing_….csv they are."""
_BEYOND = 0.1  # of the range between two limits, up to which commands may be beyond them
Result: TypeAlias = AxisResult | MuzzleResult | SensingResult


@dataclass(frozen=True, eq=False)
class IdentifiedRobot:
    """A robot, and what was found of each part that there were logs of."""

    robot: Robot
    parts: dict[str, Result]  # that were identified
    report: Report  # the parts in one table, and what to do next

    def save(self, folder: str | Path) -> None:
        """Write the robot's records, a page for each part, robot.html and report.json.

        Raises:
          InputError: if a file can't be written.
        """
        for each in (*self.parts.values(), self.robot):
            each.save(folder)
        self.report.write_page(Path(folder) / "robot.html")
        write_json(Path(folder) / "report.json", plain(self.report.to_dict()))


def identify_robot(folder: str | Path, *, out: str | Path | None = None, name: str = "", seed: int = 0) -> Robot:
    """Identify everything of a robot that a folder has logs of; what it has none of is the paper's, and is named.

    Args:
      folder: of the logs, with the names that docs2/your_robot.md lists, or a logs.toml that says which is which.
      out: another folder, for the records and their pages; nothing is written if not given.
      name: of the robot; that of the folder `out`, or of the logs, if not given.
      seed: of the draws.

    Raises:
      InputError: if a log can't be used, or there is none.
    """
    if out is None:
        return identify_parts(folder, name=name, seed=seed).robot
    robot_files.check_output(Path(folder), Path(out))
    found = identify_parts(folder, name=name or Path(out).resolve().name, seed=seed)
    found.save(out)
    return found.robot


def identify_parts(folder: str | Path, *, name: str = "", seed: int = 0) -> IdentifiedRobot:
    """Identify the parts of a robot; see `identify_robot`."""
    folder = Path(folder)
    settings, tape, limits = robot_files.read_folder(folder)
    there = robot_files.logs_there(folder)
    jobs = dict[str, Callable[[], Result]]()
    for axis in robot_files.AXES:
        fitted, held_back = robot_files.axis_logs(folder, axis, getattr(settings, axis))
        if fitted:
            jobs[axis] = partial(_axis, axis, getattr(settings, axis), fitted, held_back, seed)
    if shots := robot_files.files_there(folder, settings.muzzle.shots, "shots.csv"):
        length_m = settings.muzzle.length_m or tape.muzzle_length_m or 0.0
        height_m = settings.muzzle.height_m or tape.muzzle_height_m
        jobs["muzzle"] = partial(identify_muzzle, shots, length_m=length_m, height_m=height_m, seed=seed)
    if {"timing_sweep.csv", "timing_plate.csv"} <= there.keys():
        jobs["sensing"] = partial(_sensing, there, asdict(settings.sensing), seed)
    if not jobs:
        problem = f"expected {robot_files.EXPECTED}, found {listed(each.name for each in there.values())}"
        raise file_error(folder, problem, "name the logs so, or in logs.toml")
    found = dict[str, Any]()
    with bar("identifying", len(jobs), "parts") as advance:
        for part, job in jobs.items():
            advance(len(found), part)
            found[part] = job()
    records = {part: each.record for part, each in found.items()}
    records |= {"limits": limits} if limits else {}
    name = (name or folder.resolve().name or "robot")[:100]
    assumed = tuple(part for part in RECORDS if part not in records)
    verdicts = {part: _verdict(part, each.report) for part, each in found.items()}
    robot = Robot.paper().replace(name=name, assumed=assumed, parts=verdicts, **records)
    axes = [axis for axis in robot_files.AXES if axis in found]
    tables, figures = large_steps(folder, settings, {axis: records[axis] for axis in axes})
    used = [f"{axis}_step_{size}deg.csv" for table in tables for axis, size, _ in table.rows]
    if "muzzle" in found and "landings.csv" in there:
        tables.insert(0, landing_errors(there["landings.csv"], robot.muzzle))
        used.append("landings.csv")
    for facts in (each.provenance for each in records.values()):
        used += [Path(file).name for file in (*facts.get("inputs", ()), *facts.get("logs", ()))]
    findings = [each for axis in axes if limits for each in _beyond(limits, axis, found[axis])]
    if left := there.keys() - map(str.lower, used):
        remedy = f"rename them, or name them in logs.toml; expected names are {robot_files.EXPECTED}"
        message = f"not used: {listed(there[each].name for each in sorted(left))}"
        findings.append(Finding("unused", "warning", str(folder), message, remedy))
    reports = {part: each.report for part, each in found.items()}
    return IdentifiedRobot(robot, found, robot_report(robot, reports, tables, figures, findings))


def _axis(axis: str, files: AxisFiles, fitted: list[Path], held_back: list[Path], seed: int) -> Result:
    logs, validate = ([robot_files.read_axis(each, files) for each in group] for group in (fitted, held_back))
    return identify_axis(logs, validate=validate, axis=axis, dc_gain=files.dc_gain, seed=seed, **_AXIS)


def _sensing(there: dict[str, Path], how: dict[str, Any], seed: int) -> Result:
    sweep, plate, steps = (there.get(f"timing_{name}.csv") for name in ("sweep", "plate", "steps"))
    others: Any = {argument: there.get(f"timing_{name}.csv") for argument, name in _TIMING.items()}
    return identify_sensing(sweep or "", plate or "", steps=[steps] if steps else [], seed=seed, **how, **others)


def _beyond(limits: LimitsRecord, axis: str, result: AxisResult) -> list[Finding]:
    """Warn of commands far beyond an axis' limits, of which units or signs of either are the likely cause."""
    u, most = np.concatenate([each.recording.inputs for each in result.fits]), getattr(limits, axis)
    low, high, slack = u.min(), u.max(), _BEYOND * (most.high - most.low)
    if most.low - slack <= low and high <= most.high + slack:
        return []
    angles = np.degrees([low, high, most.low, most.high])
    message = "commands of {} go from {:.3g} to {:.3g}°, its limits are {:.3g} to {:.3g}°".format(axis, *angles)
    return [Finding("limits", "warning", limits.source or "limits.json", message, "check units and signs of both")]


def _verdict(part: str, report: Report) -> PartVerdict:
    # A robot's commands and angles are in radians both.
    units = tuple(f"{each.message}: {each.remedy}" for each in report.findings if each.code == "degrees-radians")
    usable, reasons = report.usable is not False and not units, (*units, *report.reasons)
    step, page = next(iter(report.next_steps), ""), f"{part}.html"
    return PartVerdict(usable=usable, headline=report.headline, reasons=reasons, next_step=step, page=page)

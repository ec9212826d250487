"""Report of an identified robot: its parts, what is assumed, what no fit has seen, and what to do next."""

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np

from archerfish2.identification.axis.plots import run_plot
from archerfish2.identification.muzzle.flight import flown, vertical
from archerfish2.identification.robot_files import AXES, LogFolder, read_axis
from archerfish2.identification.simulation import simulate
from archerfish2.identification.statistics import mean_estimate
from archerfish2.identification.validation import FreeRun
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import read_shots
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.records.plant import PlantRecord
from archerfish2.reports.report import Report
from archerfish2.reports.table import Entry, Table
from archerfish2.robot import Robot

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

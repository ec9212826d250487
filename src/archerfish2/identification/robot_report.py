"""The first page of an identified robot: its parts in one table, logs that no fit uses, and what to do next."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import asdict

from archerfish2.errors import InputError
from archerfish2.identification.muzzle.estimate import expected_vertical, measured_vertical
from archerfish2.identification.robot_files import AXES, LogFolder, logs_there, read_axis
from archerfish2.identification.simulation import free_run, simulate
from archerfish2.identification.statistics import sample_mean
from archerfish2.logs.recording import Finding
from archerfish2.logs.shots import read_shots
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.reports.style import Figure, new_figure, plot_style
from archerfish2.reports.table import Entry, Table
from archerfish2.robot import Part, Robot, axis_fault

_RECORD = {
    **{axis: f"{axis}_sweep.csv and {axis}_step.csv (archerfish2 excite {axis})" for axis in AXES},
    "muzzle": "shots.csv: hits on a plate, with speeds",
    "sensing": "timing_sweep.csv and timing_plate.csv",
    "limits": "limits.json, or [limits] in logs.toml",
}
_SHOWN_S, _PLATE_M = 0.5, 3.0  # of a step response; distance at which offsets are given as lengths, too


def robot_report(
    robot: Robot, reports: Mapping[Part, Report], remarks: Iterable[str], tables: list[Table], findings: list[Finding]
) -> Report:
    """Report an identified robot.

    Args:
      robot: with its verdicts.
      reports: of the parts that there are logs of.
      remarks: beside the parts in the headline, as that none of an axis' logs was held back.
      tables: of logs that no fit uses.
      findings: of the folder.
    """
    usable = [part for part, verdict in robot.parts.items() if verdict.usable]
    not_usable = [part for part in robot.parts if part not in usable]
    steps = [f"{part}: {step}" for part in (*not_usable, *usable) for step in reports[part].next_steps[:2]]
    steps += [f"{part}: record {_RECORD[part]}." for part in robot.assumed if part not in reports]
    if not not_usable:
        steps.append("Train a policy (archerfish2 train ROBOT), and compare it (archerfish2 evaluate ROBOT).")
    rows = [(f"{part}: {robot.parts[part].headline}", "not usable") for part in not_usable]
    rows += [(f"{part}: {robot.parts[part].headline}", "usable") for part in usable]
    for part in robot.assumed:
        rows.append((f"{part}: {'immediate and perfect' if part == 'sensing' else 'that of the paper'}", "assumed"))
    pages = f"Their pages: {', '.join(verdict.page for verdict in robot.parts.values())}."
    return Report(
        title=f"{robot.name}: what the logs say",
        headline="; ".join([", ".join(not_usable or usable), *remarks]),
        usable=not not_usable,
        reasons=tuple(f"{part}: {reason}" for part in not_usable for reason in robot.parts[part].reasons),
        known=tuple(_corrected_first(robot)),
        doubts=tuple(f"{part}: {doubt}" for part, report in reports.items() for doubt in report.doubts),
        next_steps=tuple(steps),
        tables=(Table("Parts", ("part", "verdict"), tuple(rows), pages), *tables),
        figures=(("Angles after a step of the command.", partial(step_responses, robot)),),
        findings=_merged([*findings, *(each for report in reports.values() for each in report.findings)]),
    )


def _corrected_first(robot: Robot) -> Iterator[str]:
    """Yield what a team corrects first: where pellets leave, and by how much stamps are off."""
    if "muzzle" in robot.parts and "muzzle" not in robot.assumed:
        up, left = robot.muzzle.pitch_offset, robot.muzzle.yaw_offset
        for offset, side in ((up, "above" if up > 0 else "below"), (left, "left of" if left > 0 else "right of")):
            angle, length = abs(np.degrees(offset)), 100 * _PLATE_M * abs(offset)
            yield f"muzzle: pellets leave {angle:.2f}° {side} the barrel, {length:.1f} cm at {_PLATE_M:g} m."
    if "sensing" in robot.parts and robot.sensing:
        offset_ms = 1e3 * robot.sensing.camera.time_offset
        yield f"sensing: a frame is exposed {offset_ms:.4g} ms after its stamp, by the clock of the gimbal's log."


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


def step_responses(robot: Robot) -> Figure:
    """Draw the angles of a robot's axes after a step of their commands; of plants of no gimbal nothing."""
    with plot_style():
        figure, ((panel,),) = new_figure()
        for axis, plant in (("pitch", robot.pitch), ("yaw", robot.yaw)):
            if not axis_fault(plant, axis):
                time = plant.sample_period_s * np.arange(-plant.delay_samples, _SHOWN_S / plant.sample_period_s)
                angle = simulate(plant, 1.0 * (time >= 0)[:, None])[:, 0]
                panel.plot(time, angle, label=f"{axis}, assumed" if axis in robot.assumed else axis)
        panel.set(xlabel="time since the step [s]", ylabel="angle per commanded angle")
        panel.legend()
    return figure


def compare_unfitted(folder: Path, settings: LogFolder, robot: Robot) -> tuple[list[Table], list[Finding], list[Path]]:
    """Compare a robot with logs that no fit uses: landing points, and steps of other sizes.

    Args:
      folder: of the logs.
      settings: of logs.toml.
      robot: with its verdicts.

    Returns:
      Tables, findings of logs that can't be read, and the logs; of parts that are not usable none.
    """
    tables, findings, used, rows = list[Table](), list[Finding](), list[Path](), list[tuple[str, int, float]]()
    usable = [part for part, verdict in robot.parts.items() if verdict.usable]
    for name, path in logs_there(folder).items():
        match = re.fullmatch(r"(pitch|yaw)_step_([1-9]\d*)deg\.csv|landings\.csv", name)
        if match is None or (part := match[1] or "muzzle") not in usable:
            continue
        used.append(path)
        try:
            if part == "muzzle":
                tables.append(landing_errors(path, robot.muzzle))
                continue
            log = read_axis(path, getattr(settings, part)).recordings[0]
            fit = free_run(getattr(robot, part), log.inputs, log.outputs).fit_percent
            rows.append((part, int(match[2]), float(fit[0])))
        except InputError as error:
            message, _, remedy = str(error).rpartition("; ")
            findings.append(Finding("unused", "warning", path.name, f"not used: {message}", remedy))
    if rows:
        note = "Large steps reach the motor's limits, which a linear plant lacks; the limits of commands avoid them."
        columns = "axis", "size [°]", "fit [%]"
        tables.append(Table("Steps of other sizes, which no fit has used", columns, tuple(sorted(rows)), note))
    return tables, findings, used


def landing_errors(path: Path, muzzle: MuzzleRecord) -> Table:
    """Compare the mean landing distance of each setting with that of pellets of mean speed.

    Raises:
      InputError: if the file can't be read.
    """
    shots, rows = replace(read_shots(path), speed=None), list[tuple[Entry, ...]]()
    (number, names), expected = shots.settings(), expected_vertical(shots, asdict(muzzle))
    for setting in range(len(names)):
        here = number == setting
        measured, predicted = sample_mean(measured_vertical(shots)[here], ""), float(expected[here].mean())
        pitch = f"{np.degrees(shots.pitch[here].mean()):.2f}°"
        rows.append((pitch, int(here.sum()), measured, predicted, 100 * (predicted / measured.value - 1)))
    columns = ("pitch", "shots", "measured [m]", "predicted [m]", "error [%]")
    return Table("Landing points, which no fit has used", columns, tuple(rows))

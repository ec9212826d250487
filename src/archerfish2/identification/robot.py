"""A robot from its logs: a folder in, every part that it has logs of identified, the rest assumed and named."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np

from archerfish2.errors import file_error
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.muzzle.flight import landing_distance
from archerfish2.identification.muzzle.identify import identify_muzzle
from archerfish2.identification.muzzle.result import MuzzleResult
from archerfish2.identification.robot_files import AXES, AxisFiles, axis_logs, read_folder
from archerfish2.identification.robot_report import Landing, LargeStep, robot_report
from archerfish2.identification.sensing.identify import identify_sensing
from archerfish2.identification.sensing.result import SensingResult
from archerfish2.identification.simulation import simulate
from archerfish2.identification.statistics import mean_estimate
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Log
from archerfish2.logs.shots import read_shots
from archerfish2.progress import bar
from archerfish2.records.json_files import plain, write_json
from archerfish2.records.limits import LimitsRecord
from archerfish2.records.muzzle import MuzzleRecord
from archerfish2.reports.report import Report
from archerfish2.robot import Part, PartVerdict, Robot

DECISION_S = 0.02
"""Time between decisions, which a plant's sampling period divides [s]."""
_SWEEP, _PLATE = "timing_sweep.csv", "timing_plate.csv"


@dataclass(frozen=True, eq=False)
class IdentifiedRobot:
    """A robot, and what was found of each part that there were logs of."""

    robot: Robot
    axes: dict[str, AxisResult]  # by axis
    muzzle: MuzzleResult | None
    sensing: SensingResult | None
    landings: tuple[Landing, ...]  # predicted landing points against measured ones
    steps: tuple[LargeStep, ...]  # of other sizes than those that were fitted

    @property
    def report(self) -> Report:
        """The parts in one table, and what to do next."""
        return robot_report(self)

    def save(self, folder: str | Path) -> None:
        """Write the robot's records, a page for each part, robot.html and report.json.

        Raises:
          InputError: if a file can't be written.
        """
        for each in (*self.axes.values(), self.muzzle, self.sensing):
            if each is not None:
                each.save(folder)
        self.robot.save(folder)
        self.report.write_page(Path(folder) / "robot.html")
        write_json(Path(folder) / "report.json", plain(self.report.to_dict()))


def identify_robot(folder: str | Path, *, out: str | Path | None = None, seed: int = 0) -> Robot:
    """Identify everything of a robot that a folder has logs of; what it has none of is the paper's, and is named.

    Args:
      folder: of the logs, with the names that docs2/your_robot.md lists, or a logs.toml that says which is which.
      out: folder for the records and their pages; nothing is written if not given.
      seed: of the draws.

    Raises:
      InputError: if a log can't be used, or there is none.
    """
    found = identify_parts(folder, seed)
    if out is not None:
        found.save(out)
    return found.robot


def identify_parts(folder: str | Path, seed: int = 0, name: str = "") -> IdentifiedRobot:
    """Identify the parts of a robot; see `identify_robot`.

    Args:
      folder: of the logs.
      seed: of the draws.
      name: of the robot; the folder's if not given.
    """
    folder = Path(folder)
    settings, tape = read_folder(folder)
    limits = settings.limits.record() if settings.limits else None
    if limits is None and (folder / "limits.json").exists():
        limits = LimitsRecord.load(folder / "limits.json")
    jobs: dict[str, Callable[[], Any]] = {}
    for axis in AXES:
        files: AxisFiles = getattr(settings, axis)
        fitted, held_back = axis_logs(folder, axis, files)
        if fitted:
            jobs[axis] = partial(_axis, axis, files, fitted, held_back, seed)
    if settings.muzzle.shots or (folder / "shots.csv").exists():
        shots = [folder / each for each in settings.muzzle.shots or ("shots.csv",)]
        length, height = (
            getattr(settings.muzzle, name) or getattr(tape, f"muzzle_{name}") for name in ("length_m", "height_m")
        )
        jobs["muzzle"] = partial(identify_muzzle, shots, length_m=length or 0.0, height_m=height, seed=seed)
    if (folder / _SWEEP).exists() and (folder / _PLATE).exists():
        jobs["sensing"] = partial(_sensing, folder, seed)
    if not jobs:
        names = f"pitch_sweep.csv, yaw_sweep.csv, shots.csv or {_SWEEP} with {_PLATE}"
        raise file_error(folder, f"expected {names}, found none of them", "name the logs so, or in logs.toml")
    found: dict[str, Any] = {}
    with bar("identifying", len(jobs), "parts") as advance:
        for part, job in jobs.items():
            advance(len(found), part)
            found[part] = job()
    records: dict[str, Any] = {part: getattr(each, part, None) or each.plant for part, each in found.items()}
    records |= {"limits": limits} if limits else {}
    robot = Robot.paper().replace(name=name or folder.resolve().name[:100] or "robot", **records)
    assumed = tuple(part for part in get_args(Part) if part not in records)
    robot = robot.replace(assumed=assumed, parts={part: _verdict(part, each.report) for part, each in found.items()})
    landings = _landings(folder / "landings.csv", robot.muzzle) if "muzzle" in found else ()
    axes = {axis: found[axis] for axis in AXES if axis in found}
    steps = tuple(each for axis in axes for each in _large_steps(folder, axis, axes[axis], getattr(settings, axis)))
    return IdentifiedRobot(robot, axes, found.get("muzzle"), found.get("sensing"), landings, steps)


def _axis(axis: str, files: AxisFiles, fitted: list[Path], held_back: list[Path], seed: int) -> AxisResult:
    # An axis has inertia, so that its angle never jumps: a plant that may jump makes up for states that it lacks.
    return identify_axis(
        [_read(each, files) for each in fitted],
        validate=[_read(each, files) for each in held_back],
        axis=axis,
        feedthrough=False,
        dc_gain="plateaus",
        divides_s=DECISION_S,
        seed=seed,
    )


def _read(path: Path, files: AxisFiles) -> Log:
    """Read a log of an axis in radians."""
    log, scale = read_log(path, inputs=files.input, outputs=files.output, time=files.time), np.radians(1.0)
    if files.unit == "rad":
        return log
    recordings = (replace(each, inputs=scale * each.inputs, outputs=scale * each.outputs) for each in log.recordings)
    return replace(log, recordings=tuple(recordings))


def _sensing(folder: Path, seed: int) -> SensingResult:
    there = {each.stem: each for each in folder.glob("timing_*.csv")}
    return identify_sensing(
        folder / _SWEEP,
        folder / _PLATE,
        steps=[there["timing_steps"]] if "timing_steps" in there else [],
        target=there.get("timing_target"),
        target_steps=there.get("timing_moments"),
        commands=there.get("timing_commands"),
        feedback=there.get("timing_reports"),
        seed=seed,
    )


def _verdict(part: str, report: Report) -> PartVerdict:
    # A robot's commands and angles are in radians both.
    units = tuple(f"{each.message}: {each.remedy}" for each in report.findings if each.code == "degrees-radians")
    return PartVerdict(
        usable=report.usable is not False and not units,
        headline=report.headline,
        reasons=(*units, *report.reasons),
        next_step=next(iter(report.next_steps), ""),
        page=f"{part}.html",
    )


def _landings(path: Path, muzzle: MuzzleRecord) -> tuple[Landing, ...]:
    """Compare the mean landing distance of each setting with that of a pellet of mean speed."""
    if not path.exists():
        return ()
    shots = read_shots(path)
    number, _ = shots.settings()
    found = []
    for each in range(int(number.max()) + 1):
        pitch, mine = float(shots.pitch[number == each].mean()), shots.distance[number == each]
        height = np.asarray(muzzle.height + muzzle.length * np.sin(pitch))
        angle, drag = np.asarray(pitch + muzzle.pitch_offset), np.asarray(muzzle.drag)
        predicted = float(landing_distance(np.asarray(muzzle.speed), angle, height, drag))
        found.append(Landing(float(np.degrees(pitch)), mean_estimate(mine)._replace(unit=""), len(mine), predicted))
    return tuple(found)


def _large_steps(folder: Path, axis: str, result: AxisResult, files: AxisFiles) -> Iterator[LargeStep]:
    """Simulate steps of other sizes; nothing is fitted, so that what a saturated motor lacks shows."""
    names = {each.name: re.fullmatch(rf"{axis}_step_(\d+)deg\.csv", each.name) for each in folder.iterdir()}
    for size, name in sorted((int(match[1]), name) for name, match in names.items() if match):
        log = _read(folder / name, files).recordings[0]
        begin = int(np.argmax(log.inputs[:, 0] != log.inputs[0, 0]))
        measured = log.outputs[:, 0] - log.outputs[: max(begin, 1), 0].mean()
        simulated = simulate(result.plant, np.asarray(log.inputs - log.inputs[0]))[:, 0]
        left = np.linalg.norm((measured - simulated)[begin:])
        fit = 100 * (1 - left / np.linalg.norm(measured[begin:] - measured[begin:].mean()))
        yield LargeStep(axis, size, log.time - log.time[begin], measured, simulated, float(fit))

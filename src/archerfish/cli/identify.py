"""`archerfish identify gimbal` and `archerfish identify muzzle`: from logs to a plant record and a muzzle record."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console

from archerfish.cli.identification_summary import (
    Summary,
    axis_summary,
    muzzle_summary,
    print_axis,
    print_muzzle,
)
from archerfish.figures.identification import BodeData, LandingGroup, SimulatedRun, axis_figure, landing_figure
from archerfish.figures.style import save_figure
from archerfish.identification.frequency import measured_response, plant_response
from archerfish.identification.gimbal import AxisIdentification, identify_axis
from archerfish.identification.muzzle_likelihood import identify_muzzle
from archerfish.identification.validation import free_run
from archerfish.paper.conditions import assumed_conditions
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.muzzle import write_muzzle
from archerfish.records.plant import write_plant
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording, read_recording_csv
from archerfish.records.shots import ShotColumns, merge_shots, read_shots_csv


@dataclass(frozen=True)
class IdentifyGimbal:
    """Identify one gimbal axis from logs (CSV) of its input and output.

    Give a sweep and a step of the same axis as two logs: the sweep settles the dynamics, the step the steady gain. Each
    log is a separate experiment with its own start and zero. Logs name their columns in the first line and are sampled
    at equal intervals.
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """CSV logs to fit."""
    time: str = "time_s"
    """Column of the time stamps, in seconds."""
    input: tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]] = ()
    """Columns of the inputs, usually the one command (u if not given)."""
    output: str = "y"
    """Column of the output, for instance the measured angle."""
    sample_period_s: float | None = None
    """Sampling period of logs without time stamps, in seconds; --time is then not read."""
    order: int = 4
    """Number of states; 4 is the paper's choice."""
    max_delay: int = 20
    """Longest input delay that is tried, in samples."""
    validate: tyro.conf.UseAppendAction[tuple[tuple[Path, ...], ...]] = ()
    """CSV logs that are not fitted but foretold, the honest measure of the plant."""
    axis: str = "axis"
    """Name of the axis and of the written files, for instance pitch or yaw."""
    out: Path = Path("runs/identify")
    """Folder for AXIS.json, AXIS.safetensors (the plant record), AXIS.svg and AXIS.png."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    json: Path | None = None
    """Also write what is printed to this file."""


@dataclass(frozen=True)
class IdentifyMuzzle:
    """Identify the muzzle from landing points (CSV): speed and its scatter, pitch offset and its scatter.

    Shots at one pitch setting only need the measured speed of each; without speeds, shoot at several settings.
    Distances are measured along level ground from the point below the muzzle.
    """

    shots: tyro.conf.Positional[tuple[Path, ...]]
    """CSV files with one shot per line."""
    pitch: str = ShotColumns.pitch_deg
    """Column of the barrel's elevation in degrees, muzzle up positive."""
    yaw: str = ShotColumns.yaw_deg
    """Column of the barrel's azimuth in degrees, left positive; may be missing."""
    distance: str = ShotColumns.distance_m
    """Column of the landing distance in metres."""
    speed: str = ShotColumns.speed_m_s
    """Column of the measured muzzle speed in m/s; may be missing."""
    lateral: str = ShotColumns.lateral_m
    """Column of the landing point's distance from the barrel's plane in metres, left positive; may be missing."""
    height_m: float | None = None
    """Height of the muzzle above the ground in metres; estimated if not given."""
    drag_per_m: float = field(default_factory=lambda: assumed_conditions().drag)
    """Quadratic drag coefficient k in 1/m."""
    estimate_drag: bool = False
    """Estimate the drag coefficient too; needs one more pitch setting."""
    name: str = "muzzle"
    """Name of the written files."""
    out: Path = Path("runs/identify")
    """Folder for NAME.json (the muzzle record), NAME.svg and NAME.png."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    json: Path | None = None
    """Also write what is printed to this file."""


def run_gimbal(command: IdentifyGimbal, console: Console | None = None) -> Summary:
    """Fit the axis, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a log, a column, an option or the output folder can't be used.
    """
    console = console or Console()
    if not command.logs:
        raise InputError("identify gimbal: no log given; name at least one CSV file")
    _check_outputs(command.out, command.json)
    logs, tests = ([_recording(path, command) for path in paths] for paths in (command.logs, _flat(command.validate)))
    with console.status(f"fitting order {command.order} …"):
        result = identify_axis(logs, command.order, max_delay=command.max_delay, axis=command.axis)
    inputs = [*command.logs, *_flat(command.validate)]
    result = replace(result, plant=replace(result.plant, provenance=provenance(command.seed, inputs)))
    rows = [
        (str(path), _run(result, test, "validation")) for path, test in zip(_flat(command.validate), tests, strict=True)
    ]
    files = _write_axis(command, result, rows[0][1] if rows else _run(result, logs[-1], "training"), logs)
    summary = axis_summary(result, command.logs, [(file, run.fit_percent) for file, run in rows], files)
    _finish(summary, command.json)
    print_axis(console, summary)
    return summary


def run_muzzle(command: IdentifyMuzzle, console: Console | None = None) -> Summary:
    """Estimate the muzzle, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a file, a column, an option or the output folder can't be used, or the shots can't separate the
        parameters.
    """
    console = console or Console()
    if not command.shots:
        raise InputError("identify muzzle: no file of shots given; name at least one CSV file")
    _check_outputs(command.out, command.json)
    columns = ShotColumns(command.pitch, command.yaw, command.distance, command.speed, command.lateral)
    shots = merge_shots([read_shots_csv(path, columns) for path in command.shots])
    with console.status("maximising the likelihood …"):
        drag = None if command.estimate_drag else command.drag_per_m
        result = identify_muzzle(shots, drag=drag, height=command.height_m)
    muzzle = replace(result.muzzle, provenance=provenance(command.seed, command.shots))
    files = [command.out / f"{command.name}{ending}" for ending in (".json", ".svg", ".png")]
    write_muzzle(files[0], muzzle)
    figure = landing_figure(LandingGroup(shots.pitch, shots.distance, result.distance, result.distance_sd))
    for path in files[1:]:
        save_figure(path, figure)
    summary = muzzle_summary(shots, result, files)
    _finish(summary, command.json)
    print_muzzle(console, summary)
    return summary


def _check_outputs(out: Path, json: Path | None) -> None:
    for folder in (out, *([json.parent] if json else [])):
        storage.check_writable(folder)


def _finish(summary: Summary, json: Path | None) -> None:
    if json is not None:
        storage.write_json(json, summary)


def _flat(groups: tuple[tuple[Any, ...], ...]) -> list[Any]:
    return [each for group in groups for each in group]


def _recording(path: Path, command: IdentifyGimbal) -> Recording:
    inputs = _flat(command.input) or ["u"]
    return read_recording_csv(path, command.time, inputs, [command.output], sample_period_s=command.sample_period_s)


def _run(result: AxisIdentification, recording: Recording, kind: str) -> SimulatedRun:
    run = free_run(result.plant, recording, result.offset)
    return SimulatedRun(
        recording.time,
        recording.outputs[:, 0],
        run.simulated[:, 0],
        run.fit_percent.item(),
        f"{kind} {recording.source}",
    )


def _write_axis(
    command: IdentifyGimbal, result: AxisIdentification, run: SimulatedRun, logs: list[Recording]
) -> list[Path]:
    files = [command.out / f"{command.axis}{ending}" for ending in (".json", ".safetensors", ".svg", ".png")]
    write_plant(files[0], result.plant)
    figure = axis_figure(run, _bode(result, logs), output=command.output, title=command.axis)
    for path in files[2:]:
        save_figure(path, figure)
    return files


def _bode(result: AxisIdentification, logs: list[Recording]) -> BodeData:
    nyquist = 0.5 / result.plant.sample_period_s
    lowest = max(result.excited_band_hz[0], 1e-3 * nyquist)
    frequency = np.geomspace(lowest, 0.999 * nyquist, 400)
    measured = measured_response(logs)
    empty: NDArray[np.float64] = np.zeros(0)
    kept = measured.coherence > 0.5 if measured else empty.astype(bool)
    return BodeData(
        frequency,
        plant_response(result.plant, frequency)[:, 0, 0],
        measured.frequency_hz[kept] if measured else empty,
        measured.response[kept] if measured else empty.astype(np.complex128),
        result.excited_band_hz,
    )

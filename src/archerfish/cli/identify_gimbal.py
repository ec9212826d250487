"""`archerfish identify gimbal`: from logs of an axis to its plant record."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from archerfish.cli.axis_picture import axis_picture, simulated_run
from archerfish.cli.axis_summary import Summary, axis_summary, print_axis
from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.figures.identification import SimulatedRun
from archerfish.figures.style import save_figure
from archerfish.identification.gimbal import AxisIdentification, identify_axis
from archerfish.records.errors import InputError
from archerfish.records.plant import write_plant
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording, read_recording_csv

AXIS_ENDINGS = (".json", ".safetensors", ".svg", ".png")


@dataclass(frozen=True)
class IdentifyGimbal:
    """Identify a gimbal axis from logs (CSV) of its input and output.

    Give a sweep and a step of the same axis as two logs: the sweep settles the dynamics, the step the steady gain. Each
    log is a separate experiment with its own start and zero. Logs name their columns in the first line and are sampled
    at equal intervals.

    Writes AXIS.json and AXIS.safetensors (the plant record, for train and evaluate), AXIS.svg and AXIS.png (measured
    and simulated, residual, frequency response), and prints the fit.

    Examples:
      archerfish identify gimbal sweep.csv step.csv --validate step2.csv --axis yaw
      archerfish identify gimbal log.csv --time t --input u1 u2 --output angle
    """

    logs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="LOG…", help_behavior_hint="")]
    """CSV logs to fit, at least one."""
    time: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "time_s"
    """Column of the time stamps, in seconds."""
    input: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
        tyro.conf.arg(metavar="COLUMN…", help_behavior_hint="(default: u)"),
    ] = ()
    """Columns of the inputs, usually the one command."""
    output: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "y"
    """Column of the output, for instance the measured angle."""
    sample_period_s: Annotated[float | None, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="")] = None
    """Sampling period of logs without time stamps; --time is then not read."""
    order: int = 4
    """Number of states; 4 is the paper's choice."""
    max_delay: int = 20
    """Longest input delay that is tried, in samples."""
    validate: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[Path, ...], ...]],
        tyro.conf.arg(metavar="LOG…", help_behavior_hint=""),
    ] = ()
    """CSV logs that are not fitted but foretold, the honest measure of the plant."""
    axis: Annotated[str, tyro.conf.arg(metavar="NAME")] = "axis"
    """Name of the axis and of the written files, for instance pitch or yaw."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    json: JsonFile = None
    """Also write what is printed to this file."""


def run_gimbal(command: IdentifyGimbal, console: Console | None = None) -> Summary:
    """Fit the axis, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a log, a column, an option or the output folder can't be used.
    """
    console = console or Console()
    if not command.logs:
        raise InputError("identify gimbal: no log given; name at least one CSV file")
    check_file_name("--axis", command.axis)
    held_back = _flat(command.validate)
    logs, tests = ([_recording(path, command) for path in paths] for paths in (command.logs, held_back))
    with run_folder(command.out) as folder:
        with console.status(f"fitting order {command.order} …"):
            result = identify_axis(logs, command.order, max_delay=command.max_delay, axis=command.axis)
        origin = provenance(command.seed, [*command.logs, *held_back])
        result = replace(result, plant=replace(result.plant, provenance=origin))
        runs = [simulated_run(result, test, "validation") for test in tests]
        shown = runs[0] if runs else simulated_run(result, logs[-1], "training")
        _write_axis(folder, command, result, shown, logs)
    files = [command.out / f"{command.axis}{ending}" for ending in AXIS_ENDINGS]
    fits = [(str(path), run.fit_percent) for path, run in zip(held_back, runs, strict=True)]
    summary = axis_summary(result, command.logs, fits, files)
    print_axis(console, summary)
    return summary


def _flat(groups: tuple[tuple[Any, ...], ...]) -> list[Any]:
    return [each for group in groups for each in group]


def _recording(path: Path, command: IdentifyGimbal) -> Recording:
    inputs = _flat(command.input) or ["u"]
    return read_recording_csv(path, command.time, inputs, [command.output], sample_period_s=command.sample_period_s)


def _write_axis(
    folder: Path, command: IdentifyGimbal, result: AxisIdentification, run: SimulatedRun, logs: list[Recording]
) -> None:
    write_plant(folder / f"{command.axis}.json", result.plant)
    figure = axis_picture(result, run, logs, output=command.output)
    for ending in (".svg", ".png"):
        save_figure(folder / f"{command.axis}{ending}", figure)

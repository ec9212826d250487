"""`archerfish identify gimbal`: from logs of an axis to its plant record."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from archerfish.cli.axis_advice import Advice, tried_advice
from archerfish.cli.axis_evidence import AxisEvidence, gather_evidence
from archerfish.cli.axis_page import axis_page
from archerfish.cli.axis_picture import axis_picture
from archerfish.cli.axis_summary import Summary, axis_summary, print_axis
from archerfish.cli.axis_usability import judged_fit
from archerfish.cli.axis_verdict import Verdict, verdict
from archerfish.cli.gimbal_logs import GimbalLogs, LogReading, read_gimbal_logs
from archerfish.cli.options import Folder, JsonFile, Switch
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.figures.style import save_figure
from archerfish.identification.axis.gimbal import USUAL_DELAY, AxisIdentification, identify_axis
from archerfish.identification.axis.order_choice import ORDERS, USUAL_ORDERS, OrderTrial, choose_order
from archerfish.identification.doctor.time_stamps import UnevenStampsError
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.log_files import log_parts
from archerfish.records.plant import PlantQuality, write_plant
from archerfish.records.provenance import provenance

_SENSIBLE_FIT = 60.0
"""Fit from which a log that was refused makes sense with an option [%]."""
AXIS_ENDINGS = (".json", ".safetensors", ".html", ".svg", ".png")


@dataclass(frozen=True)
class IdentifyGimbal:
    """Identify a gimbal axis from logs of its input and output.

    Give a sweep and a step of the same axis as two logs: the sweep settles the dynamics, the step the steady gain. Each
    log is a separate experiment with its own start and zero. A log is a text table (CSV; columns by name, or by number
    without a first line of names), an .npz or .mat file (arrays by name), or a ROS bag (TOPIC/FIELD). What is wrong
    with a log is said, repaired where that is certain, and else refused.

    Writes AXIS.json and AXIS.safetensors (the plant record, for train and evaluate), AXIS.html (what is known, how
    sure that is, and what to do next), AXIS.svg and AXIS.png (measured and simulated, residual, frequency response),
    and prints the verdict.

    Examples:
      archerfish identify gimbal sweep.csv step.csv --validate step2.csv --axis yaw
      archerfish identify gimbal log.csv --time t --input u1 u2 --output angle
      archerfish identify gimbal bag/ --input /command/data --output /joint_states/yaw/position
    """

    logs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="LOG…", help_behavior_hint="")]
    """Logs to fit, at least one."""
    time: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "time_s"
    """Column of the time stamps, in seconds unless its name ends in _ms, _us or _ns; a bag has its own."""
    input: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
        tyro.conf.arg(metavar="COLUMN…", help_behavior_hint="(default: u)"),
    ] = ()
    """Columns of the inputs, usually the one command."""
    output: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "y"
    """Column of the output, for instance the measured angle."""
    sample_period_s: Annotated[float | None, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="")] = None
    """Sampling period of logs without time stamps; --time is then not read."""
    rate: Annotated[str | None, tyro.conf.arg(metavar="COLUMN", help_behavior_hint="")] = None
    """Column of the measured rate of the output, a second output that shares the poles; needs a single input."""
    order: Annotated[int | Literal["auto"], tyro.conf.arg(metavar="INT|auto")] = "auto"
    """Number of states; 4 is the paper's choice. With auto, 1 to 4 are tried and Bayes's information criterion decides;
    with logs held back up to 8, and the fit on those decides."""
    dc_gain: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[float, ...], ...]],
        tyro.conf.arg(metavar="GAIN…", help_behavior_hint="(default: estimated)"),
    ] = ()
    """Steady gain from each input, where it is known from elsewhere: the plant is held to it, and told if the logs
    contradict it."""
    max_delay: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: as the logs need)")] = (
        None
    )
    """Longest input delay that is tried, in samples; 20 at first, and more where the logs call for it."""
    feedthrough: Switch = True
    """Don't let the output jump with the input, whatever the logs say. An angle can't, as the axis has inertia: its
    delay is then told more exactly."""
    validate: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[Path, ...], ...]],
        tyro.conf.arg(metavar="LOG…", help_behavior_hint=""),
    ] = ()
    """Logs that are not fitted but foretold, the honest measure of the plant."""
    axis: Annotated[str, tyro.conf.arg(metavar="NAME")] = "axis"
    """Name of the axis and of the written files, for instance pitch or yaw."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Of the posterior draws in the record."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        return Outputs(tuple(self.out / f"{self.axis}{ending}" for ending in AXIS_ENDINGS))


def run_gimbal(command: IdentifyGimbal, console: Console | None = None) -> Summary:
    """Fit the axis, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a log, a column, an option or the output folder can't be used.
    """
    console = console or Console()
    check_file_name("--axis", command.axis)
    logs = _read_logs(command)
    with run_folder(command.out, make_writer(command)) as folder:
        evidence, judgement = _judged(command, logs, console)
        _write_axis(folder, command, evidence, judgement)
    files = [command.out / f"{command.axis}{ending}" for ending in AXIS_ENDINGS]
    print_axis(console, evidence, judgement, files)
    return axis_summary(evidence, judgement, files)


def judge_logs(command: IdentifyGimbal) -> tuple[AxisEvidence, Verdict]:
    """Fit and judge the axis as the command does, but write and print nothing.

    Raises:
      InputError: if a log, a column or an option can't be used.
    """
    return _judged(command, _read_logs(command), Console(quiet=True))


def _read_logs(command: IdentifyGimbal) -> GimbalLogs:
    if not command.logs:
        raise InputError("identify gimbal: no log given; name at least one file")
    try:
        return read_gimbal_logs(command.logs, _flat(command.validate), _reading(command))
    except UnevenStampsError as error:
        raise _taken_evenly(command, error) from error


def _taken_evenly(command: IdentifyGimbal, error: UnevenStampsError) -> InputError:
    """Try the samples as if taken at equal intervals, and say so in the error if they make sense then."""
    period = float(f"{error.sample_period_s:.6g}")
    try:
        fit = judged_fit(judge_logs(replace(command, sample_period_s=period))[0]).run.fit_percent
    except InputError:
        return error
    if fit < _SENSIBLE_FIT:
        return error
    option = f"--sample-period-s {period:g}"
    advice = Advice(option, {"sample_period_s": period}, fit, f"with {option} the fit is {fit:.1f} %")
    remedy = f"or, if the samples were taken evenly and only stamped late, pass {option}: the fit is {fit:.1f} % then"
    return InputError(f"{error}, {remedy}", error.code, (advice,))


def _judged(command: IdentifyGimbal, logs: GimbalLogs, console: Console) -> tuple[AxisEvidence, Verdict]:
    result, trials = _fitted(command, logs, console)
    free = _free_of_gain(command, logs, len(result.plant.A), console)
    parts = [part for path in (*command.logs, *_flat(command.validate)) for part in log_parts(path)]
    result = replace(_said_once(result, logs), plant=replace(result.plant, provenance=provenance(command.seed, parts)))
    evidence = gather_evidence(result, logs.training, logs.validation, logs.findings, trials, free, logs.samples)
    with console.status("trying options …"):
        advice = tried_advice(evidence, command.time if command.sample_period_s is None else None)
    return evidence, verdict(evidence, advice)


def _flat(groups: tuple[tuple[Any, ...], ...]) -> list[Any]:
    return [each for group in groups for each in group]


def _reading(command: IdentifyGimbal) -> LogReading:
    inputs = _flat(command.input) or ["u"]
    outputs = [command.output] if command.rate is None else [command.output, command.rate]
    if command.rate is not None and len(inputs) > 1:
        raise InputError(f"--rate needs a single input, got {len(inputs)}; leave --rate out, or name one --input")
    order = 1 if command.order == "auto" else command.order
    max_delay = USUAL_DELAY if command.max_delay is None else command.max_delay
    return LogReading(command.time, inputs, outputs, command.sample_period_s, order, max_delay)


def _fitted(
    command: IdentifyGimbal, logs: GimbalLogs, console: Console
) -> tuple[AxisIdentification, tuple[OrderTrial, ...]]:
    """Fit the axis with the order asked for, or with the one that the logs ask for."""
    fitted, held_back = ([log.recording for log in group] for group in (logs.training, logs.validation))
    options: dict[str, Any] = {
        "max_delay": command.max_delay,
        "axis": command.axis,
        "seed": command.seed,
        "dc_gain": _flat(command.dc_gain) or None,
        "feedthrough": command.feedthrough,
    }
    if command.order != "auto":
        with console.status(f"fitting order {command.order} …"):
            return identify_axis(fitted, command.order, **options), ()
    with console.status("fitting order 1 …") as status:
        choice = choose_order(
            fitted,
            held_back,
            orders=ORDERS if held_back else USUAL_ORDERS,
            advance=lambda order: status.update(f"fitting order {order + 1} …"),
            **options,
        )
    return choice.result, choice.trials


def _free_of_gain(command: IdentifyGimbal, logs: GimbalLogs, order: int, console: Console) -> AxisIdentification | None:
    """Fit once more without the steady gain that was asked for, so that the logs can speak against it."""
    if not _flat(command.dc_gain):
        return None
    with console.status("fitting without the given steady gain …"):
        fitted = [log.recording for log in logs.training]
        return identify_axis(
            fitted,
            order,
            max_delay=command.max_delay,
            axis=command.axis,
            seed=command.seed,
            feedthrough=command.feedthrough,
        )


def _said_once(result: AxisIdentification, logs: GimbalLogs) -> AxisIdentification:
    """Drop the remarks that the examination of the logs has made already."""
    said = {f"{each.place}: {each.message}; {each.remedy}" for each in logs.findings}
    return replace(result, remarks=tuple(each for each in result.remarks if each not in said))


def _write_axis(folder: Path, command: IdentifyGimbal, evidence: AxisEvidence, judgement: Verdict) -> None:
    judged = judged_fit(evidence)
    quality = PlantQuality(judgement.usable, judged.run.fit_percent, judged.path.name, judged.kind == "validation")
    write_plant(folder / f"{command.axis}.json", replace(evidence.result.plant, quality=quality))
    storage.write_text(folder / f"{command.axis}.html", axis_page(evidence, judgement, output=command.output))
    fitted = [log.recording for log in evidence.of_kind("training")]
    figure = axis_picture(evidence.result, judged_fit(evidence).run, fitted, output=command.output)
    for ending in (".svg", ".png"):
        save_figure(folder / f"{command.axis}{ending}", figure)

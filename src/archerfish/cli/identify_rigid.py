"""`archerfish identify rigid`: from logs of torque and angle to the inertia, damping and gravity of an axis."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.parsing import check_file_name
from archerfish.cli.rigid_logs import RigidLog, read_rigid_log
from archerfish.cli.rigid_summary import Summary, print_rigid, rigid_summary
from archerfish.cli.run_folder import run_folder
from archerfish.cli.sample_count import count_samples
from archerfish.figures.rigid_axis import RigidRun, rigid_figure
from archerfish.figures.style import save_figure
from archerfish.identification.rigid.fit import Friction, RigidIdentification, identify_rigid_axis
from archerfish.records.errors import InputError
from archerfish.records.findings import Finding
from archerfish.records.log_files import log_parts
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording
from archerfish.records.rigid_axis import AxisKind, write_rigid_axis

RIGID_ENDINGS = ("_rigid.json", "_rigid.svg", "_rigid.png")


@dataclass(frozen=True)
class IdentifyRigid:
    """Identify inertia, damping and gravity of an axis from torque and angle.

    The axis is the rigid body of eqs (1)–(3). A pitch axis swings against gravity and must move through its travel; a
    yaw axis must speed up and slow down. The torque may be the motor's current times --torque-per-unit. Angles are in
    radians, unless the column's name ends in _deg. Each log is cut into segments with starts of their own, since an
    axis under torque alone drifts away from any simulation. Coulomb friction is estimated too where the logs are far
    better explained with it.

    Writes AXIS_rigid.json (the record, with 95 % intervals), AXIS_rigid.svg and .png (torque, measured and simulated
    angle, residual), and prints the parameters.

    Examples:
      archerfish identify rigid pitch_torque.csv --axis-kind pitch --torque current_a --torque-per-unit 0.741
      archerfish identify rigid yaw1.csv yaw2.csv --axis-kind yaw --rate rate --axis yaw
    """

    logs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="LOG…", help_behavior_hint="")]
    """Logs to fit, at least one."""
    axis_kind: AxisKind = "yaw"
    """Whether gravity acts: on pitch it does."""
    time: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "time_s"
    """Column of the time stamps, in seconds unless its name ends in _ms, _us or _ns; a bag has its own."""
    torque: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "torque"
    """Column of the torque in N m, or of what is proportional to it."""
    torque_per_unit: float = 1.0
    """Torque in N m per unit of that column; negative where it counts the other way."""
    angle: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = "angle"
    """Column of the measured angle."""
    rate: Annotated[str | None, tyro.conf.arg(metavar="COLUMN", help_behavior_hint="(default: not used)")] = None
    """Column of the measured rate in rad/s, for instance a gyroscope's."""
    sample_period_s: Annotated[float | None, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="")] = None
    """Sampling period of logs without time stamps; --time is then not read."""
    friction: Friction = "auto"
    """Whether Coulomb friction is estimated: where the logs are that much better explained (auto), never, or always."""
    segment_s: float = 2.0
    """Longest stretch that is simulated from one start, in seconds; 0 for whole logs."""
    axis: Annotated[str, tyro.conf.arg(metavar="NAME")] = "axis"
    """Name of the axis and of the written files."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    json: JsonFile = None
    """Also write what is printed to this file."""


def run_rigid(command: IdentifyRigid, console: Console | None = None) -> Summary:
    """Fit the rigid axis, write its record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a log, a column, an option or the output folder can't be used, or the logs can't separate the
        parameters.
    """
    console = console or Console()
    if not command.logs:
        raise InputError("identify rigid: no log given; name at least one file")
    check_file_name("--axis", command.axis)
    findings: list[Finding] = []
    logs = [_read(path, command, findings) for path in command.logs]
    recordings = [recording for log in logs for recording in log.recordings]
    samples = count_samples(sum(log.samples for log in logs), findings)
    with run_folder(command.out) as folder:
        with console.status("fitting the rigid axis …"):
            result = identify_rigid_axis(
                recordings,
                command.axis_kind,
                torque_per_unit=command.torque_per_unit,
                segment_s=command.segment_s,
                friction=command.friction,
                axis=command.axis,
            )
        origin = provenance(command.seed, [part for path in command.logs for part in log_parts(path)])
        write_rigid_axis(folder / f"{command.axis}_rigid.json", replace(result.record, provenance=origin))
        figure = rigid_figure(_worst_run(command, result, recordings), title=command.axis)
        for ending in RIGID_ENDINGS[1:]:
            save_figure(folder / f"{command.axis}{ending}", figure)
    files = [command.out / f"{command.axis}{ending}" for ending in RIGID_ENDINGS]
    summary = rigid_summary(result, recordings, findings, samples, files)
    print_rigid(console, summary)
    return summary


def _read(path: Path, command: IdentifyRigid, findings: list[Finding]) -> RigidLog:
    period = command.sample_period_s
    if period is not None and not 0 < period < np.inf:
        raise InputError(f"--sample-period-s must be above 0 s, got {period:g}")
    outputs = [command.angle] if command.rate is None else [command.angle, command.rate]
    return read_rigid_log(path, command.torque, outputs, time=command.time, sample_period_s=period, findings=findings)


def _worst_run(command: IdentifyRigid, result: RigidIdentification, recordings: list[Recording]) -> RigidRun:
    """Show the recording that fits worst: the others are no worse than that."""
    worst = int(np.argmin(result.fit_percent))
    recording = recordings[worst]
    return RigidRun(
        recording.time,
        command.torque_per_unit * recording.inputs[:, 0],
        recording.outputs[:, 0],
        result.simulated[worst][:, 0],
        result.fit_percent[worst],
        recording.source,
    )

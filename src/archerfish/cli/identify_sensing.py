"""`archerfish identify sensing`: from two short recordings to the sensing record."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.parsing import check_file_name
from archerfish.cli.run_folder import run_folder
from archerfish.cli.sensing_page import alignment_data, sensing_page
from archerfish.cli.sensing_summary import Summary, print_sensing, sensing_summary
from archerfish.cli.sensing_verdict import sensing_verdict
from archerfish.figures.sensing import sensing_figure
from archerfish.figures.style import save_figure
from archerfish.identification.sensing.estimate import GimbalClock, SensingIdentification, identify_sensing
from archerfish.records import storage
from archerfish.records.errors import InputError
from archerfish.records.message_times import read_message_times_csv
from archerfish.records.provenance import provenance
from archerfish.records.sensing import write_sensing
from archerfish.records.sensing_logs import (
    DetectionColumns,
    Frame,
    GimbalColumns,
    read_detections_csv,
    read_gimbal_log_csv,
    read_target_steps_csv,
)

SENSING_ENDINGS = (".json", ".html", ".svg", ".png")


@dataclass(frozen=True)
class IdentifySensing:
    """Identify camera and link from a yaw sweep and from steps (CSV).

    Estimates the camera's rate, latency, time offset to the gimbal, noise and misses, and the delay from command to
    motion, with 95 % intervals. What the logs can't separate is told as a sum, or left out with what to record.

    The first gimbal log and the first log of detections are those of a sweep before a plate at rest. Further gimbal
    logs may hold command steps; a second log of detections that of a target stepping at the moments of --target-steps.

    Writes NAME.json (the sensing record), NAME.html (what is known, how sure that is, and what to do next), NAME.svg
    and NAME.png.

    Examples:
      archerfish identify sensing sweep.csv --detections plate.csv --out runs/my-robot
      archerfish identify sensing sweep.csv steps.csv --detections plate.csv target.csv --target-steps moments.csv
    """

    logs: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="GIMBAL…", help_behavior_hint="")]
    """CSV logs of the gimbal's angles, that of the sweep first."""
    detections: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG…", help_behavior_hint="")] = ()
    """CSV logs of detections: of the plate at rest, then of the stepping target if there is one."""
    target_steps: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """CSV file with the moments at which the target was halfway through its steps, on the clock of receipts."""
    commands: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """CSV file with sent_s and received_s of commands, if the gimbal stamps what it receives; the simulator of a robot
    needs it to send its commands as late."""
    feedback: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """CSV file with sent_s and received_s of the gimbal's feedback, if the gimbal stamps what it sends."""
    time: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = GimbalColumns.time
    """Column of the time stamps in seconds, in every file."""
    yaw: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = GimbalColumns.yaw
    """Column of the measured yaw, left positive."""
    pitch: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = GimbalColumns.pitch
    """Column of the measured pitch, muzzle up positive; may be missing."""
    command: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = GimbalColumns.command
    """Column of the commanded yaw; may be missing."""
    receive: Annotated[str, tyro.conf.arg(metavar="COLUMN")] = DetectionColumns.receive
    """Column of the time at which a detection reached the program, on the gimbal log's clock; may be missing."""
    position: Annotated[tuple[str, str, str], tyro.conf.arg(metavar="X Y Z", help_behavior_hint="(default: x y z)")] = (
        DetectionColumns.position
    )
    """Columns of the plate's position in metres."""
    frame: Frame = "camera"
    """Frame of the position: camera (x forward, y left, z up), optical (x right, y down, z forward), or base, which
    needs the gimbal angle that rotated each detection in the columns rotated_yaw and rotated_pitch."""
    degrees: bool = False
    """Angles in the logs are in degrees, not radians."""
    gimbal_clock: GimbalClock = "receipt"
    """Who stamped the gimbal logs: the program on receipt, by the clock of --receive, or the gimbal, by its own."""
    max_offset_s: Annotated[float | None, tyro.conf.arg(metavar="SECONDS", help_behavior_hint="")] = None
    """Largest time offset that is tried; by default 1 s if the clocks overlap, else any."""
    name: Annotated[str, tyro.conf.arg(metavar="NAME")] = "sensing"
    """Name of the written files."""
    out: Folder = Path("runs/identify")
    """Folder for the record and the pictures."""
    seed: int = 0
    """Recorded with the result; nothing in this command is random."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        return Outputs(tuple(self.out / f"{self.name}{ending}" for ending in SENSING_ENDINGS))


def run_sensing(command: IdentifySensing, console: Console | None = None) -> Summary:
    """Estimate camera and link, write record and picture, print the summary, and return what --json writes.

    Raises:
      InputError: if a file, a column, an option or the output folder can't be used, or the logs can't bear the
        estimate.
    """
    console = console or Console()
    _check(command)
    with run_folder(command.out, make_writer(command)) as folder:
        with console.status("aligning camera and gimbal …"):
            result = _identified(command)
        steps = [] if command.target_steps is None else [command.target_steps]
        steps += [each for each in (command.commands, command.feedback) if each is not None]
        origin = provenance(command.seed, [*command.logs, *command.detections, *steps])
        record, verdict = replace(result.sensing, provenance=origin), sensing_verdict(result)
        write_sensing(folder / f"{command.name}.json", record)
        storage.write_text(folder / f"{command.name}.html", sensing_page(result, record, verdict, command.name))
        figure = sensing_figure(alignment_data(result))
        for ending in (".svg", ".png"):
            save_figure(folder / f"{command.name}{ending}", figure)
    summary = sensing_summary(result, verdict, [command.out / f"{command.name}{ending}" for ending in SENSING_ENDINGS])
    print_sensing(console, summary)
    return summary


def _check(command: IdentifySensing) -> None:
    if not command.logs:
        raise InputError("identify sensing: no gimbal log given; name the CSV file of the yaw sweep")
    if not command.detections:
        raise InputError("identify sensing: no detections given; name their CSV file with --detections")
    if command.max_offset_s is not None and not command.max_offset_s > 0:
        raise InputError(f"--max-offset-s must be > 0 s, got {command.max_offset_s}")
    check_file_name("--name", command.name)


def _identified(command: IdentifySensing) -> SensingIdentification:
    gimbal = GimbalColumns(command.time, command.yaw, command.pitch, command.command)
    camera = DetectionColumns(command.time, command.receive, command.position)
    return identify_sensing(
        [read_gimbal_log_csv(path, gimbal, degrees=command.degrees) for path in command.logs],
        [
            read_detections_csv(path, camera, frame=command.frame, degrees=command.degrees)
            for path in command.detections
        ],
        None if command.target_steps is None else read_target_steps_csv(command.target_steps, command.time),
        commands=None if command.commands is None else read_message_times_csv(command.commands),
        feedback=None if command.feedback is None else read_message_times_csv(command.feedback),
        gimbal_clock=command.gimbal_clock,
        max_offset=command.max_offset_s,
    )

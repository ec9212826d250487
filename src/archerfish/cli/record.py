"""`archerfish record`: excitations played on the virtual robot, and the logs that come of them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console

from archerfish.cli.options import Folder, JsonFile, Switch
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.progress import progress_bar
from archerfish.cli.robot_options import (
    PhysicsChoice,
    RobotName,
    check_above_zero,
    limits_to_write,
    one_robot,
    seeds_from,
    write_or_keep_limits,
)
from archerfish.cli.run_folder import run_folder
from archerfish.cli.summary_end import print_end
from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import InputError, file_error
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.lab.log_files import (
    write_axis_log,
    write_columns,
    write_detections,
    write_gimbal_log,
)
from archerfish.virtual_robot.lab.recorder import AXES, Play, Stamps, Trace, host_trace, play, robot_trace
from archerfish.virtual_robot.lab.shooting import Plate, check_aim
from archerfish.virtual_robot.lab.signals import steps, sweep
from archerfish.virtual_robot.lab.timing import TimingPlan, record_timing, timing_length, timing_plan

Array = NDArray[np.float64]
Kind = Literal["sweep", "step", "timing"]

_OfKind = tyro.conf.arg(metavar="VALUE", help_behavior_hint="(default: of the kind)")


@dataclass(frozen=True)
class Record:
    """Play an excitation on the virtual robot, and write the logs.

    sweep is a sine of 1° from 2 to 50 Hz, step are steps of 2° to both sides; each comes with a second log, of another
    course, to hold back for --validate. Both are for archerfish identify gimbal. timing is what archerfish identify
    sensing asks for: a plate at rest while the yaw sweeps, command steps, and steps of the target.

    By default the robot itself plays the excitation (inject) and stamps its log, so that commands are logged when they
    come into force. --play link sends them from the host; --stamps host logs them as a host does that knows its own
    clock only: the latency and its jitter are then in the log.

    Writes AXIS_sweep.csv and AXIS_sweep_validation.csv (or step), or timing_sweep.csv, timing_steps.csv,
    timing_plate.csv, timing_target.csv, timing_moments.csv, and from the robot's stamps timing_commands.csv and
    timing_reports.csv; and limits.json, what the team knows of its robot; one
    that is there with other content is kept.

    Examples:
      archerfish record sweep --axis yaw --out runs/my-robot
      archerfish record sweep --axis yaw --commands runs/excite/yaw_sweep_command.csv
      archerfish record timing --robot worn --out runs/worn
    """

    kind: tyro.conf.Positional[Kind]
    """What is recorded."""
    robot: RobotName = "infantry"
    """Robot: infantry, worn, or a TOML file (docs/virtual_robot.md)."""
    axis: Literal["pitch", "yaw"] = "yaw"
    """Axis of a sweep or of steps."""
    amplitude_deg: Annotated[float | None, _OfKind] = None
    """Amplitude in degrees: 1 for a sweep, 2 for steps, 15 for the yaw sweep of timing (less where the robot
    turns less far)."""
    low_hz: Annotated[float | None, _OfKind] = None
    """Lowest frequency: 2, for timing 0.2."""
    high_hz: Annotated[float | None, _OfKind] = None
    """Highest frequency: 50, for timing 2."""
    duration_s: Annotated[float | None, _OfKind] = None
    """Length of a sweep in seconds: 10, for timing 20."""
    hold_s: float = 3.0
    """How long a step is held in seconds; friction delays the last of the way."""
    count: int = TimingPlan.steps
    """How many command steps, and steps of the target, timing has."""
    centre_deg: float = 0.0
    """Angle about which the axis is moved."""
    commands: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Play this file instead, as archerfish excite writes it: time_s and u, the commanded angle in radians."""
    stamps: Stamps = "robot"
    """Whose clock stamps commands and reports."""
    play: Annotated[Play | None, tyro.conf.arg(help_behavior_hint="(default: inject; link with --stamps host)")] = None
    """Who plays a sweep or steps: the robot itself, or the host over the link."""
    validation: Switch = True
    """Do without the log that is held back."""
    physics: PhysicsChoice = None
    """The robot's mechanics."""
    out: Folder = Path("runs/record")
    """Folder for the logs."""
    seed: int = 0
    """Of the robot's noise."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes; limits.json that is there is kept."""
        names = _timing_names(self) if self.kind == "timing" else _axis_names(self)
        return Outputs((*(self.out / name for name in names), *limits_to_write(self.out)))


Summary = dict[str, Any]


def run_record(command: Record, console: Console | None = None) -> Summary:
    """Record, write the logs, print what was done, and return what --json writes.

    Raises:
      InputError: if an option, a file or the output folder can't be used.
    """
    console = console or Console()
    robot = load_robot(command.robot)
    _check(command)
    work = _timing if command.kind == "timing" else _axis
    with run_folder(command.out, make_writer(command)) as folder:
        names = work(command, robot, folder, console)
        names += write_or_keep_limits(folder, command.out, robot, console)
    files = [str(command.out / name) for name in names]
    print_end(console, [], files)
    return {"robot": robot.schema.name, "kind": command.kind, "axis": command.axis, "files": files}


def _check(command: Record) -> None:
    given = {name: getattr(command, name) for name in ("amplitude_deg", "low_hz", "high_hz", "duration_s")}
    check_above_zero(hold_s=command.hold_s, **{name: value for name, value in given.items() if value is not None})
    if command.commands is not None and command.kind == "timing":
        raise InputError("--commands plays a sweep or steps; timing has commands of its own, leave the option out")
    if command.play == "inject" and command.stamps == "host":
        raise InputError("--play inject: a host does not know when the robot plays; take --stamps robot or --play link")
    if command.play == "inject" and command.kind == "timing":
        raise InputError("--play inject: timing measures the link, so commands go through it; leave the option out")


def _axis(command: Record, robot: RobotDescription, folder: Path, console: Console) -> list[str]:
    excitations = _excitations(command)
    for angles in excitations.values():
        for angle in (angles.min(), angles.max()):
            check_aim(robot, *(angle if axis == command.axis else 0.0 for axis in AXES))
    total = sum(map(len, excitations.values())) * TICK_S
    done = 0.0
    with progress_bar("recording", total, "s") as advance:
        for seed, (name, angles) in zip(seeds_from(command.seed, 2), excitations.items(), strict=False):
            virtual = one_robot(robot, seed, command.physics, console)
            trace = _recorded(command, virtual, angles, partial(_advance_from, advance, done))
            write_axis_log(folder / name, trace, command.axis)
            done += len(angles) * TICK_S
    return list(excitations)


def _advance_from(advance: Callable[[float, str], None], before: float, played: float) -> None:
    advance(before + played, "")


def _axis_names(command: Record) -> list[str]:
    """Return the names of the logs of a sweep or of steps; the second, if there is one, is held back."""
    if command.commands is not None:
        return [f"{command.commands.stem.removesuffix('_command')}.csv"]
    name = f"{command.axis}_{command.kind}"
    return [f"{name}.csv", f"{name}_validation.csv"] if command.validation else [f"{name}.csv"]


def _excitations(command: Record) -> dict[str, Array]:
    """Return what to play, by the name of its log."""
    names = _axis_names(command)
    if command.commands is not None:
        return {names[0]: _read_commands(command.commands)}
    centre = float(np.radians(command.centre_deg))
    return {name: centre + _signal(command, held_back=number == 1) for number, name in enumerate(names)}


def _signal(command: Record, *, held_back: bool) -> Array:
    if command.kind == "step":
        return steps(float(np.radians(command.amplitude_deg or 2.0)), command.hold_s, held_back=held_back)
    amplitude, low, high = command.amplitude_deg or 1.0, command.low_hz or 2.0, command.high_hz or 50.0
    if low >= high:
        raise InputError(f"--low-hz must be below --high-hz, got {low:g} and {high:g}")
    if high > 0.5 / TICK_S:
        raise InputError(f"--high-hz must be at most {0.5 / TICK_S:g}, half the firmware's rate, got {high:g}")
    return sweep(float(np.radians(amplitude)), low, high, command.duration_s or 10.0, held_back=held_back)


def _read_commands(path: Path) -> Array:
    """Return the commands of a file, held at each tick [rad], shape (N,)."""
    table = read_csv_columns(path, ["time_s", "u"])
    time = table.columns["time_s"] - table.columns["time_s"][0]
    if np.any(np.diff(time) <= 0):
        line = table.lines[int(np.argmax(np.diff(time) <= 0)) + 1]
        raise file_error(path, f"line {line}: time does not increase", "remove the disordered lines", "time-backward")
    ticks = TICK_S * np.arange(round(time[-1] / TICK_S) + 1)
    index = np.searchsorted(time, ticks + 1e-9, side="right") - 1
    return np.asarray(table.columns["u"][index])


def _recorded(command: Record, robot: Any, angles: Array, advance: Callable[[float], None]) -> Trace:
    how: Play = command.play or ("link" if command.stamps == "host" else "inject")
    commands = np.zeros((len(angles), 2))
    commands[:, AXES.index(command.axis)] = angles
    robot.reset(commands[:1], Plate(3.0))
    session = play(robot, commands, how, advance)
    if command.stamps == "host":
        return host_trace(session, commands[0])
    return robot_trace(session, commands[0], as_sent=how == "inject")


def _timing(command: Record, robot: RobotDescription, folder: Path, console: Console) -> list[str]:
    base = timing_plan(robot)
    plan = TimingPlan(
        sweep_s=command.duration_s or base.sweep_s,
        amplitude=float(np.radians(command.amplitude_deg)) if command.amplitude_deg else base.amplitude,
        low_hz=command.low_hz or base.low_hz,
        high_hz=command.high_hz or base.high_hz,
        step=base.step,
        steps=command.count,
    )
    noise, draws = seeds_from(command.seed, 2)
    virtual = one_robot(robot, noise, command.physics, console)
    with progress_bar("recording", timing_length(plan), "s") as advance:
        logs = record_timing(virtual, plan, command.stamps, draws, lambda done: advance(done, ""))
    write_gimbal_log(folder / "timing_sweep.csv", logs.sweep)
    write_gimbal_log(folder / "timing_steps.csv", logs.steps)
    write_detections(folder / "timing_plate.csv", logs.plate)
    write_detections(folder / "timing_target.csv", logs.target)
    write_columns(folder / "timing_moments.csv", {"time_s": logs.moments})
    if command.stamps == "robot":
        for name, (sent, received) in (("commands", logs.commands), ("reports", logs.reports)):
            write_columns(folder / f"timing_{name}.csv", {"sent_s": sent, "received_s": received})
    return _timing_names(command)


def _timing_names(command: Record) -> list[str]:
    stamped = ("commands", "reports") if command.stamps == "robot" else ()
    return [f"timing_{name}.csv" for name in ("sweep", "steps", "plate", "target", "moments", *stamped)]

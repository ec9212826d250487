"""A rehearsal: a controller shoots with a virtual robot through the bytes of a wire, in virtual time.

Without MuJoCo, or where it is chosen, the robot is that of the records: see `virtual_robot.identified`.
"""

import importlib
import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError, checked_arguments
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.evaluation.plots import trajectory
from archerfish.messages import Numbers
from archerfish.provenance import code_commit
from archerfish.records.record import Record, Text
from archerfish.reports.progress import bar
from archerfish.reports.report import Report
from archerfish.reports.style import MUTED, Figure, look, new_figure, plot_style
from archerfish.reports.table import Estimate, Table, entry_texts
from archerfish.robot import Robot, RobotLike
from archerfish.runtime.configuration import DeployConfig
from archerfish.runtime.pilot import Pilot
from archerfish.safety.rules import narrowed_limits
from archerfish.studies.deploy import decider_of
from archerfish.task import Task, TaskLike
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Emulator, Fault, Pellet
from archerfish.virtual_robot.identified import IDENTIFIED, IdentifiedServo, described_by_records
from archerfish.virtual_robot.virtual_robot import VirtualRobot
from archerfish.wires import load_wire
from archerfish.wires.wire import TableWire

COUNTED_FROM_S = 1.5
"""Hits count from here on: the operator's switch goes on after 1 s [s]."""
_Count = Annotated[int, Meta(ge=0, le=1_000_000_000)]
_START_S = 1000.0  # of the computer's clock
_FEWEST = 10  # seconds' worth of pellets for an interval
_WIDEST_MM = 200.0  # of the plot of misses
_Pair = tuple[float, float]


class SwingingPlate(NamedTuple):
    """A plate that swings from side to side, in B trials alike."""

    distance_m: float = 3.0  # ahead
    amplitude_m: float = 0.4  # to either side
    frequency_hz: float = 0.25  # of the sine
    height_m: float = 0.1  # above the pivot

    def position(self, time: Numbers) -> Numbers:
        """Return its position in O [m] at times [s], shape (B,) → (B, 3)."""
        left = self.amplitude_m * np.sin(2.0 * np.pi * self.frequency_hz * np.asarray(time, float))
        return np.stack([self.distance_m + 0.0 * left, left, self.height_m + 0.0 * left], axis=-1)


class RehearsedShot(NamedTuple):
    """A pellet of a rehearsal, as it leaves; angles are pitch and yaw [rad]."""

    time_s: float  # since the start of the rehearsal
    is_hit: bool  # whether it hits
    command: _Pair  # in force
    angle: _Pair  # of the gimbal
    line_of_sight: _Pair  # from the pivot to the plate
    miss_m: _Pair | None  # where it passes the plate's centre, left and up; None if never


class Rehearsal(Record, frozen=True, kw_only=True):
    """What a rehearsal counted; printed as its report."""

    schema: ClassVar[str] = "archerfish.rehearsal/1"
    remedy: ClassVar[str] = "rehearse again"
    robot: Text
    """Whose records the computer had."""
    virtual: Text
    """Virtual robot that shot; "identified" is the robot of the records."""
    wire: Text
    """Through which."""
    controller: Text
    """Which aimed."""
    target: tuple[float, float, float, float]
    """Distance, amplitude [m], frequency [Hz] and height [m] of the plate."""
    period_s: float
    """Between decisions [s]."""
    seed: _Count
    """Of all noise."""
    commit: Text
    """Of the code."""
    hits: tuple[_Count, ...]
    """In each second."""
    fired: tuple[_Count, ...]
    """Pellets in each second."""
    messages: dict[str, _Count]
    """What became of them at the computer."""
    violations: dict[str, _Count]
    """Of the robot's limits, by the commands that it received."""
    fault: Text = ""
    """Of the controller, from which on the fallback decided; empty without."""
    faults: tuple[Fault, ...] = ()
    """That the robot had."""
    shots: tuple[RehearsedShot, ...] = ()
    """Each pellet that counts."""
    conditions: Text = "Virtual time: nothing was late, so nothing here is known of a computer's load."
    """Under which it ran, as a sentence."""

    @property
    def rate(self) -> HitRate:
        """Hits per decision; one without fire is a miss. A second counts as an engagement in the interval."""
        return hit_rate(self.hits, math.ceil(1.0 / self.period_s - 1e-9))

    @property
    def pellet_rate(self) -> Estimate:
        """Hits per pellet [%]. So many pellets in a row as a second has decisions are an engagement in the interval.

        With fewer than ten of these there is no interval.
        """
        hits, size = [shot.is_hit for shot in self.shots], math.ceil(1.0 / self.period_s - 1e-9)
        value = 100.0 * sum(hits) / len(hits) if hits else math.nan
        groups = np.reshape(hits[: len(hits) // size * size], (-1, size))
        if len(groups) < _FEWEST:
            return Estimate(value, math.nan, math.nan, "%")
        rate = hit_rate(groups.sum(axis=1), size)
        return Estimate(value, min(100.0 * rate.low, value), max(100.0 * rate.high, value), "%")

    @property
    def report(self) -> Report:
        """What was counted, in words."""
        rate, fired = self.rate, sum(self.fired)
        percent, interval = entry_texts(self.pellet_rate)
        uncertain = f"95 %: {interval}" if interval else "too few for an interval, which 500 pellets have"
        distance, amplitude, frequency, _ = self.target
        kept = sum(self.violations.values()) == 0
        has_records_alone = self.virtual == IDENTIFIED
        robot = "the robot of its records" if has_records_alone else f"the virtual robot {self.virtual}"
        failed = f"{self.controller} failed, and the fallback decided where there is one: {self.fault}."
        doubts = [failed] if self.fault else []
        if has_records_alone:
            doubts.append("The robot was simulated from the records, which don't have friction, saturation or recoil.")
        faults = [f"Fault: {kind} from {begin:g} to {end:g} s." for kind, begin, end in self.faults]
        figures: list[tuple[str, Callable[[], Figure]]] = [("Pellets and hits", partial(_seconds, self))]
        if self.shots:
            figures.append(("Line of sight, command and gimbal at each shot", partial(_trajectory, self)))
            figures.append(("Where the pellets passed the plate's centre", partial(_misses, self)))
        return Report(
            title=f"Rehearsal of {self.controller} with {robot} through {self.wire}",
            headline=f"{rate.hits} of {fired} pellets hit, {percent} % ({uncertain})." if fired else "No pellet left.",
            usable=None if kept else False,
            doubts=tuple(doubts),
            reasons=() if kept else (f"the robot's limits were violated: {self.violations}",),
            known=(
                f"{rate.hits} of {rate.decisions} decisions hit, {100.0 * rate.rate:.1f} %; one without fire misses.",
                f"Plate {distance:g} m ahead that swings by {amplitude:g} m at {frequency:g} Hz.",
                *faults,
                f"Records of {self.robot}, a decision every {1e3 * self.period_s:g} ms.",
                f"Seed {self.seed}, commit {self.commit}.",
                self.conditions,
            ),
            tables=(Table("Messages at the computer", ("", "count"), tuple(self.messages.items())),),
            figures=tuple(figures),
            provenance={"seed": self.seed, "commit": self.commit},
        )

    def __str__(self) -> str:
        return f"{self.report}"

    __repr__ = __str__


def _seconds(rehearsal: Rehearsal) -> Figure:
    with plot_style():
        figure, axes = new_figure(height=2.4)
        panel, second = axes[0, 0], np.arange(len(rehearsal.hits)) + COUNTED_FROM_S
        panel.bar(second, rehearsal.fired, 0.9, align="edge", color=MUTED, alpha=0.4, label="pellets")
        panel.bar(second, rehearsal.hits, 0.9, align="edge", label="hits")
        panel.set(xlabel="time [s]", ylabel="in each second [1/s]")
        figure.legend(loc="outside upper center", ncols=2)
    return figure


def _trajectory(rehearsal: Rehearsal) -> Figure:
    shots = rehearsal.shots
    return trajectory(
        np.array([shot.time_s for shot in shots]),
        np.degrees([shot.line_of_sight for shot in shots]),
        np.degrees([shot.command for shot in shots]),
        np.degrees([shot.angle for shot in shots]),
        np.array([shot.miss_m or (math.nan, math.nan) for shot in shots]),
        np.array([shot.is_hit for shot in shots]),
    )


def _misses(rehearsal: Rehearsal) -> Figure:
    with plot_style():
        figure, axes = new_figure(width=4.5, height=4.2)
        panel = axes[0, 0]
        for place, (label, is_hit) in enumerate({"hit": True, "miss": False}.items()):
            chosen = [shot.miss_m for shot in rehearsal.shots if shot.is_hit == is_hit and shot.miss_m]
            left, up = 1e3 * np.reshape(chosen, (-1, 2)).T
            panel.plot(left, up, **{**look(place), "linestyle": "", "markersize": 3.0}, label=label)
        panel.set(xlabel="to the left [mm]", ylabel="up [mm]", aspect="equal", xlim=(_WIDEST_MM, -_WIDEST_MM))
        panel.set_ylim(-_WIDEST_MM, _WIDEST_MM)
        panel.legend(ncols=2)
    return figure


@checked_arguments
def rehearse(
    controller: ControllerLike = "kalman",
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    virtual: VirtualRobot | str | Path = "",
    wire: str | Path | Sequence[str | Path] = "sp_vision_25",
    config: DeployConfig | None = None,
    seconds: int = 20,
    seed: int = 0,
    target: SwingingPlate | None = None,
    tuning: TuningLike = "kept",
    in_c: bool = False,
    faults: Sequence[Fault] = (),
) -> Rehearsal:
    """Let a controller shoot with a virtual robot as on a robot: bytes in, bytes out, in virtual time.

    Args:
      controller: as `export` takes it.
      robot: its records, with those of its sensing: a robot or its folder.
      task: decision period and command limit; a policy has those of its own.
      virtual: the virtual robot, its name or its file, or "identified" for the plants of the records; the infantry if
        not given, or without MuJoCo that of the records.
      wire: by name or TOML file, or several; one without an operator's switch is armed by this.
      config: camera, fallback and gate, as of deploy.toml.
      seconds: that count, at least 2.
      seed: of the robot's noise and of the dispersion.
      target: the plate; one that swings by 0.4 m at 3 m, 0.25 Hz, if not given.
      tuning: as `export` takes it.
      in_c: whether it decides in C, as `deploy` does, where a compiler is at hand.
      faults: what goes wrong with the robot; times count from the start.

    Raises:
      InputError: if an argument can't be used, or the records lack the latency of the camera.
    """
    if seconds < 2:
        raise InputError(f"seconds must be at least 2, got {seconds}; choose more")
    virtual, robot, target = found_robot(virtual), Robot.of(robot), target or SwingingPlate()
    if robot.sensing is None:
        remedy = "name the folder of a robot whose logs of timing were identified: archerfish rehearse my-robot"
        raise InputError(f"{robot.name} has no record of its camera and link, which a rehearsal needs; {remedy}")
    wires, config = [wire] if isinstance(wire, str | Path) else [*wire], config or DeployConfig()
    latency_s, own_wire = config.detections.latency_s(robot), load_wire(*wires)  # before minutes of a search
    name, decider, task = decider_of(controller, robot, Task.of(task), config, tuning, in_c=in_c, is_timed=False)
    camera_m = config.detections.position_m
    narrowed = robot.replace(limits=narrowed_limits(robot.limits, config.gate))
    pilot = Pilot(decider, narrowed, task, own_wire, camera_m=camera_m, latency_s=latency_s)
    emulator = emulated_robot(virtual, robot, task, wires, target, camera_m=camera_m, seed=seed, faults=faults)
    with bar("rehearsing", seconds, "seconds") as advance:
        while emulator.time < COUNTED_FROM_S + seconds:
            in_lockstep(pilot, emulator, task.period_s)
            advance(max(0.0, emulator.time - COUNTED_FROM_S))
    return Rehearsal(
        robot=robot.name,
        virtual=robot_name(virtual),
        wire="+".join(Path(name).stem for name in wires),
        controller=name,
        target=(*target,),
        period_s=task.period_s,
        seed=seed,
        messages=dict(pilot.counts),
        violations=dict(+emulator.monitor.violations),
        fault=decider.fault,
        faults=tuple(faults),
        **counted(emulator.pellets, seconds),
    )


def counted(pellets: Iterable[Pellet], seconds: int) -> dict[str, Any]:
    """Return what a `Rehearsal` has of the pellets that count.

    Args:
      pellets: with their times since the switch could go on, less a second.
      seconds: that count.
    """
    # A pellet leaves a period after its decision, so that those of a second are in (begin, end].
    begin_s = COUNTED_FROM_S + 0.5 * TICK_S
    shots = [_rehearsed(pellet) for pellet in pellets if begin_s < pellet.time_s < begin_s + seconds]
    second = np.array([math.ceil(shot.time_s - begin_s) - 1 for shot in shots], int)
    is_hit = np.array([shot.is_hit for shot in shots], bool)
    hits, fired = (np.bincount(chosen, minlength=seconds).tolist() for chosen in (second[is_hit], second))
    return {"hits": tuple(hits), "fired": tuple(fired), "shots": tuple(shots), "commit": code_commit()}


def _rehearsed(pellet: Pellet) -> RehearsedShot:
    x, y, z = pellet.plate.tolist()
    line_of_sight = math.atan2(z, math.hypot(x, y)), math.atan2(y, x)
    rounded = [np.round(pair, 5).tolist() for pair in (pellet.command, pellet.angle, line_of_sight, pellet.miss)]
    command, angle, line_of_sight, miss = [(first, second) for first, second in rounded]
    return RehearsedShot(
        pellet.time_s, pellet.is_hit, command, angle, line_of_sight, None if np.isnan(miss).any() else miss
    )


def found_robot(virtual: VirtualRobot | str | Path) -> VirtualRobot | str:
    """Return a virtual robot, or the name of that of the records, which is there without MuJoCo."""
    if not virtual:
        try:
            importlib.import_module("mujoco")  # of the extra `train`
        except ImportError:
            return IDENTIFIED
    if isinstance(virtual, VirtualRobot) or virtual == IDENTIFIED:
        return virtual
    return VirtualRobot.load(virtual or "infantry")


def robot_name(virtual: VirtualRobot | str) -> str:
    """Return the name of what `found_robot` returns."""
    return virtual if isinstance(virtual, str) else virtual.name


def emulated_robot(
    virtual: VirtualRobot | str | Path,
    robot: Robot,
    task: Task,
    wires: Sequence[str | Path],
    target: SwingingPlate,
    *,
    camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
    faults: Sequence[Fault] = (),
    watchdog_s: float = 0.0,
    switch_on_s: Sequence[tuple[float, float]] = ((1.0, math.inf),),
) -> Emulator:
    """Return the other end of a wire.

    Args:
      virtual: as `rehearse` takes it.
      robot: whose limits the commands have to keep.
      task: decision period.
      wires: names or TOML files.
      target: what moves before it.
      camera_m: place of the camera of a robot of records: forward, left and up from the pivot [m].
      seed: of all noise and of the faults.
      faults: what goes wrong.
      watchdog_s: for so long the microcontroller goes on firing without a command [s].
      switch_on_s: begin and end of each time during which the operator's switch is on [s].

    Raises:
      InputError: if the wire is a team's own, whose other end nobody has written, or there is no such robot.
    """
    wire = load_wire(*wires)
    if not isinstance(wire, TableWire):
        raise InputError(f"wire {wires[0]}: expected tables, whose other end can be emulated; name a TOML file")
    virtual, servo = found_robot(virtual), None
    if isinstance(virtual, VirtualRobot):
        description = virtual.description
    else:
        description = described_by_records(robot, task.hit_radius_m, camera_m)
        servo = IdentifiedServo(robot, np.array([seed]))
    limits, period_s = robot.limits, task.period_s
    options: Any = {"seed": seed, "faults": faults, "watchdog_s": watchdog_s, "switch_on_s": switch_on_s}
    options |= {"servo": servo}
    return Emulator(description, limits, wire, target, period_s, **options)


def in_lockstep(pilot: Pilot, emulator: Emulator, period_s: float) -> None:
    """Let a period pass, hand over all that arrives in it when it does, and let the computer decide."""
    for delivery in emulator.advance(round(period_s / TICK_S)):
        take = pilot.on_datagram if delivery.is_datagram else pilot.on_bytes
        take(_START_S + delivery.time_s, delivery.data)
    if not emulator.has_switch:
        pilot.switch = emulator.is_switch_on
    emulator.on_bytes(pilot.tick(_START_S + emulator.time))

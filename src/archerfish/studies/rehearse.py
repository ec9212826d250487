"""A rehearsal: a controller shoots with a virtual robot through the bytes of a wire, in virtual time."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError, checked_arguments
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.messages import Numbers
from archerfish.provenance import code_commit
from archerfish.records.record import Record, Text
from archerfish.reports.progress import bar
from archerfish.reports.report import Report
from archerfish.reports.table import Estimate, Table, entry_texts
from archerfish.robot import Robot, RobotLike
from archerfish.runtime.configuration import DeployConfig
from archerfish.runtime.pilot import Pilot
from archerfish.studies.deploy import decider_of
from archerfish.task import Task, TaskLike
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Emulator, Fault
from archerfish.virtual_robot.virtual_robot import VirtualRobot
from archerfish.wires import load_wire
from archerfish.wires.wire import TableWire

COUNTED_FROM_S = 1.5
"""Hits count from here on: the operator's switch goes on after 1 s [s]."""
_Count = Annotated[int, Meta(ge=0, le=1_000_000_000)]
_START_S = 1000.0  # of the computer's clock


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


class Rehearsal(Record, frozen=True, kw_only=True):
    """What a rehearsal counted; printed as its report."""

    schema: ClassVar[str] = "archerfish.rehearsal/1"
    remedy: ClassVar[str] = "rehearse again"
    robot: Text
    """Whose records the computer had."""
    virtual: Text
    """Virtual robot that shot."""
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
    """Of the controller, which a fallback has replaced since; empty without."""

    @property
    def rate(self) -> HitRate:
        """Hits per decision; one without fire is a miss. A second counts as an engagement in the interval."""
        return hit_rate(self.hits, math.ceil(1.0 / self.period_s - 1e-9))

    @property
    def report(self) -> Report:
        """What was counted, in words."""
        rate, fired = self.rate, sum(self.fired)
        estimate = Estimate(100.0 * rate.rate, 100.0 * rate.low, 100.0 * rate.high, "%")
        percent, interval = entry_texts(estimate)
        distance, amplitude, frequency, _ = self.target
        kept = sum(self.violations.values()) == 0
        return Report(
            title=f"Rehearsal of {self.controller} with the virtual robot {self.virtual} through {self.wire}",
            headline=f"{rate.hits} of {rate.decisions} decisions hit, {percent} % (95 %: {interval}).",
            usable=None if kept else False,
            doubts=(f"{self.controller} was replaced by the fallback: {self.fault}.",) if self.fault else (),
            reasons=() if kept else (f"the robot's limits were violated: {self.violations}",),
            known=(
                f"Plate {distance:g} m ahead that swings by {amplitude:g} m at {frequency:g} Hz; {fired} pellets.",
                f"Records of {self.robot}, a decision every {1e3 * self.period_s:g} ms.",
                f"Seed {self.seed}, commit {self.commit}.",
                "Virtual time: nothing was late, so nothing here is known of a computer's load.",
            ),
            tables=(Table("Messages at the computer", ("", "count"), tuple(self.messages.items())),),
            provenance={"seed": self.seed, "commit": self.commit},
        )

    def __str__(self) -> str:
        return f"{self.report}"

    __repr__ = __str__


@checked_arguments
def rehearse(
    controller: ControllerLike = "kalman",
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    virtual: VirtualRobot | str | Path = "infantry",
    wire: str | Path | Sequence[str | Path] = "sp_vision_25",
    config: DeployConfig | None = None,
    seconds: int = 20,
    seed: int = 0,
    target: SwingingPlate | None = None,
    tuning: TuningLike = "kept",
    in_c: bool = False,
) -> Rehearsal:
    """Let a controller shoot with a virtual robot as on a robot: bytes in, bytes out, in virtual time.

    Args:
      controller: as `export` takes it.
      robot: its records, with those of its sensing: a robot or its folder.
      task: decision period and command limit; a policy has those of its own.
      virtual: the virtual robot, its name or its file.
      wire: by name or TOML file, or several; one without an operator's switch is armed by this.
      config: camera, fallback and gate, as of deploy.toml.
      seconds: that count, at least 2.
      seed: of the robot's noise and of the dispersion.
      target: the plate; one that swings by 0.4 m at 3 m, 0.25 Hz, if not given.
      tuning: as `export` takes it.
      in_c: whether it decides in C, as `deploy` does, where a compiler is at hand.

    Raises:
      InputError: if an argument can't be used, or the records lack the latency of the camera.
    """
    if seconds < 2:
        raise InputError(f"seconds must be at least 2, got {seconds}; choose more")
    virtual = virtual if isinstance(virtual, VirtualRobot) else VirtualRobot.load(virtual)
    robot, target, config = Robot.of(robot), target or SwingingPlate(), config or DeployConfig()
    wires = [wire] if isinstance(wire, str | Path) else [*wire]
    latency_s, own_wire = config.detections.latency_s(robot), load_wire(*wires)  # before minutes of a search
    name, decider, task = decider_of(controller, robot, Task.of(task), config, tuning, in_c=in_c, is_timed=False)
    pilot = Pilot(decider, robot, task, own_wire, camera_m=config.detections.position_m, latency_s=latency_s)
    emulator = emulated_robot(virtual, robot, task, wires, target, seed=seed)
    with bar("rehearsing", seconds, "seconds") as advance:
        while emulator.time < COUNTED_FROM_S + seconds:
            in_lockstep(pilot, emulator, task.period_s)
            advance(max(0.0, emulator.time - COUNTED_FROM_S))
    times, hit = np.array([time for time, _ in emulator.hits]), np.array([hit for _, hit in emulator.hits], bool)
    # A pellet leaves a period after its decision, so that those of a second are in (begin, end].
    second = np.ceil(times - COUNTED_FROM_S - 0.5 * TICK_S).astype(int) - 1
    counted = (second >= 0) & (second < seconds)
    return Rehearsal(
        robot=robot.name,
        virtual=virtual.name,
        wire="+".join(Path(each).stem for each in wires),
        controller=name,
        target=(*target,),
        period_s=task.period_s,
        seed=seed,
        commit=code_commit(),
        hits=tuple(np.bincount(second[counted & hit], minlength=seconds).tolist()),
        fired=tuple(np.bincount(second[counted], minlength=seconds).tolist()),
        messages=dict(pilot.counts),
        violations=dict(+emulator.monitor.violations),
        fault=getattr(decider, "fault", ""),
    )


def emulated_robot(
    virtual: VirtualRobot | str | Path,
    robot: Robot,
    task: Task,
    wires: Sequence[str | Path],
    target: SwingingPlate,
    *,
    seed: int = 0,
    faults: Sequence[Fault] = (),
    watchdog_s: float = 0.0,
) -> Emulator:
    """Return the other end of a wire.

    Args:
      virtual: the virtual robot, its name or its file.
      robot: whose limits the commands have to keep.
      task: decision period.
      wires: names or TOML files.
      target: what moves before it.
      seed: of all noise and of the faults.
      faults: what goes wrong.
      watchdog_s: for so long the microcontroller goes on firing without a command [s].

    Raises:
      InputError: if the wire is a team's own, whose other end nobody has written.
    """
    wire = load_wire(*wires)
    if not isinstance(wire, TableWire):
        raise InputError(f"wire {wires[0]}: expected tables, whose other end can be emulated; name a TOML file")
    virtual = virtual if isinstance(virtual, VirtualRobot) else VirtualRobot.load(virtual)
    limits, period_s = robot.limits, task.period_s
    options: Any = {"seed": seed, "faults": faults, "watchdog_s": watchdog_s}
    return Emulator(virtual.description, limits, wire, target, period_s, **options)


def in_lockstep(pilot: Pilot, emulator: Emulator, period_s: float) -> None:
    """Let a period pass, hand over all that arrives in it when it does, and let the computer decide."""
    for delivery in emulator.advance(round(period_s / TICK_S)):
        take = pilot.on_datagram if delivery.is_datagram else pilot.on_bytes
        take(_START_S + delivery.time_s, delivery.data)
    if not emulator.has_switch:
        pilot.switch = emulator.is_switch_on
    emulator.on_bytes(pilot.tick(_START_S + emulator.time))

"""A rehearsal: a controller shoots with a virtual robot through the bytes of a wire, in virtual time.

Without MuJoCo, or where it is chosen, the robot is that of the records: see `virtual_robot.identified`.
"""

import importlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError, checked_arguments
from archerfish.messages import Numbers
from archerfish.reports.progress import bar
from archerfish.robot import Robot, RobotLike
from archerfish.runtime.configuration import DeployConfig, setting
from archerfish.runtime.pilot import Pilot
from archerfish.safety.rules import narrowed_limits
from archerfish.studies.deploy import decider_of
from archerfish.studies.rehearsal import COUNTED_FROM_S, Rehearsal, rehearsal_of
from archerfish.task import Task, TaskLike
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Emulator, Fault
from archerfish.virtual_robot.identified import IDENTIFIED, IdentifiedServo, described_by_records
from archerfish.virtual_robot.virtual_robot import VirtualRobot
from archerfish.wires import load_wire
from archerfish.wires.wire import TableWire

_START_S = 1000.0  # of the computer's clock
_SWITCH_ON_S = 1.0  # when the operator's switch goes on first
_OFF_AFTER_S, _OFF_S = 0.5, 1.0  # from the end of a fault until the operator switches off, and for how long


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
    switch_on_s: Sequence[tuple[float, float]] | None = None,
) -> Rehearsal:
    """Let a controller shoot with a virtual robot as on a robot: bytes in, bytes out, in virtual time.

    Args:
      controller: as `export` takes it.
      robot: its records, with those of its sensing: a robot or its folder.
      task: decision period and command limit; a policy has those of its own.
      virtual: the virtual robot, its name or its file, or "identified" for the plants of the records; the infantry if
        not given, or without MuJoCo that of the records.
      wire: by name or TOML file, or several; one without an operator's switch is armed by this.
      config: camera, fallback and gate, as of deploy.toml. The virtual robot has its camera at `position_m`, too.
      seconds: that count, at least 2.
      seed: of the robot's noise and of the dispersion.
      target: the plate; one that swings by 0.4 m at 3 m, 0.25 Hz, if not given.
      tuning: as `export` takes it.
      in_c: whether it decides in C, as `deploy` does, where a compiler is at hand.
      faults: what goes wrong with the robot; times count from the start.
      switch_on_s: when the operator's switch is on, as `emulated_robot` takes it.

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
    emulator = emulated_robot(
        virtual, robot, task, wires, target, camera_m=camera_m, seed=seed, faults=faults, switch_on_s=switch_on_s
    )
    with bar("rehearsing", seconds, "seconds") as advance:
        while emulator.time < COUNTED_FROM_S + seconds:
            in_lockstep(pilot, emulator, task.period_s)
            advance(max(0.0, emulator.time - COUNTED_FROM_S))
    return rehearsal_of(
        emulator.pellets,
        seconds=seconds,
        robot=robot,
        virtual=robot_name(virtual),
        wires=wires,
        config=config,
        controller=name,
        target=(*target,),
        period_s=task.period_s,
        hit_radius_m=task.hit_radius_m,
        seed=seed,
        messages=dict(pilot.counts),
        violations=dict(+emulator.monitor.violations),
        fault=decider.fault,
        faults=tuple(faults),
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


def switch_times(faults: Sequence[Fault]) -> list[tuple[float, float]]:
    """Return begin and end of each time during which the operator's switch is on [s].

    A fault may need the switch off and on before the robot shoots again. So the operator switches off 0.5 s after each
    fault for 1 s; of faults that overlap only after the last one.
    """
    ends = [fault.end_s for fault in faults if not any(other.begin_s <= fault.end_s < other.end_s for other in faults)]
    begins_off = sorted(end + _OFF_AFTER_S for end in {*ends})
    begins_on = [_SWITCH_ON_S, *(begin_off + _OFF_S for begin_off in begins_off)]
    times = zip(begins_on, [*begins_off, math.inf], strict=True)
    return [(begin, end) for begin, end in times if begin < end]


def emulated_robot(
    virtual: VirtualRobot | str | Path,
    robot: Robot,
    task: Task,
    wires: Sequence[str | Path],
    target: SwingingPlate,
    *,
    camera_m: tuple[float, float, float] | None = None,
    seed: int = 0,
    faults: Sequence[Fault] = (),
    watchdog_s: float = 0.0,
    switch_on_s: Sequence[tuple[float, float]] | None = None,
) -> Emulator:
    """Return the other end of a wire.

    Args:
      virtual: as `rehearse` takes it.
      robot: whose limits the commands have to keep.
      task: decision period, and radius of a hit.
      wires: names or TOML files.
      target: what moves before it.
      camera_m: place of the camera: forward, left and up from the pivot [m]; that of the virtual robot's description
        if not given, and the pivot for a robot of records. The place that the computer has makes both agree.
      seed: of all noise and of the faults.
      faults: what goes wrong.
      watchdog_s: for so long the microcontroller goes on firing without a command [s].
      switch_on_s: begin and end of each time during which the operator's switch is on [s]; from 1 s on if not given,
        and off for a while after each fault, see `switch_times`.

    Raises:
      InputError: if the wire is a team's own, whose other end nobody has written, or has no room for the limits, or
        there is no such robot.
    """
    wire = load_wire(*wires)
    if not isinstance(wire, TableWire):
        raise InputError(f"wire {wires[0]}: expected tables, whose other end can be emulated; name a TOML file")
    virtual, servo = found_robot(virtual), None
    if isinstance(virtual, VirtualRobot):
        description = virtual.description
    else:
        description = described_by_records(robot, task.hit_radius_m, (0.0, 0.0, 0.0))
        servo = IdentifiedServo(robot, np.array([seed]))
    camera, referee = description.camera, description.referee.replace(hit_radius_m=task.hit_radius_m)
    if camera_m is not None:
        forward, left, up = camera_m
        with setting("detections.position_m"):
            camera = camera.replace(forward_m=forward, left_m=left, up_m=up)
    description = description.replace(camera=camera, referee=referee)
    return Emulator(
        description,
        robot.limits,
        wire,
        target,
        task.period_s,
        seed=seed,
        switch_on_s=switch_times(faults) if switch_on_s is None else switch_on_s,
        faults=faults,
        watchdog_s=watchdog_s,
        servo=servo,
    )


def in_lockstep(pilot: Pilot, emulator: Emulator, period_s: float) -> None:
    """Let a period pass, hand over all that arrives in it when it does, and let the computer decide."""
    for delivery in emulator.advance(round(period_s / TICK_S)):
        take = pilot.on_datagram if delivery.is_datagram else pilot.on_bytes
        take(_START_S + delivery.time_s, delivery.data)
    if not emulator.has_switch:
        pilot.switch = emulator.is_switch_on
    emulator.on_bytes(pilot.tick(_START_S + emulator.time))

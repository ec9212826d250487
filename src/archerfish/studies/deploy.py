"""A controller on the robot's computer: the wire's port, the camera's datagrams, and deadlines, until it is stopped."""

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from archerfish.codegen.library import find_compiler
from archerfish.controllers.registry import ControllerLike
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError
from archerfish.reports.report import Report, Reported
from archerfish.reports.table import Table
from archerfish.robot import Robot
from archerfish.runtime.configuration import FILE, DeployConfig, setting
from archerfish.runtime.deciders import Decider, WithFallback, make_decider
from archerfish.runtime.loop import RobotLoop, Timing
from archerfish.runtime.pilot import Pilot
from archerfish.safety.rules import narrowed_limits
from archerfish.studies.export import for_robot
from archerfish.task import Task
from archerfish.wires import Wire, load_wire
from archerfish.wires.transports import DatagramPort, SerialPort
from archerfish.wires.wire import TableWire

_LONGEST = 0.5  # share of a period that a decision may take
_PATIENCE_S = 1.0  # from a signal to stop until another one interrupts a decision
_SPEED = 0.02  # share by which a muzzle speed may differ from that of the records


@dataclass(frozen=True, repr=False)
class Deployment(Reported):
    """What ran on the robot's computer, and how it went; printed as its report."""

    robot: str  # name
    controller: str  # name
    port: str  # name
    timing: Timing  # of its decisions
    counts: dict[str, int]  # messages and decisions by what became of them
    fault: str  # of the controller, from which on the fallback decided; empty without
    muzzle_speeds: tuple[float, float]  # measured last, or NaN, and that of the records [m/s]
    language: str  # in which it decided: C, NumPy, or both

    @property
    def report(self) -> Report:
        """How it went."""
        decisions, missed = len(self.timing.work), self.timing.missed
        doubts = []
        if not self.timing.is_realtime:
            doubts.append(
                "The system gave no priority (SCHED_FIFO) and no locked memory: other programs delay decisions."
            )
        if self.language != "C":
            remedy = "docs/export.md says which controllers can be in C" if find_compiler() else "install a C compiler"
            doubts.append(f"A decision in NumPy takes many times as long as in C; {remedy}.")
        if self.timing.lost:
            doubts.append(f"{self.port} went away {self.timing.lost} times.")
        if self.timing.let_go:
            doubts.append(f"No decision ended for more than 0.1 s, {self.timing.let_go} times: the gimbal was let go.")
        if self.timing.stalls:
            doubts.append(f"The computer stood still {self.timing.stalls} times for more than 50 ms.")
        if self.fault:
            doubts.append(f"{self.controller} failed, and the fallback decided where there is one: {self.fault}.")
        measured, expected = self.muzzle_speeds
        if measured > 0.0 and abs(measured / expected - 1.0) > _SPEED:  # false where it is not measured
            doubts.append(
                f"Pellets left at {measured:.1f} m/s, the records have {expected:.1f}: identify the muzzle again."
            )
        return Report(
            title=f"{self.controller} on {self.robot} through {self.port}",
            headline=f"{decisions} decisions in {self.language}, {missed} deadlines missed",
            doubts=tuple(doubts),
            tables=(
                self.timing.table(),
                Table("What became of messages and decisions", ("", "count"), (*self.counts.items(),)),
            ),
        )


def deploy(
    controller: ControllerLike,
    robot: Robot,
    task: Task,
    config: DeployConfig,
    *,
    port: str = "",
    seconds: float = float("inf"),
    tuning: TuningLike = "kept",
    in_c: bool = True,
    watch: Callable[[Pilot], bool] = lambda _: False,
) -> Deployment:
    """Run a controller on the robot until it is stopped.

    Ctrl-C and SIGTERM end it; whatever ends it, the last frame ends the fire.

    Args:
      controller: as `export` takes it; that of the configuration, if it is an empty name.
      robot: its records.
      task: decision period and limits; a policy has those of its training.
      config: of deploy.toml.
      port: that of the configuration if it is empty.
      seconds: after which it ends by itself [s].
      tuning: as `export` takes it.
      in_c: whether it decides in C, where a compiler is at hand and the controller's formulas can be traced.
      watch: called before each decision; ends it where it returns true.

    Raises:
      InputError: if a port can't be opened, or controller, wire or records can't be used.
    """
    # What is wrong in a line is said before minutes of a search.
    latency_s = config.detections.latency_s(robot)
    with setting("wires"):
        wire = load_wire(*config.wires)
        if isinstance(wire, TableWire):
            wire.check_complete()
    _check_yaw(robot, wire, config)
    with setting("gate"):
        narrowed = robot.replace(limits=narrowed_limits(robot.limits, config.gate))
    with setting("port", not port):
        port = port or config.port
        if not port:
            raise InputError("expected that of the robot, such as /dev/ttyACM0, got none; write it, or give --port")
        SerialPort(port, config.baud).close()
    controller = config.controller.mode or "kalman" if controller == "" else controller
    name, decider, task = decider_of(controller, robot, task, config, tuning, in_c=in_c)
    pilot = Pilot(decider, narrowed, task, wire, camera_m=config.detections.position_m, latency_s=latency_s)
    with setting("detections.address"):
        datagrams = DatagramPort(config.detections.address)
    try:
        with stop_flag() as is_stopped:
            loop = RobotLoop(pilot, partial(SerialPort, port, config.baud), datagrams, task.period_s)
            timing = loop.run(lambda: is_stopped() or watch(pilot), seconds)
    finally:
        datagrams.close()
    speeds = float(pilot.muzzle_speed), float(np.asarray(robot.muzzle_model().speed))
    return Deployment(robot.name, name, port, timing, dict(pilot.counts), decider.fault, speeds, decider.language)


def decider_of(
    controller: ControllerLike,
    robot: Robot,
    task: Task,
    config: DeployConfig,
    tuning: TuningLike,
    *,
    in_c: bool,
    is_timed: bool = True,
) -> tuple[str, Decider, Task]:
    """Return the name of a controller, the controller behind the gate with its fallback, and the task.

    Args:
      controller: as `export` takes it.
      robot: its records.
      task: decision period and limits; a policy has those of its training.
      config: has fallback and gate.
      tuning: as `export` takes it.
      in_c: whether they decide in C, where that is possible.
      is_timed: whether a controller that is late is replaced by the fallback.

    Raises:
      InputError: as of `for_robot` and `make_decider`.
    """
    with setting("controller.mode", controller == config.controller.mode):
        name, made, task = for_robot(controller, robot, task, tuning)
    if task.command_limit == "box":
        raise InputError("command limit box: it has no rate and no acceleration, which a robot needs; take gate")
    first = make_decider(name, made, robot, task, config.gate, in_c=in_c)
    other = config.controller.fallback
    if other in ("", name):
        return name, first, task
    with setting("controller.fallback"):
        _, made, own_task = for_robot(other, robot, task, tuning)
        if own_task.period_s != task.period_s:
            periods = f"{1e3 * own_task.period_s:g} ms, {name} every {1e3 * task.period_s:g} ms"
            raise InputError(f"it decides every {periods}; name another one")
    fallback = make_decider(other, made, robot, task, config.gate, in_c=in_c)
    return name, WithFallback(first, fallback, _LONGEST * task.period_s if is_timed else math.inf), task


def _check_yaw(robot: Robot, wire: Wire, config: DeployConfig) -> None:
    """Refuse a range of the yaw, which is from the chassis, where nobody says how far the chassis has turned."""
    limits = config.gate.yaw or robot.limits.yaw
    if limits.low is None or getattr(wire, "has_base_yaw", False) or config.yaw_reference:
        return
    low, high = np.degrees(limits.ends)
    problem = f"the yaw's range, {low:.0f}° to {high:.0f}°, is from the chassis, and the wire has no yaw_encoder"
    encoder, fixed = (f'yaw_reference = "{reference}"' for reference in ("encoder", "fixed-chassis"))
    remedy = f"add {encoder} if its yaw is the encoder's, or {fixed} if the chassis stands still"
    raise InputError(f"{FILE}: {problem}; {remedy}")


@contextmanager
def stop_flag() -> Iterator[Callable[[], bool]]:
    """Have signals to stop set a flag while a block runs, so that no decision is cut in two.

    One that comes a second after the first interrupts it all the same: a decision may never end.
    """
    received = list[float]()

    def stop(_: int, __: Any) -> None:
        received.append(time.monotonic())
        if received[-1] - received[0] > _PATIENCE_S:
            raise KeyboardInterrupt

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

"""A controller on the robot's computer: the wire's port, the camera's datagrams, and deadlines, until it is stopped."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from archerfish.codegen.export import for_robot
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError
from archerfish.reports.report import Report, Reported
from archerfish.reports.table import Table
from archerfish.robot import Robot
from archerfish.runtime.configuration import FILE, DeployConfig, setting
from archerfish.runtime.fallback import WithFallback
from archerfish.runtime.loop import RobotLoop, Timing
from archerfish.runtime.pilot import Pilot
from archerfish.safety.rules import narrowed_limits
from archerfish.task import Task
from archerfish.wires import Wire, load_wire
from archerfish.wires.transports import DatagramPort, SerialPort
from archerfish.wires.wire import TableWire

_LONGEST = 0.5  # share of a period that a decision may take
_SPEED = 0.02  # share by which a muzzle speed may differ from that of the records


@dataclass(frozen=True, repr=False)
class Deployment(Reported):
    """What ran on the robot's computer, and how it went; printed as its report."""

    robot: str  # name
    controller: str  # name
    port: str  # name
    timing: Timing  # of its decisions
    counts: dict[str, int]  # messages and decisions by what became of them
    fault: str  # of the controller, which the fallback has replaced since; empty without
    muzzle_speeds: tuple[float, float]  # measured last, or NaN, and that of the records [m/s]

    @property
    def report(self) -> Report:
        """How it went."""
        decisions, missed = len(self.timing.work), self.timing.missed
        doubts = []
        if not self.timing.is_realtime:
            doubts.append(
                "The system gave no priority (SCHED_FIFO) and no locked memory: other programs delay decisions."
            )
        if self.timing.lost:
            doubts.append(f"{self.port} went away {self.timing.lost} times.")
        if self.timing.stalls:
            doubts.append(f"The computer stood still {self.timing.stalls} times for more than 50 ms.")
        if self.fault:
            doubts.append(f"{self.controller} was replaced by the fallback: {self.fault}.")
        measured, expected = self.muzzle_speeds
        if measured > 0.0 and abs(measured / expected - 1.0) > _SPEED:  # false where it is not measured
            doubts.append(
                f"Pellets left at {measured:.1f} m/s, the records have {expected:.1f}: identify the muzzle again."
            )
        return Report(
            title=f"{self.controller} on {self.robot} through {self.port}",
            headline=f"{decisions} decisions, {missed} deadlines missed",
            doubts=tuple(doubts),
            tables=(
                self.timing.table(),
                Table("What became of messages and decisions", ("", "count"), (*self.counts.items(),)),
            ),
        )


def deploy(
    controller: str,
    robot: Robot,
    task: Task,
    config: DeployConfig,
    *,
    port: str = "",
    seconds: float = float("inf"),
    tuning: TuningLike = "kept",
    watch: Callable[[Pilot], bool] = lambda _: False,
) -> Deployment:
    """Run a controller on the robot until it is stopped.

    Ctrl-C and SIGTERM end it; whatever ends it, the last frame ends the fire.

    Args:
      controller: a policy or a name; of the configuration, if it is empty.
      robot: its records.
      task: decision period and limits; a policy has those of its training.
      config: of deploy.toml.
      port: that of the configuration if it is empty.
      seconds: after which it ends by itself [s].
      tuning: as `export` takes it.
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
        narrowed_limits(robot.limits, config.gate)
    with setting("port", not port):
        port = port or config.port
        if not port:
            raise InputError("expected that of the robot, such as /dev/ttyACM0, got none; write it, or give --port")
        SerialPort(port, config.baud).close()
    name = controller or config.controller.mode or "kalman"
    with setting("controller.mode", name == config.controller.mode):
        name, made, task = for_robot(name, robot, task, tuning)
    if config.controller.fallback not in ("", name):
        with setting("controller.fallback"):
            _, fallback, _ = for_robot(config.controller.fallback, robot, task, tuning)
        made = WithFallback(made, fallback, _LONGEST * task.period_s)
    camera_m = config.detections.position_m
    pilot = Pilot(made, robot, task, wire, camera_m=camera_m, latency_s=latency_s, config=config.gate)
    with setting("detections.address"):
        datagrams = DatagramPort(config.detections.address)
    try:
        with _stop_flag() as is_stopped:
            loop = RobotLoop(pilot, partial(SerialPort, port, config.baud), datagrams, task.period_s)
            timing = loop.run(lambda: is_stopped() or watch(pilot), seconds)
    finally:
        datagrams.close()
    speeds = float(pilot.muzzle_speed), float(np.asarray(robot.muzzle_model().speed))
    return Deployment(robot.name, name, port, timing, dict(pilot.counts), getattr(made, "fault", ""), speeds)


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
def _stop_flag() -> Iterator[Callable[[], bool]]:
    """Have signals to stop set a flag while a block runs, so that no decision is cut in two."""
    received = list[int]()

    def stop(number: int, _: Any) -> None:
        received.append(number)

    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)

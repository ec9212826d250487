"""A rehearsal in real time: an emulated robot in a process of its own, and `deploy` at the other end of its port."""

import math
import multiprocessing
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from archerfish.controllers.policy.policy import Policy
from archerfish.controllers.registry import ControllerLike, load_controller
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError
from archerfish.reports.progress import bar
from archerfish.robot import Robot
from archerfish.runtime.configuration import DeployConfig
from archerfish.runtime.pilot import Pilot
from archerfish.studies.deploy import deploy
from archerfish.studies.rehearsal import COUNTED_FROM_S, Rehearsal, rehearsal_of
from archerfish.studies.rehearse import SwingingPlate, emulated_robot, found_robot, robot_name, switch_times
from archerfish.task import Task
from archerfish.virtual_robot.emulator import Emulator, Fault
from archerfish.virtual_robot.emulator_port import EmulatorPort

_MORE_S = 0.2  # the times of the robot begin with the first command
_MARGIN_S = 0.1  # the switch of a wire without one is on within the times of the emulated operator's


def rehearse_live(
    controller: ControllerLike,
    robot: Robot,
    task: Task,
    config: DeployConfig,
    *,
    virtual: str | Path = "",
    seconds: int = 20,
    seed: int = 0,
    target: SwingingPlate | None = None,
    tuning: TuningLike = "kept",
    faults: Sequence[Fault] = (),
) -> Rehearsal:
    """Deploy a controller on an emulated robot, over a pseudo-terminal and in real time.

    Args:
      controller: as `export` takes it.
      robot: its records.
      task: decision period and command limit; a policy has those of its own.
      config: wires, detections, fallback and gate; the chassis of the emulated robot stands, and its camera is at
        `position_m`.
      virtual: as `studies.rehearse.rehearse` takes it.
      seconds: that count.
      seed: of the robot's noise and of the dispersion.
      target: the plate.
      tuning: as `export` takes it.
      faults: what goes wrong with the robot; times count from the first command.

    Raises:
      InputError: if an argument can't be used, or the system has no pseudo-terminals.
    """
    target, controller = target or SwingingPlate(), load_controller(controller)
    if isinstance(controller, Policy) and controller.facts:
        task = controller.facts.task
    options = {"camera_m": config.detections.position_m, "seed": seed, "faults": faults}
    arguments = (virtual, robot, task, config.wires, target), options, config.detections.address
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_emulate, args=(there, arguments), daemon=True)
    process.start()
    switch_on_s, begun_s = switch_times(faults), math.inf
    try:
        port = _received(here)
        with bar("rehearsing", seconds, "seconds") as advance:

            def watch(pilot: Pilot) -> bool:
                nonlocal begun_s
                if pilot.counts["decisions"]:
                    begun_s = min(begun_s, time.monotonic())
                time_s = max(0.0, time.monotonic() - begun_s)
                if not pilot.has_switch:
                    pilot.switch = any(begin + _MARGIN_S < time_s < end - _MARGIN_S for begin, end in switch_on_s)
                if pilot.counts["decisions"] % round(1.0 / task.period_s) == 0:
                    advance(min(max(0.0, time_s - COUNTED_FROM_S), seconds))
                return False

            lasts_s = COUNTED_FROM_S + seconds + _MORE_S
            config = config.replace(yaw_reference="fixed-chassis")
            deployment = deploy(controller, robot, task, config, port=port, seconds=lasts_s, tuning=tuning, watch=watch)
        here.send("stop")
        pellets, violations, late_s = _received(here)
    finally:
        process.kill()
        process.join()
    timing = deployment.timing
    late_ms = 1e3 * timing.lateness.quantile(0.999)
    conditions = (
        f"Real time, {deployment.language}: {len(timing.work)} decisions, {timing.missed} missed, 99.9 % at most "
        f"{late_ms:.2f} ms late; the emulated robot was up to {1e3 * late_s:.0f} ms late."
    )
    return rehearsal_of(
        pellets,
        seconds=seconds,
        robot=robot,
        virtual=robot_name(found_robot(virtual)),
        wires=config.wires,
        config=config,
        controller=deployment.controller,
        target=(*target,),
        period_s=task.period_s,
        hit_radius_m=task.hit_radius_m,
        seed=seed,
        messages=deployment.counts,
        violations=violations,
        fault=deployment.fault,
        faults=tuple(faults),
        conditions=conditions,
    )


def _emulate(connection: Connection, arguments: Any) -> None:
    """Be the robot: send the port's name, live until something is received, send what became of the pellets."""
    (virtual, *rest), options, address = arguments
    try:
        emulator: Emulator = emulated_robot(virtual, *rest, **options)
        with EmulatorPort(emulator, address) as port:
            connection.send(port.name)
            port.run(connection.poll)
    except InputError as error:
        connection.send(error)
        return
    pellets = [pellet._replace(time_s=pellet.time_s - port.begun_s) for pellet in emulator.pellets]
    connection.send((pellets, dict(+emulator.monitor.violations), port.late_s))


def _received(connection: Connection) -> Any:
    """Return what the robot's process sends, or raise its error."""
    try:
        found = connection.recv()
    except EOFError as error:
        raise InputError("the emulated robot's process ended; rehearse without --live, and see what it says") from error
    if isinstance(found, InputError):
        raise found
    return found

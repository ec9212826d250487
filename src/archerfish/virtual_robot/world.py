"""Engagements on the virtual robot: a world to any controller, over the messages that a robot's computer gets.

Nothing here reads the robot's description: what the computer has of camera, link, gimbal and muzzle comes from records.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import Array, map_arrays, single_precision
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.command_limits import limit_command
from archerfish.dynamics.muzzle import direction
from archerfish.errors import InputError
from archerfish.messages import Numbers
from archerfish.protocols import Barrel, Command, Engagement, Seen, Shot, Truth
from archerfish.robot import Robot
from archerfish.simulation.world import make_world, scored
from archerfish.task import Task
from archerfish.tracking.detections import GUESS_DISTANCE_M
from archerfish.tracking.host import Host, new_host, seen_by, with_messages
from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.flights import Received

LEAD_S = 0.2
"""The robot has run for so long when an engagement begins, with the target before it [s]."""


class _Plate(NamedTuple):
    """The first plate of a target."""

    target: Any

    def position(self, time: Numbers) -> Numbers:
        """Return its position in O [m] at times [s], shape (B,) → (B, 3)."""
        return np.asarray(self.target.at(time).position[..., 0, :])


class RunningEngagement(NamedTuple):
    """Engagements under way; a state is good for one step, since the robots change with it."""

    robots: RobotBatch
    host: Host
    command: Numbers  # sent last [rad], (B, 2)
    command_rate: Numbers  # at which it was reached [rad/s], (B, 2)
    decisions: int  # so far


class RobotWorld:
    """The virtual robot as a world: it is stepped in lockstep, and not compiled."""

    compiled = False

    def __init__(self, description: RobotDescription, robot: Robot, task: Task) -> None:
        """Build the world.

        Args:
          description: of the virtual robot, which the virtual robot alone reads.
          robot: the records that its computer has, with those of its sensing.
          task: decision period, command limit and hit radius.

        Raises:
          InputError: if the records have no sensing, or the period is no whole number of the robot's ticks.
        """
        if robot.sensing is None:
            remedy = "identify it from the robot's logs: archerfish identify LOGS"
            raise InputError(f"{robot.name} has no sensing.json, without which no frame can be placed; {remedy}")
        simulated = make_world(robot, task)
        self._description, self._time_offset = description, robot.sensing.camera.time_offset
        self._limits, self._model, self._muzzle = simulated.limits, simulated.model, simulated.muzzle
        self._hit_radius = simulated.hit_radius
        self.name, self.period_s = f"virtual {description.schema.name}", task.period_s
        self.normals, self.plants = simulated.normals, simulated.plants
        self._ticks = round(task.period_s / TICK_S)
        if abs(self._ticks * TICK_S - task.period_s) > 1e-9:
            remedy = f"choose a multiple of {TICK_S:g} s"
            raise InputError(f"period_s must be a whole number of the robot's ticks, got {task.period_s:g}; {remedy}")

    def __repr__(self) -> str:
        return f"RobotWorld({self.name}, decisions every {self.period_s:g} s)"

    def begin(self, engagement: Engagement, normals: Array) -> RunningEngagement:
        """Begin engagements, shape (B,); noise of the robots is seeded by the first decision's normals."""
        start = np.asarray(engagement.start, np.float64)
        robots = RobotBatch(self._description, len(start), _seeds(np.asarray(normals)))
        target = map_arrays(_double, engagement.target)
        received = robots.reset(start, _Plate(target), lead_s=LEAD_S)
        host = self._with(new_host(GUESS_DISTANCE_M * direction(start)), received, robots.time)
        return RunningEngagement(robots, host, start, 0.0 * start, 0)

    def see(self, state: RunningEngagement) -> Seen:
        """Return what a controller sees now, in float32: of the plate the latest frame, if one came."""
        zero = np.zeros(len(state.command))
        barrel = Barrel(zero + self._muzzle.speed, zero + 1e6)
        elapsed_s = self.period_s if state.decisions else 0.0
        return seen_by(state.host, state.robots.time, elapsed_s, state.command, barrel)

    def step(self, state: RunningEngagement, command: Command, normals: Array) -> tuple[RunningEngagement, Shot]:
        """Send a command, let a period pass, then fire if it says so; see `World.step`."""
        robots, before, period = state.robots, state.command, np.asarray(self.period_s)
        asked, away = np.asarray(command.angle, np.float64), line_of_sight(state.host.plate.position)
        angle = np.asarray(limit_command(self._limits, asked, before, state.command_rate, away, period))
        robots.send(angle)
        received = robots.advance(self._ticks)
        flight = robots.shoot(np.asarray(normals[:, :3], np.float64), np.asarray(command.fire))
        host = self._with(state.host, received, robots.time)
        after = RunningEngagement(robots, host, angle, (angle - before) / self.period_s, state.decisions + 1)
        crosses, miss = ~np.isnan(flight.flight_time), np.asarray(flight.miss, np.float32)
        margin = self._hit_radius - np.linalg.norm(miss, axis=-1)
        shot = scored(flight.fired, 0.0 * angle[:, 0], miss, margin, crosses, flight.flight_time, flight.angle)
        return after, single_precision(shot)

    def truth(self, engagement: Engagement) -> Truth:
        """Return the target's path and the best estimates of gimbal and muzzle."""
        return Truth(engagement.target, self._model, self._muzzle)

    def _with(self, host: Host, received: Received, now_s: float) -> Host:
        return with_messages(host, received.feedback, received.detections, self._time_offset, now_s)


def _double(values: Array) -> Array:
    values = np.asarray(values)
    return values.astype(np.float64) if values.dtype.kind == "f" else values


def _seeds(normals: Array) -> NDArray[np.int64]:
    """Return whole numbers from the first draws of each engagement: equal engagements have equal noise."""
    bits = np.ascontiguousarray(normals[:, 0, :2], np.float32).view(np.uint32).astype(np.int64)
    return np.asarray(bits[:, 0] * 65536 + bits[:, 1] % 65536)

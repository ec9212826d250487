"""Engagements on the virtual robot: a world to any controller, over the messages that a real robot's program gets.

Nothing here reads the robot's description: what the program knows of camera and link comes from a sensing record, what
it may ask from a limits record.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import Muzzle, direction
from archerfish.sensing.host import (
    Frames,
    Reports,
    Sighting,
    latest_sighting,
    no_frames,
    no_reports,
    with_frames,
    with_reports,
)
from archerfish.sensing.interfaces import Command, Engagement, Seen, Shot, Truth, without_withheld
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.messages import Heard
from archerfish.virtual_robot.robot import VirtualRobot

Array = NDArray[np.float64]

LEAD_S = 0.2
"""The robot has run for so long when an engagement begins, the target in sight [s]."""
UNSEEN_M = 3.0
"""A target that no frame has shown yet is taken to be so far ahead of the barrel [m]."""


class Known(NamedTuple):
    """What the robot's program knows, all of it from records."""

    time_offset: float
    """From a frame's stamp to its exposure on the robot's clock [s]."""
    limits: CommandLimits
    """What the gimbal may be asked."""
    model: GimbalModel
    """Best estimate of the axes with the mean latency of the commands, for the oracle."""
    muzzle: Muzzle
    """Best estimate of the muzzle."""


class RunningEngagement(NamedTuple):
    """Engagements under way; the robot itself changes with every step."""

    robot: VirtualRobot
    """The robots."""
    reports: Reports
    """Of the gimbal."""
    frames: Frames
    """Of the camera."""
    sighting: Sighting
    """Of the target."""
    command: Array
    """Sent last [rad], shape (B, 2)."""
    command_rate: Array
    """Rate at which it was reached [rad/s], shape (B, 2)."""
    normals: Array
    """Standard normals of the pellets, shape (B, T, 3)."""
    step: int
    """Decisions so far."""


class RobotWorld:
    """The virtual robot as a world: steps in lockstep, not to be compiled."""

    def __init__(self, description: RobotDescription, known: Known, period_s: float) -> None:
        """Keep what engagements are built from.

        Args:
          description: the robot, which nothing but the robot itself reads.
          known: what its program knows.
          period_s: decision period [s].
        """
        self._description, self._known, self._period = description, known, period_s

    @property
    def period_s(self) -> float:
        """Decision period [s]."""
        return self._period

    @property
    def pure(self) -> bool:
        """A robot can't be compiled."""
        return False

    def reset(self, engagements: Engagement, draws: Array) -> tuple[RunningEngagement, Seen]:
        """Begin engagements.

        Args:
          engagements: whom to meet, shape (B,).
          draws: standard normals of all steps, of which the first three are the pellets', shape (B, T, K).
        """
        start = np.asarray(engagements.start, np.float64)
        batch = len(start)
        robot = VirtualRobot(self._description, batch, _seeds(draws))
        motion = map_arrays(lambda each: np.asarray(each, np.float64), engagements.motion)
        heard = robot.reset(start, motion, lead_s=LEAD_S)
        running = RunningEngagement(
            robot,
            no_reports(batch),
            no_frames(batch),
            Sighting(UNSEEN_M * direction(start), np.full(batch, -np.inf), np.zeros(batch, bool)),
            start,
            0.0 * start,
            np.asarray(draws[..., :3], np.float64),
            0,
        )
        running = self._listen(running, heard)
        return running, self._seen(running)

    def step(self, state: RunningEngagement, command: Command) -> tuple[RunningEngagement, Seen, Shot]:
        """Send a command, let a period pass, then fire if it says so."""
        limits = self._known.limits
        sight = line_of_sight(state.sighting.plate)
        asked = np.asarray(command.angle, np.float64)
        angle = limit_command(limits, asked, state.command, state.command_rate, sight, np.asarray(self._period))
        state.robot.send(angle)
        heard = state.robot.advance(round(self._period / TICK_S))
        flight = state.robot.shoot(state.normals[:, state.step], np.asarray(command.fire))
        state = state._replace(command=angle, command_rate=(angle - state.command) / self._period, step=state.step + 1)
        state = self._listen(state, heard)
        # A pellet that never reaches the armor's plane misses by more than any hit radius.
        miss = np.nan_to_num(flight.miss, nan=1e3)
        shot = without_withheld(Shot(flight.fired, miss, flight.flight_time, flight.angle))
        return state, self._seen(state), shot

    def truth(self, engagements: Engagement) -> Truth:
        """Return what the oracle may know: the target's path, and the best estimates of the rest."""
        return Truth(engagements.motion, self._known.model, self._known.muzzle)

    def _listen(self, state: RunningEngagement, heard: Heard) -> RunningEngagement:
        now = state.robot.time
        reports = with_reports(state.reports, heard.feedback_stamp, heard.feedback_angle, heard.feedback_rate, now)
        exposed = heard.frame_stamp + self._known.time_offset
        frames = with_frames(state.frames, exposed, heard.frame_found, heard.frame_position, now)
        sighting = latest_sighting(state.sighting, reports, frames)
        return state._replace(reports=reports, frames=frames, sighting=sighting)

    def _seen(self, state: RunningEngagement) -> Seen:
        now = state.robot.time
        batch = len(state.command)
        zero = np.zeros(batch)
        exposed = np.maximum(state.sighting.exposed, now - 1.0)
        return _single(
            Seen(
                elapsed=zero + (self._period if state.step else 0.0),
                angle=state.reports.angle[:, -1],
                rate=state.reports.rate[:, -1],
                gimbal_age=now - state.reports.stamp[:, -1],
                command=state.command,
                plate=state.sighting.plate[:, None],
                normal_yaw=zero[:, None],
                plate_age=(now - exposed)[:, None],
                fresh=state.sighting.fresh[:, None],
                base=np.zeros((batch, 4)),
                muzzle_speed=zero + self._known.muzzle.speed,
                heat_left=zero + 1e6,
            )
        )


def _seeds(draws: Array) -> NDArray[np.int64]:
    """Whole numbers from the first draws of each engagement: equal engagements meet equal noise."""
    bits = np.ascontiguousarray(draws[:, 0, :2], np.float32).view(np.uint32).astype(np.int64)
    return np.asarray(bits[:, 0] * 65536 + bits[:, 1] % 65536)


def _single(seen: Seen) -> Seen:
    return Seen(*(each if each.dtype == bool else np.asarray(each, np.float32) for each in map(np.asarray, seen)))

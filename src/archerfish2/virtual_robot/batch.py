"""The virtual robot: what a host program can send and hear, over a batch of trials in lockstep or one at a time."""

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.messages import CommandSent, Detections, Feedback
from archerfish2.virtual_robot import muzzle as barrel
from archerfish2.virtual_robot import referee
from archerfish2.virtual_robot.description import TICK_S, RobotDescription
from archerfish2.virtual_robot.flights import Flight, Landing, Received, Truth
from archerfish2.virtual_robot.frames import gimbal_axes, into_gimbal
from archerfish2.virtual_robot.links import CameraLink, CommandLink, FeedbackLink
from archerfish2.virtual_robot.noise import NoiseStream, check_seeds
from archerfish2.virtual_robot.pellets import crossing, landing
from archerfish2.virtual_robot.servo import Servo

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Target(Protocol):
    """Something that moves."""

    def position(self, time: Array) -> Array:
        """Return the plate's position in the base frame [m] at times [s], shape (B,) → (B, 3)."""


class RobotBatch:
    """B robots of one description; times are seconds on the robot's clock, which `reset` sets to zero.

    A host learns from `send`, `advance` and `shoot` only. `truth`, `description` and the referee's counts are for
    tests, plots and scores.
    """

    def __init__(
        self,
        description: RobotDescription,
        batch: int,
        seeds: NDArray[np.int64],
        *,
        enforce_referee: bool = False,
    ) -> None:
        """Build the robots; `reset` must follow.

        Args:
          description: the robot.
          batch: number of trials B.
          seeds: of the trials, whole numbers from 0 on, shape (B,). A trial's noise depends on its seed alone.
          enforce_referee: whether rate and heat limits hold back shots.

        Raises:
          InputError: if batch or seeds can't be used.
        """
        if batch < 1:
            raise InputError(f"batch must be at least 1, got {batch}")
        self.description = description
        self.batch = batch
        self.enforce_referee = enforce_referee
        self._seeds = check_seeds(seeds, batch)
        self._servo = Servo(description, _mechanics(description, batch), self._seeds)
        self._tick = 0

    @property
    def time(self) -> float:
        """Present time on the robot's clock [s]."""
        return self._tick * TICK_S

    def reset(self, start_angle: Array, target: Target, *, lead_s: float = 0.0) -> Received:
        """Begin anew, with the same noise as the last time: the gimbal rests under a command.

        Args:
          start_angle: command under which it rests, pitch and yaw [rad], shape (B, 2).
          target: the plate; its position is asked at times of the robot's clock, below zero during the lead.
          lead_s: how long the robot has run already, with the target in sight [s]; the clock is zero after it.

        Returns:
          What the host received during the lead.

        Raises:
          InputError: if a start lies outside the firmware's range, or the lead is no whole number of ticks.
        """
        start = self._checked(start_angle, "start_angle")
        gains = self._servo.gains
        if np.any(start < gains.command_low - 1e-9) or np.any(start > gains.command_high + 1e-9):
            raise InputError("start_angle lies outside the commands that the firmware takes; start within them")
        lead = round(lead_s / TICK_S)
        if lead < 0 or not math.isclose(lead * TICK_S, lead_s, abs_tol=1e-9):
            raise InputError(f"lead_s must be a whole number of ticks of {TICK_S} s, got {lead_s}")
        self._tick = -lead
        self._target = target
        self._servo.reset(start)
        self._commands = CommandLink(self.description.link, gains, self._seeds, start)
        self._feedback = FeedbackLink(self.description.link, gains, self._seeds, self._tick)
        self._camera = CameraLink(self.description.camera, self._seeds, self.time)
        self._wheels = barrel.rested_wheels(self.batch)
        self._referee = referee.fresh_referee(self.batch)
        self._speed_noise = NoiseStream(self._seeds, "speed", 1, "normal", block=64)
        self._shots = 0
        return self.advance(lead)

    def retarget(self, target: Target) -> None:
        """Put another plate in the place of the present one; its position is asked at times of the robot's clock."""
        self._target = target

    def send(self, command: Array) -> None:
        """Send a command from the host at the present time: pitch and yaw [rad], shape (B, 2).

        Raises:
          InputError: if it is of another shape, or not finite: a wire may carry a NaN, a safety gate must not.
        """
        self._commands.send(self.time, self._checked(command, "command"))

    def advance(self, ticks: int, *, inject: Array | None = None) -> Received:
        """Run ticks of a millisecond and return all that reached the host in them.

        Args:
          ticks: how many.
          inject: commands that the robot itself plays in each tick, past the link [rad], shape (ticks, B, 2): an
            excitation that is stored on the robot.
        """
        first, times = self._tick, TICK_S * (self._tick + np.arange(max(ticks, 1), dtype=np.float64))
        if ticks < 1:
            return self._received(0, np.empty((self.batch, 0)), np.empty((self.batch, 0, 3)))
        commands, stamp, value = self._commands.commands(times)
        if inject is not None:
            commands = np.clip(inject, self._servo.gains.command_low, self._servo.gains.command_high)
            self._commands.in_force = commands[-1]
        motion = self._servo.run(commands)
        self._tick += ticks
        self._feedback.report(first, motion)
        self._camera.expose(first, motion, self._target.position)
        return self._received(ticks, stamp, value)

    def shoot(self, normals: Array, fire: Flags | None = None) -> Flight:
        """Fire one pellet now at the target, and follow it to the target's plane.

        Args:
          normals: standard normals of elevation, azimuth and speed, shape (B, 3).
          fire: who fires, shape (B,); all if not given, less those whom an enforced referee holds back.
        """
        fired, launched, measured = self._launch(normals, fire)
        now = self.time
        arrival = crossing(
            launched.position,
            launched.velocity,
            self.description.muzzle.drag_per_m,
            lambda flown: np.asarray(self._target.position(now + flown)),
        )
        plate = np.asarray(self._target.position(now + np.nan_to_num(arrival.time)))
        miss = np.where(fired[:, None], arrival.position[:, 1:] - plate[:, 1:], np.nan)
        self._referee = referee.count_shots(self.description.referee, self._referee, now, fired, miss)
        angle = np.array(self._servo.physics.angle)
        return Flight(miss, np.where(fired, arrival.time, np.nan), angle, measured, fired)

    def shoot_down(self, normals: Array, fire: Flags | None = None) -> Landing:
        """Fire one pellet now, and follow it to the ground; arguments as for `shoot`, shape (B, 3) and (B,)."""
        fired, launched, measured = self._launch(normals, fire)
        muzzle = self.description.muzzle
        arrival = landing(launched.position, launched.velocity, muzzle.drag_per_m, -muzzle.height_m)
        angle = np.array(self._servo.physics.angle)
        level = np.stack([0.0 * angle[:, 0], angle[:, 1]], axis=-1)
        way = into_gimbal(gimbal_axes(level), arrival.position - launched.position)
        distance, lateral = np.hypot(way[:, 0], way[:, 1]), way[:, 1]
        unfired = np.full((self.batch, 2), np.nan)
        self._referee = referee.count_shots(self.description.referee, self._referee, self.time, fired, unfired)
        return Landing(np.where(fired, distance, np.nan), np.where(fired, lateral, np.nan), angle, measured, fired)

    def heat_left(self) -> Array:
        """Return how many shots the referee's heat limit allows now, as its system tells a host, shape (B,)."""
        return referee.heat_left(self.description.referee, self._referee, self.time)

    def counts(self) -> referee.RefereeState:
        """Return what the referee has counted since the reset."""
        return self._referee

    def truth(self) -> Truth:
        """Return how it really is, for tests and plots, never for controllers."""
        servo = self._servo
        return Truth(np.array(servo.physics.angle), np.array(servo.physics.rate), self._commands.in_force, servo.torque)

    def _received(self, ticks: int, stamp: Array, value: Array) -> Received:
        received, report = self._feedback.take(self.time, ticks)
        frames, seen = self._camera.take(self.time, ticks)
        return Received(
            Feedback(report[..., 0], received, report[..., 1:3], report[..., 3:5]),
            Detections(seen[..., 0], frames, seen[..., 1:2] == 1.0, seen[..., None, 2:]),
            CommandSent(value[..., 0], stamp, value[..., 1:]),
        )

    def _launch(self, normals: Array, fire: Flags | None) -> tuple[Flags, barrel.Launch, Array]:
        muzzle, physics = self.description.muzzle, self._servo.physics
        fired = np.ones(self.batch, bool) if fire is None else np.array(fire, bool)
        if self.enforce_referee:
            fired &= referee.allowed(self.description.referee, self._referee, self.time)
        deficit = barrel.deficit_at(muzzle, self._wheels, self.time)
        launched = barrel.launch(muzzle, deficit, physics.angle, physics.rate, np.asarray(normals))
        self._wheels = barrel.after_shot(muzzle, self._wheels, self.time, fired)
        self._servo.kick(fired)
        noise = self._speed_noise.rows(self._shots, 1)[0, :, 0]
        self._shots += 1
        measured = np.where(fired, launched.speed + muzzle.speed_sensor_sd_m_s * noise, np.nan)
        return fired, launched, measured

    def _checked(self, angles: Array, name: str) -> Array:
        found = np.asarray(angles, dtype=np.float64)
        if found.shape != (self.batch, 2) or not np.all(np.isfinite(found)):
            raise InputError(f"{name} must be finite angles of shape ({self.batch}, 2), got {angles!r}")
        return found


def _mechanics(description: RobotDescription, batch: int) -> Any:
    try:
        from archerfish2.virtual_robot.mujoco_gimbal import MujocoGimbal  # MuJoCo is of the extra `train`
    except ImportError as error:
        remedy = "pip install 'archerfish[train]'"
        raise InputError(f"a virtual robot needs MuJoCo 4, which can't be imported ({error}); {remedy}") from error
    return MujocoGimbal(description.gimbal, batch)

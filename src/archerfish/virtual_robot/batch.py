"""Virtual robots: what a computer can send to them and receive from them, for a batch of trials in lockstep."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from archerfish.errors import InputError
from archerfish.messages import Detections, Feedback
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.flights import Flight, Landing, Received, TrueState
from archerfish.virtual_robot.frames import gimbal_axes, into_gimbal
from archerfish.virtual_robot.links import CameraLink, CommandLink, FeedbackLink
from archerfish.virtual_robot.muzzle import Fired, LastShot, Launch, after_shot, allowed, deficit_at, launch
from archerfish.virtual_robot.noise import NoiseStream
from archerfish.virtual_robot.pellets import Arrival, Event, fly
from archerfish.virtual_robot.servo import GimbalServo, Servo

Array = NDArray[np.float64]


class MovingPlate(Protocol):
    """Something that moves."""

    def position(self, time: Array) -> Array:
        """Return the plate's position in the base frame [m] at times [s], shape (B,) → (B, 3)."""


class RobotBatch:
    """B robots of one description; times are seconds on the robot's clock, which `reset` sets to zero.

    A computer that aims uses `send`, `advance` and `shoot` only; `truth` and `description` are for tests and plots.
    """

    def __init__(
        self,
        description: RobotDescription,
        batch: int,
        seeds: NDArray[np.int64],
        *,
        enforce_referee: bool = False,
        servo: GimbalServo | None = None,
    ) -> None:
        """Build the robots; `reset` must follow.

        Args:
          description: the robot.
          batch: number of trials B.
          seeds: of the trials, whole numbers from 0 on, shape (B,). A trial's noise depends on its seed alone.
          enforce_referee: whether limits of rate and heat withhold shots.
          servo: of as many gimbals, in the place of the firmware and the gimbal of the description.

        Raises:
          InputError: if batch or seeds can't be used, or MuJoCo is missing.
        """
        if batch < 1:
            raise InputError(f"batch must be at least 1, got {batch}; give a trial for each engagement")
        found = np.asarray(seeds)
        if found.shape != (batch,) or found.dtype.kind not in "iu" or np.any(found < 0):
            got = f"{found.dtype} of shape {found.shape}"
            raise InputError(f"seeds must be {batch} whole numbers from 0 on, got {got}; use np.arange({batch})")
        self.description = description
        self.batch = batch
        self._enforce_referee = enforce_referee
        self._seeds = found.astype(np.int64)
        self._servo = servo or Servo(description, self._seeds)
        self._tick = 0

    @property
    def time(self) -> float:
        """Present time on the robot's clock [s]."""
        return self._tick * TICK_S

    def reset(self, start_angle: Array, target: MovingPlate, *, lead_s: float = 0.0) -> Received:
        """Begin with the same noise as the last time: the gimbal rests under a command.

        Args:
          start_angle: command under which it rests, pitch and yaw [rad], shape (B, 2).
          target: the plate; its position is needed at times of the robot's clock, below zero during the lead.
          lead_s: how long the robot has run already, with the target before it [s]; the clock is zero after it.

        Returns:
          What the computer received during the lead.

        Raises:
          InputError: if a start lies outside the firmware's range, or the lead is no whole number of ticks.
        """
        start = self._checked(start_angle, "start_angle")
        drive = self._servo.drive
        if np.any(start < drive.command_low - 1e-9) or np.any(start > drive.command_high + 1e-9):
            raise InputError("start_angle lies outside the commands that the firmware takes; start within them")
        lead = round(lead_s / TICK_S)
        if lead < 0 or not math.isclose(lead * TICK_S, lead_s, abs_tol=1e-9):
            raise InputError(f"lead_s must be a whole number of ticks of {TICK_S} s, got {lead_s}; round it")
        self._tick = -lead
        self._target = target
        self._servo.reset(start)
        self._commands = CommandLink(self.description.link, drive, self._seeds, start)
        self._feedback = FeedbackLink(self.description.link, drive, self._seeds, self._tick)
        self._camera = CameraLink(self.description.camera, self._seeds, self.time)
        zero = np.zeros(self.batch)
        self._last_shot = LastShot(zero - np.inf, zero, zero)
        self._speed_noise = NoiseStream(self._seeds, "speed")
        self._shots = 0
        return self.advance(lead)

    def retarget(self, target: MovingPlate) -> None:
        """Replace the target; its position is needed at times of the robot's clock."""
        self._target = target

    def send(self, command: Array) -> None:
        """Send a command at the present time: pitch and yaw [rad], shape (B, 2).

        Raises:
          InputError: if it has another shape, or is not finite.
        """
        self._commands.send(self.time, self._checked(command, "command"))

    def advance(self, ticks: int, *, inject: Array | None = None) -> Received:
        """Run ticks of a millisecond and return all that reached the computer in them.

        Args:
          ticks: how many.
          inject: commands that the robot itself plays in each tick, past the link [rad], shape (ticks, B, 2): an
            excitation that is stored on the robot.
        """
        first = self._tick
        commands, sent = self._commands.commands(first, ticks)
        if inject is not None:
            commands = np.clip(inject, self._servo.drive.command_low, self._servo.drive.command_high)
            self._commands.in_force = commands[-1]
        motion = self._servo.run(commands)
        self._tick += ticks
        self._feedback.report(first, motion)
        self._camera.expose(first, motion, self._target.position)
        reported_s, report = self._feedback.channel.take(self.time, ticks)
        frame_s, frame = self._camera.channel.take(self.time, ticks)
        return Received(
            Feedback(report[..., 0], reported_s, report[..., 1:3], report[..., 3:]),
            Detections(frame[..., 0], frame_s, ~np.isnan(frame[..., 1:2]), frame[..., None, 1:]),
            sent,
        )

    def shoot(self, normals: Array, fire: Fired | None = None) -> Flight:
        """Fire one pellet now at the target, and follow it to the target's plane.

        Args:
          normals: standard normals of elevation, azimuth and speed, shape (B, 3).
          fire: which robots fire, shape (B,); None for all. An enforced referee may withhold some of the shots.
        """
        now, target = self.time, self._target

        def beyond_plate(flown: Array, place: Array) -> Array:
            return np.asarray(place[:, 0] - target.position(now + flown)[:, 0])

        fired, _, arrival, measured = self._fired(normals, fire, beyond_plate)
        plate = target.position(now + np.nan_to_num(arrival.time))
        miss = np.where(fired[:, None], arrival.position[:, 1:] - plate[:, 1:], np.nan)
        return Flight(miss, np.where(fired, arrival.time, np.nan), self._servo.angle, measured, fired)

    def shoot_down(self, normals: Array, fire: Fired | None = None) -> Landing:
        """Fire one pellet now, and follow it to the ground; arguments as for `shoot`, shape (B, 3) and (B,)."""
        floor_m = -self.description.muzzle.height_m
        fired, launched, arrival, measured = self._fired(
            normals, fire, lambda _, place: np.asarray(floor_m - place[:, 2])
        )
        level = self._servo.angle * [0.0, 1.0]
        forward, left, _ = into_gimbal(gimbal_axes(level), arrival.position - launched.position).T
        distance, lateral = np.where(fired, [np.hypot(forward, left), left], np.nan)
        return Landing(distance, lateral, measured)

    def truth(self) -> TrueState:
        """Return the true mechanics, for tests and plots, never for controllers."""
        servo = self._servo
        return TrueState(servo.angle, servo.rate, self._commands.in_force, servo.torque)

    def _fired(self, normals: Array, fire: Fired | None, event: Event) -> tuple[Fired, Launch, Arrival, Array]:
        """Return which robots fired, their pellets, where these arrive, and the measured speeds [m/s], shape (B,)."""
        muzzle, rules, servo = self.description.muzzle, self.description.referee, self._servo
        fired = np.ones(self.batch, bool) if fire is None else np.array(fire, bool)
        if self._enforce_referee:
            fired &= allowed(rules, self._last_shot, self.time)
        deficit = deficit_at(muzzle, self._last_shot, self.time)
        launched = launch(muzzle, deficit, servo.angle, servo.rate, normals)
        self._last_shot = after_shot(muzzle, rules, self._last_shot, self.time, fired)
        servo.kick(fired)
        noise = self._speed_noise.rows(self._shots, 1)[:, 0, 0]
        self._shots += 1
        measured = np.where(fired, launched.speed + muzzle.speed_sensor_sd_m_s * noise, np.nan)
        return fired, launched, fly(launched.position, launched.velocity, muzzle.drag_per_m, event), measured

    def _checked(self, angles: Array, name: str) -> Array:
        found = np.asarray(angles, dtype=np.float64)
        if found.shape != (self.batch, 2) or not np.all(np.isfinite(found)):
            got = f"shape {found.shape} with {np.count_nonzero(np.isfinite(found))} finite; correct the controller"
            raise InputError(f"{name} must be finite angles of shape ({self.batch}, 2), got {got}")
        return found

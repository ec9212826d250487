"""Simulated recordings of a robot's camera and link, with known truth.

The gimbal lags and saturates, its encoder has steps, its feedback and its commands come late by times that vary; the
camera has a clock of its own, drops frames, jitters, and sometimes detects something else than the plate.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from archerfish.logs.timing import DetectionLog, GimbalLog

Array = NDArray[np.float64]

TICK = 0.001


@dataclass(frozen=True)
class Robot:
    """The truth behind a recording."""

    fps: float = 80.0  # frames per second [Hz]
    clock: float = 0.137  # camera's clock less the host's [s]
    stamp_jitter: float = 3e-4  # standard deviation of the stamps about the exposures [s]
    exposure_jitter: float = 3e-4  # standard deviation of the exposures about even times [s]
    latency: float = 0.035  # mean time from exposure to receipt [s]
    latency_jitter: float = 0.002  # its standard deviation [s]
    across: float = 0.005  # noise of a detection across the line of sight [m]
    along: float = 0.045  # noise along the line of sight [m]
    missed: float = 0.05  # share of the frames without a detection
    outliers: float = 0.01  # share of the detections that are something else
    command_delay: tuple[float, float] = (0.005, 0.015)  # ends of the uniform delay of a command [s]
    feedback_delay: float = 0.003  # age of the feedback when the host stamps it [s]
    log_rate: float = 500.0  # samples per second of the gimbal log [Hz]
    quantum: float = 2 * np.pi / 8192  # step of the encoder [rad]
    bandwidth: float = 41.0  # natural frequency of the axis [rad/s], damping 0.75
    acceleration: float = 67.0  # largest acceleration of the axis [rad/s²]
    plate: tuple[float, float, float] = (3.0, 0.2, 0.1)  # plate at rest, from the pivot [m]
    camera: tuple[float, float, float] = (0.1, 0.02, 0.05)  # camera, from the pivot, in the gimbal's frame [m]
    tilt: float = 0.02  # pitch of the camera on the gimbal [rad]

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Self:
        """Draw a robot: clocks, delays, mounting and plate are anywhere that they may well be."""
        return cls(
            clock=rng.uniform(-0.5, 0.5),
            latency=rng.uniform(0.015, 0.060),
            feedback_delay=rng.uniform(0.0, 0.008),
            stamp_jitter=rng.uniform(2e-4, 1.5e-3),
            plate=(rng.uniform(1.5, 5.0), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)),
            camera=tuple(rng.uniform(-0.1, 0.1, 3)),
            tilt=rng.uniform(-0.05, 0.05),
        )

    def truth(self) -> dict[str, float]:
        """Return the values that should be found, by the names of the estimates."""
        apart = np.array(self.plate) - self.camera
        # The plate's distance from the camera changes as the camera swings; its line of sight stays level enough.
        bearing = self.across / float(np.linalg.norm(apart))
        return {
            "camera.rate_hz": self.fps,
            "camera.time_offset": self.feedback_delay - self.clock,
            "camera.stamp_jitter": self.stamp_jitter,
            "camera.bearing_sd": bearing,
            "camera.elevation_sd": bearing,
            "camera.range_sd": self.along,
            "camera.miss_probability": self.missed,
            "camera.outlier_share": self.outliers,
            "camera.latency": self.latency,
            "latency by the sweep alone": self.latency - self.feedback_delay,
            "camera.latency_jitter": self.latency_jitter,
            "link.command_delay": float(np.mean(self.command_delay)) + self.feedback_delay,
            "link.command_jitter": float(np.ptp(self.command_delay) / np.sqrt(12)),
            "link.feedback_delay": self.feedback_delay,
        }


def yaw_motion(robot: Robot, command: Array, delays: Array) -> Array:
    """Return the yaw at every tick under a command of shape (N,), held back tick by tick by delays of shape (N,)."""
    arrival = np.arange(command.size) + np.round(delays / TICK).astype(int)
    newest = np.zeros(command.size, dtype=int)
    inside = arrival < command.size
    np.maximum.at(newest, arrival[inside], np.flatnonzero(inside))
    held, yaw, angle, rate = command[np.maximum.accumulate(newest)].tolist(), [], float(command[0]), 0.0
    stiffness, damping, limit = robot.bandwidth**2, 1.5 * robot.bandwidth, robot.acceleration
    for wanted in held:
        yaw.append(angle)
        torque = min(max(stiffness * (wanted - angle) - damping * rate, -limit), limit)
        angle += TICK * (rate + 0.5 * TICK * torque)
        rate += TICK * torque
    return np.array(yaw)


def gimbal_log(robot: Robot, yaw: Array, command: Array, rng: np.random.Generator) -> GimbalLog:
    """Return what the host logs of a yaw at every tick, from tick 0 at host time 0."""
    stride = round(1 / (robot.log_rate * TICK))
    rows = np.arange(20, yaw.size, stride)
    stamps = TICK * rows + 2e-5 * rng.standard_normal(rows.size)
    sampled = np.interp(stamps - robot.feedback_delay, TICK * np.arange(yaw.size), yaw)
    measured = robot.quantum * np.round(sampled / robot.quantum) if robot.quantum else sampled
    return GimbalLog(stamps, measured, np.zeros(rows.size), command[rows], "gimbal.csv")


def seen_position(robot: Robot, plate: Array, yaw: Array) -> Array:
    """Return plates in the base frame, shape (K, 3), as the camera sees them at yaws of shape (K,)."""
    x, y, z = plate.T
    forward, left = np.cos(yaw) * x + np.sin(yaw) * y, -np.sin(yaw) * x + np.cos(yaw) * y
    offset = np.stack([forward, left, z], axis=-1) - robot.camera
    c, s = np.cos(robot.tilt), np.sin(robot.tilt)
    return np.stack([c * offset[:, 0] + s * offset[:, 2], offset[:, 1], -s * offset[:, 0] + c * offset[:, 2]], axis=-1)


def detections(robot: Robot, exposures: Array, position: Array, rng: np.random.Generator) -> DetectionLog:
    """Return what the host logs of noise-free positions: noisy, some missed, some of something else."""
    count = exposures.size
    distance = np.linalg.norm(position, axis=1, keepdims=True)
    sight = position / distance
    noise = robot.across * rng.standard_normal((count, 3))
    noise += (robot.along * rng.standard_normal((count, 1)) - np.sum(noise * sight, axis=1, keepdims=True)) * sight
    strays = rng.random(count) < robot.outliers
    noise[strays] += rng.uniform(-1.0, 1.0, (int(strays.sum()), 3))
    stamps = exposures + robot.clock + robot.stamp_jitter * rng.standard_normal(count)
    receive = np.maximum.accumulate(exposures + robot.latency + robot.latency_jitter * rng.standard_normal(count))
    kept = rng.random(count) >= robot.missed
    return DetectionLog(stamps[kept], (position + noise)[kept], receive[kept], "detections.csv")


def exposures(robot: Robot, start: float, end: float, rng: np.random.Generator) -> Array:
    """Return the moments of the frames between two host times."""
    even = np.arange(start + rng.uniform(0, 1 / robot.fps), end, 1 / robot.fps)
    return even + robot.exposure_jitter * rng.standard_normal(even.size)


def sweep_recording(
    robot: Robot, rng: np.random.Generator, *, seconds: float = 20.0, amplitude: float = np.radians(20)
) -> tuple[GimbalLog, DetectionLog]:
    """Simulate a plate at rest while the yaw sweeps from 0.2 to 2 Hz."""
    time = np.arange(0, seconds, TICK)
    command = amplitude * np.sin(2 * np.pi * (0.2 * time + 0.9 * time**2 / seconds))
    yaw = yaw_motion(robot, command, rng.uniform(*robot.command_delay, time.size))
    frames = exposures(robot, 0.1, seconds - 0.1, rng)
    at = np.interp(frames, time, yaw)
    position = seen_position(robot, np.tile(robot.plate, (frames.size, 1)), at)
    return gimbal_log(robot, yaw, command, rng), detections(robot, frames, position, rng)


def step_recording(
    robot: Robot, rng: np.random.Generator, *, steps: int = 24, angle: float = np.radians(8)
) -> tuple[GimbalLog, DetectionLog, Array]:
    """Simulate command steps, then a target that steps by 0.3 m while the gimbal is at rest.

    Returns:
      The gimbal log, the detections of the target, and the moments of its steps on the host's clock.
    """
    # Commands are sent and logged in one loop.
    changes = np.round((1.0 + 0.6 * np.arange(steps) + rng.uniform(0, 0.02, steps)) * robot.log_rate) / robot.log_rate
    moments = changes[-1] + 2.0 + 1.2 * np.arange(steps) + rng.uniform(0, 0.1, steps)
    time = np.arange(0, moments[-1] + 1.5, TICK)
    count = np.searchsorted(changes, time + TICK / 2)
    command = angle * (count % 2).astype(float)
    # A command is held back as a whole: one delay for each step.
    delays = rng.uniform(*robot.command_delay, steps + 1)[count]
    yaw = yaw_motion(robot, command, delays)
    frames = exposures(robot, changes[-1] + 1.0, time[-1] - 0.2, rng)
    place = np.array(robot.plate) + np.outer(np.searchsorted(moments, frames) % 2, [0.0, 0.3, 0.0])
    position = seen_position(robot, place, np.interp(frames, time, yaw))
    return gimbal_log(robot, yaw, command, rng), detections(robot, frames, position, rng), moments

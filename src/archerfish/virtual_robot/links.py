"""The links: commands to the robot, reports and detections back, each with its rate, latency, steps and losses."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from archerfish.messages import CommandSent
from archerfish.virtual_robot.camera import detect
from archerfish.virtual_robot.channel import ARRIVAL_ROUNDING, Channel
from archerfish.virtual_robot.description import TICK_S, Camera, Link
from archerfish.virtual_robot.firmware import Drive, encoder_angle
from archerfish.virtual_robot.noise import NoiseStream
from archerfish.virtual_robot.servo import Motion

Array = NDArray[np.float64]
Seeds = NDArray[np.int64]


class CommandLink:
    """From the computer's `send` to the command in force in each tick."""

    def __init__(self, link: Link, drive: Drive, seeds: Seeds, start: Array) -> None:
        self._link, self._drive = link, drive
        self._noise = NoiseStream(seeds, "command")
        self._sent = 0
        self._channel = Channel(len(seeds), 3, (link.command_latency_low_ms, link.command_latency_high_ms))
        self.in_force = start

    def send(self, time: float, command: Array) -> None:
        """Send a command [rad], shape (B, 2), at a time [s]."""
        uniform = self._noise.rows(self._sent, 1)[:, 0]
        self._sent += 1
        value = _quantised(command, math.radians(self._link.command_quantum_deg))
        value = np.clip(value, self._drive.command_low, self._drive.command_high)
        sent = np.full((len(value), 1), time)
        lost = uniform[:, 1:] < self._link.command_loss
        self._channel.send(sent, uniform[:, :1], lost, np.concatenate([sent, value], axis=1)[:, None])

    def commands(self, first: int, ticks: int) -> tuple[Array, CommandSent]:
        """Return what is in force in the ticks from `first` on [rad], shape (ticks, B, 2), and what came into force."""
        times = TICK_S * np.arange(first, first + ticks)
        arrival, content = self._channel.take(TICK_S * (first + ticks - 1), ticks)
        known = np.concatenate([self.in_force[:, None], content[..., 1:]], axis=1)
        count = np.sum(arrival[:, None, :] <= times[:, None] + ARRIVAL_ROUNDING, axis=2)
        in_force = known[np.arange(len(known)), count.T]
        if ticks:
            self.in_force = in_force[-1]
        return in_force, CommandSent(content[..., 0], arrival, content[..., 1:])


class FeedbackLink:
    """Reports of the gimbal; the channel has when each was sampled [s], angles [rad] and rates [rad/s], width 5."""

    def __init__(self, link: Link, drive: Drive, seeds: Seeds, start: int) -> None:
        self._link, self._drive, self._start = link, drive, start
        self._noise = NoiseStream(seeds, "feedback")
        self._reported = 0
        latency_ms = (link.feedback_latency_low_ms, link.feedback_latency_high_ms)
        self.channel = Channel(len(seeds), 5, latency_ms, link.feedback_rate_hz)

    def report(self, first: int, motion: Motion) -> None:
        """Send the reports that are due in the ticks from `first` on that a motion covers."""
        link, per_tick = self._link, self._link.feedback_rate_hz * TICK_S
        # Each is due in the first tick at or after its moment.
        end = math.floor((first + len(motion.gyro) - 1 - self._start) * per_tick + ARRIVAL_ROUNDING) + 1
        due = np.arange(self._reported, end)
        ticks = np.ceil(due / per_tick - ARRIVAL_ROUNDING).astype(np.int64) + self._start
        uniform = self._noise.rows(self._reported, due.size)
        self._reported = end
        angle = motion.angle[ticks - first]
        if link.feedback_source == "encoder":
            angle = encoder_angle(self._drive, angle)
        angle = _quantised(angle, math.radians(link.feedback_angle_quantum_deg))
        rate = _quantised(motion.gyro[ticks - first], math.radians(link.feedback_rate_quantum_deg_per_s))
        sampled = np.broadcast_to(ticks * TICK_S, uniform.shape[:2])
        values = np.concatenate([angle, rate], axis=-1).swapaxes(0, 1)
        content = np.concatenate([sampled[..., None], values], axis=-1)
        self.channel.send(sampled, uniform[..., 0], uniform[..., 1] < link.feedback_loss, content)


class CameraLink:
    """Frames of the camera; the channel has stamps [s] and positions in the camera's frame [m], width 4.

    The phase of the exposures differs by trial, as no camera is locked to a gimbal.
    """

    def __init__(self, camera: Camera, seeds: Seeds, start: float) -> None:
        self._camera = camera
        # Noise in bearing, elevation and range, then of the stamp.
        self._normals = NoiseStream(seeds, "camera")
        # Latency, and whether the plate is missed; the first row has the phase.
        self._uniforms = NoiseStream(seeds, "detection")
        self._begin = start + self._uniforms.rows(0, 1)[:, 0, 0] / camera.rate_hz
        self._exposed = np.zeros(len(seeds), np.int64)
        self.channel = Channel(len(seeds), 4, (camera.latency_low_ms, camera.latency_high_ms), camera.rate_hz)

    def expose(self, first: int, motion: Motion, target: Callable[[Array], Array]) -> None:
        """Expose and detect the frames that are due in the ticks from `first` on that a motion covers."""
        camera, period = self._camera, 1.0 / self._camera.rate_hz
        end = (first + len(motion.gyro)) * TICK_S
        due = np.ceil((end - self._begin) / period - ARRIVAL_ROUNDING).astype(np.int64)
        count = np.maximum(due - self._exposed, 0)[:, None]
        if not count.any():
            return
        step = np.arange(count.max())
        # Trials differ by a frame; those that have fewer repeat the last one, which is never sent.
        index = self._exposed[:, None] + np.minimum(step, np.maximum(count - 1, 0))
        exposure = np.where(step < count, self._begin[:, None] + index * period, np.inf)
        normals, uniform = self._normals.rows_at(index), self._uniforms.rows_at(index + 1)
        self._exposed = self._exposed + count[:, 0]
        moment = np.where(np.isinf(exposure), first * TICK_S, exposure)
        plate = np.stack([target(column) for column in moment.T], axis=1)
        seen = detect(camera, plate, _angle_at(first, motion, moment), normals, uniform[..., 1])
        stamp = moment + 1e-3 * (camera.clock_offset_ms + camera.stamp_jitter_ms * normals[..., 3])
        content = np.concatenate([stamp[..., None], seen], axis=-1)
        self.channel.send(exposure, uniform[..., 0], False, content)


def _quantised(value: Array, quantum: float) -> Array:
    """Round to steps, none if the quantum is zero."""
    return value if quantum == 0 else np.asarray(quantum * np.rint(value / quantum))


def _angle_at(first: int, motion: Motion, moment: Array) -> Array:
    """Return the true angles at moments between ticks [rad], shape (B, N) → (B, N, 2)."""
    place = moment / TICK_S
    # From the clock's own ticks, so that the result does not depend on where a call began.
    begin = np.floor(place)
    tick = np.clip(begin.astype(np.int64) - first, 0, len(motion.gyro) - 1)
    share = (place - begin)[..., None]
    trial = np.arange(len(moment))[:, None]
    return np.asarray((1.0 - share) * motion.angle[tick, trial] + share * motion.angle[tick + 1, trial])

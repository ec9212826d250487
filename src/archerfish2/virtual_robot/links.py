"""The link: commands to the robot, reports and detections back, each with its rate, latency, steps and losses."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.camera import NORMALS, UNIFORMS, detect
from archerfish2.virtual_robot.description import TICK_S, Camera, Link
from archerfish2.virtual_robot.firmware import Gains, encoder_angle
from archerfish2.virtual_robot.mailbox import Mailbox, arrivals
from archerfish2.virtual_robot.noise import NoiseStream
from archerfish2.virtual_robot.servo import Motion

Array = NDArray[np.float64]
_ROUNDING = 1e-9


def places(ticks: int, rate_hz: float, low_ms: float, high_ms: float) -> int:
    """Return how many messages of a rate can arrive within some ticks, those of the latency's spread included."""
    return math.floor((ticks * TICK_S + 1e-3 * (high_ms - low_ms)) * rate_hz + _ROUNDING) + 1


def quantised(value: Array, quantum: float) -> Array:
    """Round to steps, none if the quantum is zero, shape B."""
    return value if quantum == 0 else np.asarray(quantum * np.rint(value / quantum))


class CommandLink:
    """From the host's `send` to the command in force at each tick."""

    def __init__(self, link: Link, gains: Gains, seeds: NDArray[np.int64], start: Array) -> None:
        self._link = link
        self._gains = gains
        self._noise = NoiseStream(seeds, "command", 2, "uniform", block=64)
        self._sent = 0
        self._last = np.full(len(seeds), -np.inf)
        self._mailbox = Mailbox(len(seeds), 3)
        self.in_force = start

    def send(self, time: float, command: Array) -> None:
        """Send a command [rad], shape (B, 2), at a time [s]."""
        link, chance = self._link, self._noise.rows(self._sent, 1)[0]
        self._sent += 1
        spread = link.command_latency_high_ms - link.command_latency_low_ms
        latency = 1e-3 * (link.command_latency_low_ms + spread * chance[:, :1])
        lost = chance[:, 1:] < link.command_loss
        received, self._last = arrivals(np.full_like(latency, time), latency, lost, self._last)
        value = quantised(command, math.radians(link.command_quantum_deg))
        value = np.clip(value, self._gains.command_low, self._gains.command_high)
        sent = np.full((len(value), 1), time)
        self._mailbox.put(received, np.concatenate([sent, value], axis=1)[:, None])

    def commands(self, times: Array) -> tuple[Array, Array, Array]:
        """Return what is in force at the ticks to come.

        Args:
          times: of the ticks [s], shape (n,).

        Returns:
          Commands in force, shape (n, B, 2); arrivals of those that came into force, NaN where fewer, shape (B, H);
          when each was sent and its value, shape (B, H, 3).
        """
        received, value = self._mailbox.take(times[-1] + _ROUNDING)
        if received.shape[1] == 0:
            return np.broadcast_to(self.in_force, (len(times), *self.in_force.shape)), received, value
        known = np.concatenate([self.in_force[:, None], value[..., 1:]], axis=1)
        count = np.sum(received[:, None, :] <= times[:, None] + _ROUNDING, axis=2)
        held = known[np.arange(len(known)), count.T]
        self.in_force = held[-1]
        return held, received, value


class FeedbackLink:
    """Reports of the gimbal's angles and rates."""

    def __init__(self, link: Link, gains: Gains, seeds: NDArray[np.int64], start: int) -> None:
        self._link = link
        self._gains = gains
        self._noise = NoiseStream(seeds, "feedback", 2, "uniform")
        self._start = start
        self._reported = 0
        self._last = np.full(len(seeds), -np.inf)
        self._mailbox = Mailbox(len(seeds), 5)

    def report(self, first: int, motion: Motion) -> None:
        """Send the reports that are due in the ticks from `first` on that a motion covers."""
        link, count = self._link, len(motion.gyro)
        per_tick = link.feedback_rate_hz * TICK_S
        # Each is due at the first tick at or after its moment.
        end = math.floor((first + count - 1 - self._start) * per_tick + _ROUNDING) + 1
        due = np.arange(self._reported, end)
        if due.size == 0:
            return
        ticks = np.ceil(due / per_tick - _ROUNDING).astype(np.int64) + self._start
        chance = self._noise.rows(self._reported, due.size).swapaxes(0, 1)
        self._reported = end
        stamp = np.broadcast_to(ticks * TICK_S, chance.shape[:2])
        spread = link.feedback_latency_high_ms - link.feedback_latency_low_ms
        latency = 1e-3 * (link.feedback_latency_low_ms + spread * chance[..., 0])
        received, self._last = arrivals(stamp, latency, chance[..., 1] < link.feedback_loss, self._last)
        self._mailbox.put(received, np.concatenate([stamp[..., None], self._content(motion, ticks - first)], axis=-1))

    def _content(self, motion: Motion, index: NDArray[np.int64]) -> Array:
        link, angle = self._link, motion.angle[index]
        if link.feedback_source == "encoder":
            angle = encoder_angle(self._gains, angle)
        angle = quantised(angle, math.radians(link.feedback_angle_quantum_deg))
        rate = quantised(motion.gyro[index], math.radians(link.feedback_rate_quantum_deg_per_s))
        return np.concatenate([angle, rate], axis=-1).swapaxes(0, 1)

    def take(self, until: float, ticks: int) -> tuple[Array, Array]:
        """Return arrivals by a time [s], shape (B, F), and stamp, angles and rates, shape (B, F, 5)."""
        link = self._link
        size = places(ticks, link.feedback_rate_hz, link.feedback_latency_low_ms, link.feedback_latency_high_ms)
        return self._mailbox.take(until + _ROUNDING, size)


class CameraLink:
    """The camera's frames; the phase of its exposures is each trial's own, as no camera is locked to a gimbal."""

    def __init__(self, camera: Camera, seeds: NDArray[np.int64], start: float) -> None:
        self._camera = camera
        self._normals = NoiseStream(seeds, "camera", NORMALS, "normal", block=64)
        self._uniforms = NoiseStream(seeds, "detection", UNIFORMS, "uniform", block=64)
        phase = self._uniforms.rows(0, 1)[0, :, 0]
        self._begin = start + phase / camera.rate_hz
        self._exposed = np.zeros(len(seeds), np.int64)
        self._last = np.full(len(seeds), -np.inf)
        self._mailbox = Mailbox(len(seeds), 5)

    def expose(self, first: int, motion: Motion, target: Callable[[Array], Array]) -> None:
        """Expose and detect the frames that are due in the ticks from `first` on that a motion covers."""
        end = (first + len(motion.gyro)) * TICK_S
        period = 1.0 / self._camera.rate_hz
        due = np.ceil((end - self._begin) / period - _ROUNDING).astype(np.int64)
        count = np.maximum(due - self._exposed, 0)
        if not count.any():
            return
        step = np.arange(int(count.max()))
        # Trials differ by a frame; who has fewer repeats the last one, which is never sent.
        index = self._exposed[:, None] + np.minimum(step, np.maximum(count[:, None] - 1, 0))
        exposure = np.where(step < count[:, None], self._begin[:, None] + index * period, np.inf)
        normals, chance = self._normals.rows_at(index), self._uniforms.rows_at(index + 1)
        self._exposed = self._exposed + count
        self._send(first, motion, target, exposure, normals, chance)

    def _send(
        self,
        first: int,
        motion: Motion,
        target: Callable[[Array], Array],
        exposure: Array,
        normals: Array,
        chance: Array,
    ) -> None:
        camera = self._camera
        moment = np.where(np.isinf(exposure), first * TICK_S, exposure)
        plate = np.stack([target(column) for column in moment.T], axis=1)
        seen = detect(camera, plate, _angle_at(first, motion, moment), normals, chance[..., 1])
        stamp = moment + 1e-3 * (camera.clock_offset_ms + camera.stamp_jitter_ms * normals[..., 3])
        latency = 1e-3 * (camera.latency_low_ms + (camera.latency_high_ms - camera.latency_low_ms) * chance[..., 0])
        received, self._last = arrivals(exposure, latency, np.zeros(exposure.shape, bool), self._last)
        self._mailbox.put(received, np.concatenate([np.stack([stamp, seen.found], axis=-1), seen.position], axis=-1))

    def take(self, until: float, ticks: int) -> tuple[Array, Array]:
        """Return arrivals by a time [s], shape (B, G), and stamp, whether found, and position, shape (B, G, 5)."""
        camera = self._camera
        size = places(ticks, camera.rate_hz, camera.latency_low_ms, camera.latency_high_ms)
        return self._mailbox.take(until + _ROUNDING, size)


def _angle_at(first: int, motion: Motion, moment: Array) -> Array:
    """Return the true angles at moments between ticks [rad], shape (B, N) → (B, N, 2)."""
    place = moment / TICK_S
    # From the clock's own ticks, so that the result does not depend on where a call began.
    begun = np.floor(place)
    tick = np.clip(begun.astype(np.int64) - first, 0, len(motion.gyro) - 1)
    share = (place - begun)[..., None]
    trial = np.arange(len(moment))[:, None]
    return np.asarray((1.0 - share) * motion.angle[tick, trial] + share * motion.angle[tick + 1, trial])

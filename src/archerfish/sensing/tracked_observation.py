"""What a policy sees on a robot whose camera and link are late and noisy: a tracker's estimate, and a long memory.

The action is an offset from the aim at where a Kalman filter takes the target to be now, and the command is the next
one on the fastest way there that can stop; so untrained it is plain auto-aim without lead. The numbers it sees: that
aim against the gimbal, where the command would come to rest, the last moves of gimbal and command, the ages of what was
seen, and of the target the filter's speed, the last sights, and a second of history, as Legendre coefficients. All but
the aim itself are relative to the estimate, those of the target in metres across the line of sight.
"""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import Track, TrackerNoise, begin_track, position_after, predict, update
from archerfish.sensing.legendre_memory import constant_history, legendre_matrices, with_sample
from archerfish.sensing.stopping_way import on_the_way, overshoot

FRAMES, SIGHTS, ORDER = 4, 8, 12
"""Defaults: remembered moves of gimbal and command, raw sights, and Legendre coefficients."""
TRACKER_ACCELERATION = 3.0
"""Default of what the tracker believes of a target's acceleration, as a standard deviation [m/s²]."""
WINDOW_S = 1.0
"""Length of the history [s]."""
_FINE, _METRES, _TYPICAL_AGE_S = 100.0, 20.0, 0.05


class TrackedMemory(NamedTuple):
    """What is remembered between decisions."""

    track: Track
    """The target as of the latest exposure."""
    plate_age: Array
    """How long ago that was [s], shape B."""
    gimbal_age: Array
    """Age of the latest feedback [s], shape B."""
    angle: Array
    """Gimbal's angles, the newest last [rad], shape B + (h, 2)."""
    command: Array
    """Commands in force, the newest last [rad], shape B + (h, 2)."""
    bearing: Array
    """Azimuths of the last sights, the newest last [rad], shape B + (s,)."""
    history: Array
    """Legendre coefficients of the azimuth [rad], shape B + (d,)."""
    clock: Array
    """Since the first sight [s], shape B."""


class TrackedObserver(NamedTuple):
    """How a policy sees and acts; arrays only, so that it passes through a compiled program."""

    noise: TrackerNoise
    """What the tracker believes."""
    frames: Array
    """Ones, shape (h,)."""
    sights: Array
    """Ones, shape (s,)."""
    transition: Array
    """Of the history, shape (d, d)."""
    push: Array
    """Of the history, shape (d,)."""
    action_scale: Array
    """Offset from the aim per unit of action, pitch and yaw [rad], shape (2,)."""
    braking: Array
    """By how much the command's move per decision may change from one to the next, pitch and yaw [rad], shape (2,)."""
    muzzle: Muzzle
    """The muzzle that the aim is computed for."""

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        moves = self.frames.shape[0] - 1
        return int(16 + 4 * moves + 7 + self.sights.shape[0] + self.push.shape[0])

    def begin(self, seen: Seen) -> TrackedMemory:
        """Return the memory at the beginning of an engagement, as if nothing had moved before it."""
        xp = namespace(seen.angle, seen.plate)
        plate = seen.plate[..., 0, :]
        bearing = _bearing(plate)
        many = self.frames.shape[0]
        return TrackedMemory(
            begin_track(self.noise, plate, seen.fresh[..., 0]),
            seen.plate_age[..., 0],
            seen.gimbal_age,
            xp.stack([seen.angle] * many, axis=-2),
            xp.stack([seen.command] * many, axis=-2),
            xp.stack([bearing] * self.sights.shape[0], axis=-1),
            constant_history(bearing, self.push),
            0.0 * bearing,
        )

    def remember(self, memory: TrackedMemory, seen: Seen) -> TrackedMemory:
        """Take in what is seen now."""
        xp = namespace(memory.angle, seen.angle)
        plate, age = seen.plate[..., 0, :], seen.plate_age[..., 0]
        track = predict(self.noise, memory.track, memory.plate_age + seen.elapsed - age)
        track = update(self.noise, track, plate, seen.fresh[..., 0] & (seen.elapsed > 0.0))
        bearing = _bearing(plate)
        later = (seen.elapsed > 0.0)[..., None]
        sights = xp.concat([memory.bearing[..., 1:], bearing[..., None]], axis=-1)
        return TrackedMemory(
            track,
            age,
            seen.gimbal_age,
            _pushed(memory.angle, seen.angle, later),
            _pushed(memory.command, seen.command, later),
            xp.where(later, sights, memory.bearing),
            xp.where(later, with_sample(self.transition, self.push, memory.history, bearing), memory.history),
            memory.clock + seen.elapsed,
        )

    def observe(self, memory: TrackedMemory) -> Array:
        """Build the observation, shape B + (size,)."""
        xp = namespace(memory.angle)
        aim, place = self._aim(memory)
        distance = xp.sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)[..., None]
        bearing = _bearing(place)[..., None]
        error = aim - memory.angle[..., -1, :]
        rest = overshoot(self.braking, aim, memory.command[..., -1, :], memory.command[..., -2, :])
        asked = memory.command - memory.angle
        level = memory.track.mean[..., 2:]
        sight = place[..., :2] / distance
        across = sight[..., :1] * level[..., 1:] - sight[..., 1:] * level[..., :1]
        away = xp.sum(sight * level, axis=-1, keepdims=True)
        ages = xp.stack([memory.plate_age, memory.gimbal_age], axis=-1) / _TYPICAL_AGE_S
        history = memory.history - constant_history(bearing[..., 0], self.push)
        flat = (*memory.clock.shape, -1)
        return xp.concat(
            [
                2.0 * error,
                xp.tanh(_FINE / 3.0 * error),
                2.0 * aim,
                0.5 * (distance - 3.0),
                5.0 * across,
                2.0 * rest,
                xp.tanh(_FINE / 3.0 * rest),
                xp.reshape(2.0 * asked[..., -2:, :], flat),
                xp.reshape(10.0 * _differences(memory.angle), flat),
                xp.reshape(2.0 * _differences(memory.command), flat),
                5.0 * away,
                ages,
                memory.clock[..., None],
                xp.tanh(4.0 * memory.clock[..., None]),
                0.3 / distance,
                _FINE * (memory.bearing[..., -1:] - bearing),
                _METRES * distance * (memory.bearing - bearing),
                0.5 * _METRES * distance * history,
            ],
            axis=-1,
        )

    def decode(self, memory: TrackedMemory, action: Array) -> Array:
        """Turn an action, shape B + (2,), into a pitch and yaw command [rad]; zero aims at where the target is now."""
        wanted = self._aim(memory)[0] + lift(self.action_scale, action) * action
        return on_the_way(self.braking, wanted, memory.command[..., -1, :])

    def _aim(self, memory: TrackedMemory) -> tuple[Array, Array]:
        place = position_after(memory.track, memory.plate_age)
        return aim_at(place, self.muzzle).angle, place


def tracked_observer(
    muzzle: Muzzle, noise: TrackerNoise, period_s: float, action_scale: tuple[float, float], braking: Array
) -> TrackedObserver:
    """Build an observer.

    Args:
      muzzle: the muzzle to aim with.
      noise: what the tracker believes.
      period_s: decision period [s].
      action_scale: offset of the command from the aim per unit of action, pitch and yaw [rad].
      braking: by how much the limits let the command's move per decision change, pitch and yaw [rad], shape (2,).
    """
    transition, push = legendre_matrices(ORDER, WINDOW_S, period_s)
    return TrackedObserver(
        noise, np.ones(FRAMES), np.ones(SIGHTS), transition, push, np.array(action_scale), braking, muzzle
    )


def _bearing(place: Array) -> Array:
    return namespace(place).atan2(place[..., 1], place[..., 0])


def _pushed(series: Array, newest: Array, later: Array) -> Array:
    xp = namespace(series, newest)
    return xp.where(later[..., None], xp.concat([series[..., 1:, :], newest[..., None, :]], axis=-2), series)


def _differences(series: Array) -> Array:
    return series[..., 1:, :] - series[..., :-1, :]

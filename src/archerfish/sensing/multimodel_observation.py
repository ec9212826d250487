"""What a policy sees of targets that move in any way: several trackers side by side, and two memories.

No one tracker fits a target that may stand, drive on, turn back or swing. So the policy gets what several make of the
same sights: a Kalman filter that follows turns (fast), one that averages for long (slow), with the size of its recent
innovations, which says whether to believe it; and interacting models with the probabilities that the target stands,
drives on or has turned back. Two Legendre memories hold the bearings of the last second and of the last three, in
which a target's habits show, and one the distances of the last second. Where small values decide, as whether a target
moves at all, they come once more on a fine scale.

The action is an offset from the aim at where the fast filter takes the target to be now, as in `tracked_observation`.
"""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.aiming import Aim, aim_at
from archerfish.dynamics.array_namespace import Array, lift, namespace, without_gradient
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interacting_models import (
    ONWARD,
    STILL,
    TURNED,
    ModelRates,
    ModelTracks,
    begin_models,
    step_models,
)
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import (
    Track,
    TrackerNoise,
    begin_track,
    inverse_and_determinant,
    measurement_covariance,
    position_after,
    predict,
    update,
)
from archerfish.sensing.legendre_memory import constant_history, legendre_matrices, with_sample
from archerfish.sensing.multimodel_layout import multimodel_layout
from archerfish.sensing.stopping_way import on_the_way, overshoot

FRAMES, SIGHTS = 4, 8
"""Remembered moves of gimbal and command; raw sights."""
WINDOWS = {"bearing": (12, 1.0), "distance": (6, 1.0), "habit": (14, 3.0)}
"""Memory → Legendre coefficients, and its length [s]."""
FAST_ACCELERATION, SLOW_ACCELERATION = 4.0, 0.2
"""What the trackers believe of a target's acceleration, as a standard deviation [m/s²]."""
EXACT_SIGHT_SD = 5e-4
"""What they believe of a camera without noise [m]."""
RATES = ModelRates(np.asarray(0.25), np.asarray(0.1), np.asarray(0.5))
"""Of the interacting models: turns and stops [1/s], share of the targets that stand at first."""
LEAD_S = 0.06
"""From a decision until its pellet leaves the muzzle [s], about: for the slow tracker's intercept."""
_FINE, _METRES, _TYPICAL_AGE_S, _FORGETTING, _LARGEST = 100.0, 20.0, 0.05, 0.2, 50.0


class MultimodelMemory(NamedTuple):
    """What is remembered between decisions."""

    fast: Track
    """The target as of the latest exposure, by the tracker that follows turns."""
    slow: Track
    """The same by the one that averages for long."""
    innovation: Array
    """Mean of the slow tracker's last squared innovations, one where it is right, shape B."""
    models: ModelTracks
    """The same by interacting models."""
    plate_age: Array
    """How long ago the latest exposure was [s], shape B."""
    gimbal_age: Array
    """Age of the latest feedback [s], shape B."""
    angle: Array
    """Gimbal's angles, the newest last [rad], shape B + (h, 2)."""
    command: Array
    """Commands in force, the newest last [rad], shape B + (h, 2)."""
    bearing: Array
    """Azimuths of the last sights, the newest last [rad], shape B + (s,)."""
    distance: Array
    """Their distances [m], shape B + (s,)."""
    last_second: Array
    """Legendre coefficients of the azimuth [rad], shape B + (d,)."""
    last_distances: Array
    """The same of the distance [m], shape B + (d,)."""
    habit: Array
    """The same of the azimuth over three seconds [rad], shape B + (d,)."""
    clock: Array
    """Since the first sight [s], shape B."""


class LegendreWindow(NamedTuple):
    """A memory of fixed length."""

    transition: Array
    """Shape (d, d)."""
    push: Array
    """Shape (d,)."""


class MultimodelObserver(NamedTuple):
    """How a policy sees and acts; arrays only, so that it passes through a compiled program."""

    noise: TrackerNoise
    """What the fast tracker and the models believe."""
    slow_noise: TrackerNoise
    """What the slow tracker believes."""
    rates: ModelRates
    """Of changes between the models."""
    frames: Array
    """Ones, shape (h,)."""
    sights: Array
    """Ones, shape (s,)."""
    last_second: LegendreWindow
    """Of the azimuth."""
    last_distances: LegendreWindow
    """Of the distance."""
    habit: LegendreWindow
    """Of the azimuth over three seconds."""
    action_scale: Array
    """Offset from the aim per unit of action, pitch and yaw [rad], shape (2,)."""
    braking: Array
    """By how much the command's move per decision may change from one to the next, pitch and yaw [rad], shape (2,)."""
    muzzle: Muzzle
    """The muzzle that the aim is computed for."""

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return sum(count for _, count in self.layout)

    @property
    def layout(self) -> list[tuple[str, int]]:
        """Name and size of the blocks of an observation."""
        orders = (each.push.shape[0] for each in (self.last_second, self.last_distances, self.habit))
        return multimodel_layout(self.frames.shape[0] - 1, self.sights.shape[0], *orders)

    def begin(self, seen: Seen) -> MultimodelMemory:
        """Return the memory at the beginning of an engagement, as if nothing had moved before it."""
        xp = namespace(seen.angle, seen.plate)
        plate, shown = without_gradient(seen.plate[..., 0, :]), seen.fresh[..., 0]
        bearing, distance = _polar(plate)
        frames, sights = self.frames.shape[0], self.sights.shape[0]
        return MultimodelMemory(
            fast=begin_track(self.noise, plate, shown),
            slow=begin_track(self.slow_noise, plate, shown),
            innovation=1.0 + 0.0 * bearing,
            models=begin_models(self.noise, self.rates, plate, shown),
            plate_age=seen.plate_age[..., 0],
            gimbal_age=seen.gimbal_age,
            angle=xp.stack([seen.angle] * frames, axis=-2),
            command=xp.stack([seen.command] * frames, axis=-2),
            bearing=xp.stack([bearing] * sights, axis=-1),
            distance=xp.stack([distance] * sights, axis=-1),
            last_second=constant_history(bearing, self.last_second.push),
            last_distances=constant_history(distance, self.last_distances.push),
            habit=constant_history(bearing, self.habit.push),
            clock=0.0 * bearing,
        )

    def remember(self, memory: MultimodelMemory, seen: Seen) -> MultimodelMemory:
        """Take in what is seen now."""
        xp = namespace(memory.angle, seen.angle)
        # What is seen hardly depends on what was commanded: no gradient goes back through the trackers.
        plate, age = without_gradient(seen.plate[..., 0, :]), seen.plate_age[..., 0]
        elapsed, fresh = memory.plate_age + seen.elapsed - age, seen.fresh[..., 0] & (seen.elapsed > 0.0)
        bearing, distance = _polar(plate)
        later = (seen.elapsed > 0.0)[..., None]
        slow = predict(self.slow_noise, memory.slow, elapsed)
        off = xp.minimum(_squared_innovation(self.slow_noise, slow, plate), _LARGEST) - memory.innovation

        def kept(window: LegendreWindow, coefficients: Array, sample: Array) -> Array:
            return xp.where(later, with_sample(*window, coefficients, sample), coefficients)

        def pushed(series: Array, newest: Array) -> Array:
            return xp.where(later, xp.concat([series[..., 1:], newest[..., None]], axis=-1), series)

        return MultimodelMemory(
            fast=update(self.noise, predict(self.noise, memory.fast, elapsed), plate, fresh),
            slow=update(self.slow_noise, slow, plate, fresh),
            innovation=xp.where(fresh, memory.innovation + _FORGETTING * off, memory.innovation),
            models=step_models(self.noise, self.rates, memory.models, elapsed, plate, fresh),
            plate_age=age,
            gimbal_age=seen.gimbal_age,
            angle=_pushed(memory.angle, seen.angle, later),
            command=_pushed(memory.command, seen.command, later),
            bearing=pushed(memory.bearing, bearing),
            distance=pushed(memory.distance, distance),
            last_second=kept(self.last_second, memory.last_second, bearing),
            last_distances=kept(self.last_distances, memory.last_distances, distance),
            habit=kept(self.habit, memory.habit, bearing),
            clock=memory.clock + seen.elapsed,
        )

    def observe(self, memory: MultimodelMemory) -> Array:
        """Build the observation, shape B + (size,), as `multimodel_layout` says."""
        xp = namespace(memory.angle)
        aim, place = self._aim(memory)
        distance = xp.sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)[..., None]
        sight = _Sight(place[..., :2] / distance)
        return xp.concat(
            [
                *self._slew(memory, aim, distance),
                *self._fast(memory, place, distance, sight),
                *self._models(memory, place, sight),
                *self._slow(memory, aim, place, distance, sight),
            ],
            axis=-1,
        )

    def decode(self, memory: MultimodelMemory, action: Array) -> Array:
        """Turn an action, shape B + (2,), into a pitch and yaw command [rad]; zero aims at where the target is now."""
        return self.towards(memory, self.wanted(memory, action))

    def wanted(self, memory: MultimodelMemory, action: Array) -> Array:
        """Return the pitch and yaw that an action wants, wherever the command is now [rad], shape B + (2,)."""
        return self._aim(memory)[0] + lift(self.action_scale, action) * action

    def towards(self, memory: MultimodelMemory, wanted: Array) -> Array:
        """Return the next command on the fastest way to the wanted one that can stop there [rad], shape B + (2,)."""
        return on_the_way(self.braking, wanted, memory.command[..., -1, :])

    def intercepts(self, memory: MultimodelMemory, lead: Array) -> tuple[Aim, Aim]:
        """Return where to point if the target goes on at the fast tracker's velocity, and at the slow one's.

        Args:
          memory: what is remembered.
          lead: from now until the pellet leaves the muzzle [s], shape ().
        """
        age = memory.plate_age
        return self._intercept(memory.fast, age, lead), self._intercept(memory.slow, age, lead)

    def _intercept(self, track: Track, age: Array, lead: Array) -> Aim:
        return intercept(lambda time: position_after(track, age + time), lead + 0.0 * age, self.muzzle)

    def _aim(self, memory: MultimodelMemory) -> tuple[Array, Array]:
        place = position_after(memory.fast, memory.plate_age)
        return aim_at(place, self.muzzle).angle, place

    def _slew(self, memory: MultimodelMemory, aim: Array, distance: Array) -> list[Array]:
        """Compare gimbal and command with the aim; the ages of what is known."""
        xp = namespace(aim)
        flat = (*memory.clock.shape, -1)
        error = aim - memory.angle[..., -1, :]
        rest = overshoot(self.braking, aim, memory.command[..., -1, :], memory.command[..., -2, :])
        ages = xp.stack([memory.plate_age, memory.gimbal_age], axis=-1) / _TYPICAL_AGE_S
        return [
            2.0 * error,
            xp.tanh(_FINE / 3.0 * error),
            2.0 * aim,
            0.5 * (distance - 3.0),
            0.3 / distance,
            2.0 * rest,
            xp.tanh(_FINE / 3.0 * rest),
            xp.reshape(2.0 * (memory.command - memory.angle)[..., -2:, :], flat),
            xp.reshape(10.0 * _differences(memory.angle), flat),
            xp.reshape(2.0 * _differences(memory.command), flat),
            ages,
            memory.clock[..., None],
            xp.tanh(4.0 * memory.clock[..., None]),
        ]

    def _fast(self, memory: MultimodelMemory, place: Array, distance: Array, sight: "_Sight") -> list[Array]:
        """Return speeds by the fast tracker, and the last sights and the memories against its estimate."""
        xp = namespace(place)
        bearing = _polar(place)[0][..., None]
        across, away = sight.across(memory.fast.mean[..., 2:]), sight.away(memory.fast.mean[..., 2:])
        off = _METRES * distance * (memory.bearing - bearing)
        here, far = bearing[..., 0], distance[..., 0]
        return [
            5.0 * across,
            xp.tanh(3.0 * across),
            xp.tanh(10.0 * across),
            5.0 * away,
            xp.tanh(3.0 * away),
            xp.tanh(10.0 * away),
            _FINE * (memory.bearing[..., -1:] - bearing),
            off,
            xp.tanh(2.5 * off),
            4.0 * (memory.distance - distance),
            0.5 * _METRES * distance * (memory.last_second - constant_history(here, self.last_second.push)),
            2.0 * (memory.last_distances - constant_history(far, self.last_distances.push)),
            0.5 * _METRES * distance * (memory.habit - constant_history(here, self.habit.push)),
        ]

    def _models(self, memory: MultimodelMemory, place: Array, sight: "_Sight") -> list[Array]:
        """Return probabilities and speeds under the interacting models."""
        xp = namespace(place)
        chance, mean = memory.models.probability, memory.models.track.mean
        onward, turned = mean[..., ONWARD, 2:], mean[..., TURNED, 2:]
        off = mean[..., STILL, :2] - place[..., :2]
        still, drives, turns = (chance[..., index, None] for index in (STILL, ONWARD, TURNED))
        across = sight.across(onward)
        return [
            chance,
            0.3 * xp.log((still + _RARE) / (1.0 - still + _RARE)),
            0.3 * xp.log((turns + _RARE) / (drives + _RARE)),
            2.0 * across,
            xp.tanh(3.0 * across),
            xp.tanh(10.0 * across),
            2.0 * sight.away(onward),
            2.0 * sight.across(turned),
            2.0 * sight.away(turned),
            10.0 * sight.across(off),
            10.0 * sight.away(off),
        ]

    def _slow(
        self, memory: MultimodelMemory, aim: Array, place: Array, distance: Array, sight: "_Sight"
    ) -> list[Array]:
        """Compare the slow tracker with the fast one: its estimate, its aim, and whether it is right."""
        xp = namespace(place)
        slow = memory.slow
        off = position_after(slow, memory.plate_age)[..., :2] - place[..., :2]
        faster = slow.mean[..., 2:] - memory.fast.mean[..., 2:]
        lead = without_gradient(self._intercept(slow, memory.plate_age, LEAD_S).angle) - aim
        across = _METRES * sight.across(off)
        innovation = memory.innovation[..., None]
        return [
            across,
            xp.tanh(2.0 * across),
            5.0 * sight.across(faster),
            5.0 * sight.away(faster),
            5.0 * sight.across(slow.mean[..., 2:]),
            10.0 * lead,
            10.0 * distance * lead[..., 1:],
            xp.log(innovation),
            xp.tanh(0.25 * innovation),
        ]


_RARE = 1e-4
"""Smallest probability that its logarithm shows."""


class _Sight(NamedTuple):
    """The line of sight to the estimate."""

    direction: Array
    """Unit vector, shape B + (2,)."""

    def across(self, level: Array) -> Array:
        """Return the part of a level vector to the left of the line of sight, shape B + (2,) → B + (1,)."""
        return self.direction[..., :1] * level[..., 1:] - self.direction[..., 1:] * level[..., :1]

    def away(self, level: Array) -> Array:
        """Return the part along it, shape B + (2,) → B + (1,)."""
        return namespace(level).sum(self.direction * level, axis=-1, keepdims=True)


def multimodel_observer(
    muzzle: Muzzle, noise: TrackerNoise, period_s: float, action_scale: tuple[float, float], braking: Array
) -> MultimodelObserver:
    """Build an observer.

    Args:
      muzzle: the muzzle to aim with.
      noise: what the fast tracker believes, and of the camera all of them.
      period_s: decision period [s].
      action_scale: offset of the command from the aim per unit of action, pitch and yaw [rad].
      braking: by how much the limits let the command's move per decision change, pitch and yaw [rad], shape (2,).
    """
    windows = {name: LegendreWindow(*legendre_matrices(*each, period_s)) for name, each in WINDOWS.items()}
    return MultimodelObserver(
        noise=noise,
        slow_noise=noise._replace(acceleration=np.asarray(SLOW_ACCELERATION)),
        rates=RATES,
        frames=np.ones(FRAMES),
        sights=np.ones(SIGHTS),
        last_second=windows["bearing"],
        last_distances=windows["distance"],
        habit=windows["habit"],
        action_scale=np.array(action_scale),
        braking=braking,
        muzzle=muzzle,
    )


def _polar(place: Array) -> tuple[Array, Array]:
    """Return azimuth [rad] and level distance [m] of places, shape B each."""
    xp = namespace(place)
    return xp.atan2(place[..., 1], place[..., 0]), xp.sqrt(place[..., 0] ** 2 + place[..., 1] ** 2)


def _squared_innovation(noise: TrackerNoise, track: Track, plate: Array) -> Array:
    """Return a sight's squared distance from a track, in its standard deviations and per coordinate, shape B."""
    xp = namespace(plate)
    inverse, _ = inverse_and_determinant(track.covariance[..., :2, :2] + measurement_covariance(noise, plate))
    innovation = plate[..., :2] - track.mean[..., :2]
    return 0.5 * xp.sum(innovation * xp.sum(inverse * innovation[..., None, :], axis=-1), axis=-1)


def _pushed(series: Array, newest: Array, later: Array) -> Array:
    xp = namespace(series, newest)
    return xp.where(later[..., None], xp.concat([series[..., 1:, :], newest[..., None, :]], axis=-2), series)


def _differences(series: Array) -> Array:
    return series[..., 1:, :] - series[..., :-1, :]

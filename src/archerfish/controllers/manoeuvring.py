"""Where a target that may turn back will be: interacting models, and the place that a pellet most likely meets.

Until the pellet arrives the target may turn back once more, at any moment, so it is in one of several places.
"""

from typing import NamedTuple

from archerfish.controllers.hit_window import across_sight, most_hits
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.sensing.interacting_models import ModelRates, ModelTracks, begin_models, step_models
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import Track, TrackerNoise

TURNS = 5
"""Moments within the prediction that stand for all at which the target may turn back."""


class ManoeuvringTrack(NamedTuple):
    """Estimates as of the latest exposure."""

    models: ModelTracks
    """Estimates then."""
    age: Array
    """How long ago that was at the latest decision [s], shape B."""


class Ways(NamedTuple):
    """What the target may do until a time: W ways."""

    chance: Array
    """Of each, shape B + (W,)."""
    place: Array
    """Mean x and y at the end [m], shape B + (W, 2)."""
    model: Array
    """Model that it begins with, shape (W,)."""
    drive: Array
    """For how long it drives on in all, less than the time where it turns back [s], shape B + (W,)."""


class Manoeuvring(NamedTuple):
    """A predictor for a target that stands, drives on, or turns back at unknown times and places."""

    noise: TrackerNoise
    """What the filters believe of target and camera."""
    rates: ModelRates
    """Of changes between the models."""
    reach: Array
    """Hit radius [m], shape ()."""
    scatter: Array
    """Standard deviation of the pellets' azimuth [rad], shape ()."""

    def reset(self, seen: Seen) -> ManoeuvringTrack:
        """Begin at the first sight."""
        models = begin_models(self.noise, self.rates, seen.plate[..., 0, :], seen.fresh[..., 0])
        return ManoeuvringTrack(models, seen.plate_age[..., 0])

    def step(self, state: ManoeuvringTrack, seen: Seen) -> ManoeuvringTrack:
        """Take in what is seen now."""
        age, fresh = seen.plate_age[..., 0], seen.fresh[..., 0] & (seen.elapsed > 0.0)
        elapsed = state.age + seen.elapsed - age
        models = step_models(self.noise, self.rates, state.models, elapsed, seen.plate[..., 0, :], fresh)
        return ManoeuvringTrack(models, age)

    def mean_after(self, state: ManoeuvringTrack, time: Array) -> Array:
        """Return the mean of all places where the target may be, shape B + (3,)."""
        ways = self._ways(state.models, state.age + time)
        return _with_height(_mean(ways), state.models.track)

    def position_after(self, state: ManoeuvringTrack, time: Array) -> Array:
        """Return the place that a pellet most likely meets, shape B + (3,)."""
        xp = namespace(state.age, time)
        ways = self._ways(state.models, state.age + time)
        center = _mean(ways)
        left, distance = across_sight(center)
        lateral = xp.sum((ways.place - center[..., None, :]) * left[..., None, :], axis=-1)
        variance = _lateral_variance(state.models.track, ways, left) + (self.scatter * distance)[..., None] ** 2
        aim = most_hits(lateral, xp.sqrt(variance), self.reach, ways.chance)
        return _with_height(center + aim[..., None] * left, state.models.track)

    def _ways(self, models: ModelTracks, time: Array) -> Ways:
        """Return what may happen: a target that stands stays, and one that moves drives on or turns back once."""
        xp = namespace(models.probability, time)
        moments = (xp.arange(TURNS, dtype=time.dtype) + 0.5) / TURNS
        turned = (1.0 - xp.exp(-self.rates.turn * time))[..., None]
        # Given one turn, all its moments are as likely as each other.
        split = xp.concat([1.0 - turned] + [turned / TURNS] * TURNS, axis=-1)
        share = xp.concat([xp.ones(1, dtype=time.dtype), 2.0 * moments - 1.0])
        drive = time[..., None] * lift(share, turned)
        still, onward, reverse = (models.probability[..., index, None] for index in range(3))
        chance = xp.concat([still + 0.0 * turned, onward * split, reverse * split], axis=-1)
        drive = xp.concat([0.0 * turned, drive, drive], axis=-1)
        model = xp.asarray([0] + [1] * (TURNS + 1) + [2] * (TURNS + 1))
        mean = xp.take(models.track.mean, model, axis=-2)
        return Ways(chance, mean[..., :2] + drive[..., None] * mean[..., 2:], model, drive)


def _mean(ways: Ways) -> Array:
    return namespace(ways.place).sum(ways.chance[..., None] * ways.place, axis=-2)


def _lateral_variance(track: Track, ways: Ways, left: Array) -> Array:
    """Variance of the place across the line of sight at the end of each way [m²], shape B + (W,)."""
    xp = namespace(track.covariance, left)
    outer = (left[..., :, None] * left[..., None, :])[..., None, :, :]
    p = track.covariance
    blocks = (p[..., :2, :2], p[..., :2, 2:], p[..., 2:, 2:])
    place, corner, speed = (xp.take(xp.sum(outer * each, axis=(-2, -1)), ways.model, axis=-1) for each in blocks)
    return place + ways.drive * (2.0 * corner + ways.drive * speed)


def _with_height(level: Array, track: Track) -> Array:
    height = track.height[..., :1]
    return namespace(level).concat([level, height + 0.0 * level[..., :1]], axis=-1)

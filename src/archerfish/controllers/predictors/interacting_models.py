"""Interacting multiple models (IMM): a predictor for a target that may turn back.

Until the pellet arrives the target may turn back once more, at any moment, so it is in one of several places.
"""

from archerfish.arrays import Array, lift, namespace, tree
from archerfish.controllers.predictors.likeliest_hit import LikeliestHit, Places
from archerfish.controllers.predictors.predictor import AgedTrack
from archerfish.protocols import Seen
from archerfish.tracking.detections import Detection, first_detection
from archerfish.tracking.interacting_models import ModelRates, begin_models, moved_models, step_models
from archerfish.tracking.kalman_filter import TrackerNoise

TURNS = 5
"""Moments within the prediction that stand for all at which the target may turn back."""


@tree()
class InteractingModels(LikeliestHit):
    """A predictor for a target that stands, drives on, or turns back at unknown times and places."""

    noise: TrackerNoise  # what the filters assume of target and camera
    rates: ModelRates  # of changes between the models
    reach: Array  # hit radius [m], ()
    scatter: Array  # standard deviation of the pellets' azimuth [rad], ()

    def reset(self, seen: Seen) -> AgedTrack:
        """Begin at the first decision."""
        first = first_detection(seen)
        models = begin_models(self.noise, self.rates, first.place - first.own, first.fresh)
        return AgedTrack(moved_models(models, first.own), first.age)

    def update(self, state: AgedTrack, seen: Detection) -> AgedTrack:
        """Update with a detection."""
        age = namespace(state.age).where(seen.fresh, seen.age, state.age)
        models, place = moved_models(state.track, -seen.own), seen.place - seen.own
        models = step_models(self.noise, self.rates, models, state.age - age, place, seen.fresh)
        return AgedTrack(moved_models(models, seen.own), age)

    def places(self, state: AgedTrack, time: Array) -> Places:
        """Return where the target may be a time [s] from now, shape B.

        One that stands stays, one that moves drives on or turns back once.
        """
        xp = namespace(state.age, time)
        time = state.age + time
        track, probability = state.track
        moments = (xp.arange(TURNS, dtype=time.dtype) + 0.5) / TURNS
        turned = (1.0 - xp.exp(-self.rates.turn * time))[..., None]
        # Given one turn, all its moments are as likely as each other.
        split = xp.concat([1.0 - turned] + [turned / TURNS] * TURNS, axis=-1)
        # For how long it drives on in all, less than the time where it turns back.
        share = xp.concat([xp.ones(1, dtype=time.dtype), 2.0 * moments - 1.0])
        drive = time[..., None] * lift(share, turned)
        drive = xp.concat([0.0 * turned, drive, drive], axis=-1)
        still, onward, reverse = (probability[..., index, None] for index in range(3))
        probability = xp.concat([still + 0.0 * turned, onward * split, reverse * split], axis=-1)
        model = xp.asarray([0] + [1] * (TURNS + 1) + [2] * (TURNS + 1))
        mean = xp.take(track.mean, model, axis=-2)

        def variance(left: Array) -> Array:
            outer = (left[..., :, None] * left[..., None, :])[..., None, :, :]

            def along(block: Array) -> Array:
                return xp.take(xp.sum(outer * block, axis=(-2, -1)), model, axis=-1)

            p = track.covariance
            place, corner, speed = along(p[..., :2, :2]), along(p[..., :2, 2:]), along(p[..., 2:, 2:])
            return place + drive * (2.0 * corner + drive * speed)

        level = mean[..., :2] + drive[..., None] * mean[..., 2:]
        return Places(level, track.height[..., :1], variance, probability)

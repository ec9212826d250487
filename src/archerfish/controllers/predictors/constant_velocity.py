"""A target of nearly constant velocity, estimated by a Kalman filter: the predictor of classical auto-aim."""

from archerfish.arrays import Array, namespace, tree
from archerfish.controllers.predictors.predictor import AgedTrack, Predictor
from archerfish.protocols import Base, Seen
from archerfish.tracking import kalman_filter
from archerfish.tracking.detections import Detection, first_detection
from archerfish.tracking.kalman_filter import TrackerNoise, moved


@tree()
class ConstantVelocity(Predictor):
    """A Kalman filter for nearly constant velocity; its estimate at the latest detection is predicted onwards."""

    noise: TrackerNoise  # of target and camera
    velocity_decay: Array  # share of the estimated velocity at which the target is predicted to go on, 0…1, ()

    def reset(self, seen: Seen) -> AgedTrack:
        """Begin at the first decision."""
        first = first_detection(seen)
        track = kalman_filter.begin_track(self.noise, first.place - first.own, first.fresh)
        return AgedTrack(moved(track, first.own), first.age)

    def against_pivot(self, state: AgedTrack, base: Base) -> AgedTrack:
        """Return the estimate relative to the own pivot."""
        return AgedTrack(kalman_filter.against_pivot(state.track, base, state.age), state.age)

    def position_after(self, state: AgedTrack, time: Array) -> Array:
        """Predict the position [m] a time [s] from now, shape B → B + (3,)."""
        return kalman_filter.position_after(state.track, state.age + time, self.velocity_decay)

    def predicted(self, state: AgedTrack, age: Array) -> Array:
        """Return where the target was so long [s] before now, in O [m], shape B → B + (3,)."""
        return kalman_filter.position_after(state.track, state.age - age)

    def update(self, state: AgedTrack, seen: Detection) -> AgedTrack:
        """Update with a detection."""
        # The choice is made for the age, not for the elapsed time, which a compiler would choose again for every entry
        # of the covariance.
        age = namespace(state.age).where(seen.fresh, seen.age, state.age)
        track = moved(kalman_filter.predict(self.noise, state.track, state.age - age), -seen.own)
        after = kalman_filter.update(self.noise, track, seen.place - seen.own, seen.fresh)
        return AgedTrack(moved(after, seen.own), age)

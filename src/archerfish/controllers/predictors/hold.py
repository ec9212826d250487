"""A target that stays where it is seen: no lead."""

from archerfish.arrays import Array, namespace, tree
from archerfish.controllers.predictors.predictor import AgedTrack, Predictor
from archerfish.protocols import Base, Seen
from archerfish.tracking.detections import Detection, first_detection, relative_place


@tree()
class Hold(Predictor):
    """A predictor for a target that stays where it is seen: no lead. Its track is the place in O."""

    def reset(self, seen: Seen) -> AgedTrack:
        """Begin at the first decision."""
        first = first_detection(seen)
        return AgedTrack(first.place, first.age)

    def update(self, state: AgedTrack, seen: Detection) -> AgedTrack:
        """Take a detection as it is."""
        return AgedTrack(seen.place, namespace(seen.age).where(seen.fresh, seen.age, state.age))

    def predicted(self, state: AgedTrack, age: Array) -> Array:  # noqa: ARG002
        """Return the place as seen last, in O [m], shape B + (3,)."""
        return state.track

    def position_after(self, relative: tuple[AgedTrack, Base], time: Array) -> Array:
        """Return the place as seen last, relative to the own pivot [m], shape B + (3,)."""
        return relative_place(relative[0].track, relative[1], time)

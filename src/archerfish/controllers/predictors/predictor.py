"""What a predictor is: it tracks a target, and predicts where the target will be when a pellet arrives."""

from typing import Any, NamedTuple, Protocol

from archerfish.arrays import Array
from archerfish.protocols import Base, Seen
from archerfish.tracking.detections import Detection, update_with_frames


class Predictor(Protocol):
    """Tracks a target and predicts where it will be; any predictor serves any law of aiming.

    The state of a predictor is a NamedTuple with the `age` of the latest detection. The methods that have a body here
    need no more of it.
    """

    def reset(self, seen: Seen) -> Any:
        """Begin at the first decision."""

    def update(self, state: Any, seen: Detection) -> Any:
        """Update with a detection; one that is not fresh must leave the estimate as it is."""

    def predicted(self, state: Any, age: Array) -> Array:
        """Return where the target was so long [s] before now, in O [m], shape B → B + (3,)."""

    def step(self, state: Any, seen: Seen) -> Any:
        """Update with what is seen now."""
        return update_with_frames(self.update, self.predicted, state._replace(age=state.age + seen.elapsed), seen)

    def against_pivot(self, state: Any, base: Base) -> Any:
        """Return the argument of `position_after` and `mean_after`: what they need of the state and of the base.

        The own pivot is taken to go on at its velocity, which the pellets have, too.
        """
        return state, base

    def position_after(self, relative: Any, time: Array) -> Array:
        """Predict the position relative to the own pivot [m], shape B + (3,), a time [s] from now, shape B."""

    def mean_after(self, relative: Any, time: Array) -> Array:
        """Predict the mean position, shape B + (3,), near enough for the flight time where it is the cheaper one."""
        return self.position_after(relative, time)


class AgedTrack(NamedTuple):
    """An estimate as of the latest detection."""

    track: Any  # Track in O or relative to the own pivot; of `InteractingModels` ModelTracks, of `Hold` a place
    age: Array  # of that detection at the latest decision [s], B

"""Trackers side by side on the same detections: two Kalman filters, one quick and one slow, and interacting models.

No one tracker fits a target that may stand, drive on, turn back or swing. Each of them may be absent. Without the quick
filter, the target is taken to be at its latest detection.
"""

from typing import Any, NamedTuple

from archerfish.arrays import Array, namespace, select, without_gradient
from archerfish.protocols import Seen
from archerfish.tracking import kalman_filter
from archerfish.tracking.detections import Detection, first_detection, update_with_frames
from archerfish.tracking.interacting_models import ModelRates, begin_models, moved_models, step_models
from archerfish.tracking.kalman_filter import TrackerNoise

FORGETTING, LARGEST_INNOVATION = 0.2, 50.0
"""Share of the latest squared innovation in their mean, and its bound."""


class Tracks(NamedTuple):
    """Estimates in O as of the latest detection; None of trackers that are absent."""

    place: Array  # of that detection, B + (3,)
    own: Any  # the own pivot at its exposure, in O [m], B + (3,); None without the quick filter
    age: Array  # of it at the latest decision [s], B
    fast: Any  # Track
    slow: Any  # Track
    innovation: Any  # the slow filter's: means of squared innovations / variance, across and along, B + (2,)
    models: Any  # ModelTracks


class Trackers(NamedTuple):
    """What the trackers assume of target and camera; None where a tracker is absent."""

    fast: TrackerNoise | None = None  # of the filter that follows turns, and of the models
    slow: TrackerNoise | None = None  # of the filter that averages for long
    rates: ModelRates | None = None  # of the interacting models

    def begin(self, seen: Seen) -> Tracks:
        """Return the estimates at the first decision, shape B."""
        first, (fast, slow, rates) = first_detection(seen), self
        relative, shown = without_gradient(first.place) - first.own, first.fresh
        tracks = Tracks(
            first.place,
            fast and first.own,
            first.age,
            fast and kalman_filter.begin_track(fast, relative, shown),
            slow and kalman_filter.begin_track(slow, relative, shown),
            slow and 1.0 + 0.0 * relative[..., :2],
            fast and rates and begin_models(fast, rates, relative, shown),
        )
        return _moved(tracks, first.own)

    def update(self, tracks: Tracks, seen: Seen) -> Tracks:
        """Return the estimates at a later decision, or at the first one again, shape B."""
        before = tracks._replace(age=tracks.age + seen.elapsed)
        after: Tracks = update_with_frames(self._update, _predicted, before, seen)
        return after

    def _update(self, tracks: Tracks, seen: Detection) -> Tracks:
        """Update with a detection; one that is not fresh leaves everything as it is."""
        xp, (fast, slow, rates) = namespace(seen.age), self
        age, fresh = xp.where(seen.fresh, seen.age, tracks.age), seen.fresh
        # What is seen hardly depends on what was commanded: no gradient goes back through the trackers.
        relative, elapsed = without_gradient(seen.place) - seen.own, tracks.age - age
        before, innovation = _moved(tracks, -seen.own), tracks.innovation
        after: dict[str, Any] = {}
        if fast is not None:
            predicted = kalman_filter.predict(fast, before.fast, elapsed)
            after["fast"] = kalman_filter.update(fast, predicted, relative, fresh)
        if slow is not None:
            predicted = kalman_filter.predict(slow, before.slow, elapsed)
            after["slow"] = kalman_filter.update(slow, predicted, relative, fresh)
            difference, variance = kalman_filter.innovation_by_axis(slow, predicted, relative)
            square = xp.minimum(difference**2 / variance, LARGEST_INNOVATION)
            innovation = xp.where(fresh[..., None], innovation + FORGETTING * (square - innovation), innovation)
        if fast is not None and rates is not None:
            # Depth hardly matters for the aim, and a reversal there often leaves the sideways speed as it was.
            across = kalman_filter.log_likelihood_across
            models = before.models
            after["models"] = step_models(fast, rates, models, elapsed, relative, fresh, likelihood=across)
        place, own = select(fresh, (seen.place, fast and seen.own), (tracks.place, tracks.own))
        return _moved(before._replace(**after), seen.own)._replace(place=place, own=own, age=age, innovation=innovation)


def _predicted(tracks: Tracks, age: Array) -> Array:
    """Return where the target was so long [s] before now, in O [m], shape B → B + (3,)."""
    if tracks.fast is None:
        return tracks.place
    return kalman_filter.position_after(tracks.fast, tracks.age - age)


def _moved(tracks: Tracks, by: Array) -> Tracks:
    """Return the estimates against another origin; `by` is added to places [m], shape B + (3,)."""
    fast = tracks.fast and kalman_filter.moved(tracks.fast, by)
    slow = tracks.slow and kalman_filter.moved(tracks.slow, by)
    models = tracks.models and moved_models(tracks.models, by)
    return tracks._replace(fast=fast, slow=slow, models=models)

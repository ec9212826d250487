"""Classical auto-aim, the paper's baseline: a Kalman filter predicts the target, the intercept's angles are commanded.

It has no model of the gimbal's lag.
"""

from functools import partial
from typing import Any, NamedTuple, Protocol

from archerfish2.arrays import Array, namespace, select, tree
from archerfish2.dynamics.aiming import intercept
from archerfish2.dynamics.command_limits import CommandLimits
from archerfish2.dynamics.muzzle import Muzzle
from archerfish2.dynamics.slew import approach
from archerfish2.protocols import Base, Command, Seen, Truth, aim
from archerfish2.tracking import kalman_filter
from archerfish2.tracking.detections import Detection, first_detection, unwrapped, update_with_frames
from archerfish2.tracking.kalman_filter import Track, TrackerNoise, moved


class Predictor(Protocol):
    """Tracks a target and predicts where it will be; any predictor can serve any aiming controller.

    A state has the `age` of its latest detection; what has a body here serves every such state.
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
        """Return what predictions relative to the own pivot take, which goes on at its velocity, as do the pellets."""
        return state, base

    def position_after(self, relative: Any, time: Array) -> Array:
        """Predict the position relative to the own pivot [m], shape B + (3,), a time [s] from now, shape B."""

    def mean_after(self, relative: Any, time: Array) -> Array:
        """Predict the mean position, shape B + (3,), near enough for the flight time where it is the cheaper one."""
        return self.position_after(relative, time)


class AgedTrack(NamedTuple):
    """An estimate as of the latest detection."""

    track: Any  # Track in O, or relative to the own pivot; of `Hold` a place
    age: Array  # of that detection at the latest decision [s], B


@tree()
class ConstantVelocity(Predictor):
    """A Kalman filter for nearly constant velocity, of which the latest detection is predicted onwards."""

    noise: TrackerNoise  # of target and camera
    velocity_decay: Array  # share of the estimated velocity at which the target is predicted to go on, 0…1, ()
    gate: Array | None = None  # a detection farther from the prediction begins a new track [m], (); None: one plate

    def reset(self, seen: Seen) -> AgedTrack:
        """Begin at the first decision."""
        first = first_detection(seen)
        return AgedTrack(self._begin(first, first.fresh), first.age)

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
        """Update with a detection; beyond the gate begin with it."""
        # The age first: computed once, where a choice between elapsed times is repeated for each entry of a matrix.
        age = namespace(state.age).where(seen.fresh, seen.age, state.age)
        track = moved(kalman_filter.predict(self.noise, state.track, state.age - age), -seen.own)
        after = moved(kalman_filter.update(self.noise, track, seen.place - seen.own, seen.fresh), seen.own)
        if self.gate is not None:
            after = select(seen.fresh & (seen.distance > self.gate), self._begin(seen, seen.fresh | True), after)
        return AgedTrack(after, age)

    def _begin(self, seen: Detection, shown: Array) -> Track:
        return moved(kalman_filter.begin_track(self.noise, seen.place - seen.own, shown), seen.own)


@tree()
class DirectAim:
    """Commands the intercept's angles; with a Kalman filter as predictor, the paper's baseline."""

    predictor: Any  # Predictor
    muzzle: Muzzle  # for drop, drag and flight time
    limits: CommandLimits  # the slew to the aim keeps them, so that it can stop there
    lead: Array  # from a decision until the pellet leaves the muzzle [s], ()
    period: Array  # decision period [s], ()
    patience: Array | None = None  # no fire after so long without a detection [s], (); None: fires at every decision

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:  # noqa: ARG002
        """Begin tracking."""
        return self.predictor.reset(seen)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide."""
        state = self.predictor.step(state, seen)
        relative = self.predictor.against_pivot(state, seen.base)
        lead = 0.0 * seen.elapsed + self.lead
        angle = intercept(partial(self.predictor.position_after, relative), lead, self.muzzle).angle
        rate, acceleration = self.limits.max_rate, self.limits.max_acceleration
        command = aim(approach(unwrapped(angle, seen.command), seen.command, rate, acceleration, self.period))
        if self.patience is not None:
            command = command._replace(fire=state.age < self.patience)
        return state, command

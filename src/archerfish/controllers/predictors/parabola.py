"""Targets of eq (7): two predictors that are given its rule, but not a target's speed, phase and middle.

From exact detections `ParabolaAware` computes the rest within a few frames. From noisy ones `ParabolaFilter` estimates
it, as a Bayes filter.
"""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, namespace, select, tree
from archerfish.controllers.predictors.likeliest_hit import LikeliestHit, Places
from archerfish.controllers.predictors.predictor import Predictor
from archerfish.protocols import Base, Seen
from archerfish.targets.motion import triangle_wave
from archerfish.task import Task
from archerfish.tracking import parabola_filter
from archerfish.tracking.detections import Detection, first_detection, relative_place
from archerfish.tracking.kalman_filter import TrackerNoise
from archerfish.tracking.parabola_filter import Hypotheses, ParabolaRule


class ParabolaTrack(NamedTuple):
    """Estimate of a target."""

    first: Array  # first position seen, in O [m], B + (3,)
    plate: Array  # latest position, in O [m], B + (3,)
    products: Array  # sum of g y over the frames, B
    squares: Array  # sum of y² over the frames, B
    speed: Array  # lateral speed [m/s], B
    frames: Array  # that the speed is a mean of, B
    heading: Array  # 1 moving left, −1 moving right, B
    age: Array  # of the latest detection at the latest decision [s], B


@tree()
class ParabolaAware(Predictor):
    """A predictor for targets of eq (7) whose curvature and width are given, but not the vertex.

    With x and y counted from the first position seen, eq (7) reads x − c y² = 2 c (y_first − Y₀) y: a line through the
    origin whose slope gives the vertex by least squares over all frames. The lateral speed is constant but for its
    sign.
    """

    curvature: Array  # c [1/m], ()
    half_width: Array  # distance from the vertex at which the target turns back [m], ()

    def reset(self, seen: Seen) -> ParabolaTrack:
        """Begin at the first decision."""
        first = first_detection(seen)
        zero = 0.0 * first.age
        return ParabolaTrack(first.place, first.place, zero, zero, zero, zero, zero + 1.0, first.age)

    def position_after(self, relative: tuple[ParabolaTrack, Base], time: Array) -> Array:
        """Follow the parabola and turn back at its ends; relative to the own pivot [m], shape B + (3,)."""
        return relative_place(self._follow(relative[0], relative[0].age + time), relative[1], time)

    def predicted(self, state: ParabolaTrack, age: Array) -> Array:
        """Return where the target was so long [s] before now, in O [m], shape B → B + (3,)."""
        return self._follow(state, state.age - age)

    def _follow(self, state: ParabolaTrack, time: Array) -> Array:
        """Place in O [m] a time [s] after the latest detection, shape B → B + (3,)."""
        xp = namespace(state.plate, time)
        width = self.half_width
        offset = xp.clip(state.plate[..., 1] - self._vertex_lateral(state), -width, width)
        ahead = (state.heading * offset + state.speed * time) / (4.0 * width) + 0.25
        later = state.heading * width * triangle_wave(ahead)
        forward = self.curvature * (later**2 - offset**2)
        return state.plate + xp.stack([forward, later - offset, 0.0 * forward], axis=-1)

    def update(self, before: ParabolaTrack, seen: Detection) -> ParabolaTrack:
        """Update with a detection."""
        xp = namespace(before.plate)
        elapsed = before.age - seen.age
        x, y = (seen.place[..., index] - before.first[..., index] for index in (0, 1))
        products = before.products + (x - self.curvature * y**2) * y
        state = before._replace(products=products, squares=before.squares + y**2)
        begin = state.plate[..., 1] - self._vertex_lateral(state)
        moved = seen.place[..., 1] - state.plate[..., 1]
        distance, expected = xp.abs(moved), state.speed * elapsed
        # Over the nearer end; the target turned there if that is nearer to what its speed suggests.
        end = xp.sign(2.0 * begin + moved)
        over_end = 2.0 * self.half_width - xp.abs(2.0 * begin + moved)
        turned = (xp.abs(over_end - expected) < xp.abs(distance - expected)) & (state.frames > 0.0)
        heading = xp.where(turned, -end, xp.where(distance > 0.0, xp.sign(moved), state.heading))
        # A turn within the first frame can't be noticed; it then shows less than the second, which counts alone.
        frames = xp.where((state.frames == 1.0) & (distance > expected), 0.0, state.frames) + ~turned
        rate = distance / xp.maximum(elapsed, 1e-6)
        speed = xp.where(turned, state.speed, state.speed + (rate - state.speed) / xp.maximum(frames, 1.0))
        after = ParabolaTrack(state.first, seen.place, *state[2:4], speed, frames, heading, seen.age)
        return select(seen.fresh, after, before)

    def _vertex_lateral(self, state: ParabolaTrack) -> Array:
        slope = state.products / (state.squares + 1e-12)
        bound = 2.0 * self.curvature * self.half_width
        return state.first[..., 1] - namespace(slope).clip(slope, -bound, bound) / (2.0 * self.curvature)


@tree()
class ParabolaFilter(LikeliestHit):
    """A predictor for targets of eq (7) whose rule is given, but not speed, phase and middle."""

    rule: ParabolaRule
    noise: TrackerNoise  # of the camera; its part of the target is unused
    reach: Array  # hit radius [m], ()
    scatter: Array  # standard deviation of the pellets' azimuth [rad], ()

    def reset(self, seen: Seen) -> Hypotheses:
        """Begin at the first decision."""
        return parabola_filter.begin_hypotheses(self.rule, self.noise, first_detection(seen))

    def step(self, state: Hypotheses, seen: Seen) -> Hypotheses:
        """Update with what is seen now."""
        state = super().step(state, seen)
        return state._replace(drawn=parabola_filter.draw_hypotheses(self.rule, *state[:4]))

    def update(self, state: Hypotheses, seen: Detection) -> Hypotheses:
        """Update with a detection."""
        return parabola_filter.update_hypotheses(self.rule, self.noise, state, seen)

    def places(self, state: Hypotheses, time: Array) -> Places:
        """Return the place under each hypothesis that was drawn, a time [s] from now, shape B."""
        xp = namespace(state.age, time)
        speed, phase, *middle = (state.drawn[..., row, :] for row in range(4))
        depth, lateral = self.rule.against_middle(phase, speed, (state.clock + state.age + time)[..., None])

        def variance(left: Array) -> Array:
            outer = left[..., :, None] * left[..., None, :]
            return xp.sum(outer * state.covariance, axis=(-2, -1))[..., None]

        return Places(xp.stack([middle[0] + depth, middle[1] + lateral], axis=-1), state.height[..., None], variance)


def make_parabola_aware(task: Task) -> ParabolaAware:
    """Build the predictor for exact detections of a task's targets."""
    return ParabolaAware(np.asarray(task.curvature_1_m), np.sqrt(np.asarray(task.rise_m / task.curvature_1_m)))

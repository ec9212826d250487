"""Targets of eq (7): two predictors that are given its rule, but not a target's speed, phase and middle.

The rule is the curve, the width within which the target goes to and fro, its largest speed, and where the middles lie.

From exact detections `ParabolaAware` computes the rest within a few frames. From noisy ones `ParabolaFilter` estimates
it, as a Bayes filter:

- Speeds and phases form a grid of hypotheses. Under each of them the target's place against the middle is known at any
  time. So the middle is Gaussian, and one Kalman gain serves all hypotheses.
- Both coordinates of a detection count: the depth shows how far from the middle the target is.
- A prediction takes a systematic sample of the hypotheses, which stands for all of them.
"""

from typing import Any, NamedTuple

import numpy as np

from archerfish2.arrays import Array, fold, lift, namespace, select, tree
from archerfish2.controllers.predictors.likeliest_hit import LikeliestHit, Places, distribution
from archerfish2.controllers.predictors.predictor import Predictor
from archerfish2.protocols import Base, Seen
from archerfish2.targets.motion import triangle_wave
from archerfish2.task import Task
from archerfish2.tracking import kalman_filter
from archerfish2.tracking.detections import Detection, first_detection, relative_place
from archerfish2.tracking.interacting_models import STILL_SHARE
from archerfish2.tracking.kalman_filter import TrackerNoise

SPEED_HYPOTHESES, PHASE_HYPOTHESES, HYPOTHESES_DRAWN = 48, 160, 96
"""Hypotheses of either kind, and how many are drawn to predict from. Finer ones change no hit rate by 0.1 points."""


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

    def update(self, before: ParabolaTrack, seen: Detection) -> Any:
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


class Hypotheses(NamedTuple):
    """Estimate of one target, in O; V speeds and P phases."""

    depth: Array  # mean of X₀ under each hypothesis [m], B + (V, P)
    lateral: Array  # mean of Y₀ under each [m], B + (V, P)
    evidence: Array  # log likelihood of each with its prior, the largest zero, B + (V, P)
    covariance: Array  # of X₀ and Y₀, the same under all [m²], B + (2, 2)
    height: Array  # mean of z [m], B
    height_variance: Array  # its variance [m²], B
    clock: Array  # time from the first detection to the latest [s], B
    age: Array  # of the latest detection [s], B
    drawn: Array  # K hypotheses to predict from, equally probable: speed, phase, X₀ and Y₀, B + (4, K)


@tree()
class ParabolaFilter(LikeliestHit):
    """A predictor for targets of eq (7) whose rule is given, but not speed, phase and middle."""

    speed: Array  # hypotheses of the speed [m/s], (V,)
    phase: Array  # hypotheses of the share of the cycle gone at the first detection, (P,)
    log_prior: Array  # log probability of each speed, (V,)
    half_width: Array  # distance from the middle at which the target turns back [m], ()
    curvature: Array  # c [1/m], ()
    middles: Array  # smallest and largest X₀ (row 0) and Y₀ [m], (2, 2)
    reach: Array  # hit radius [m], ()
    scatter: Array  # standard deviation of the pellets' azimuth [rad], ()
    noise: TrackerNoise  # of the camera; its part of the target is unused

    def reset(self, seen: Seen) -> Hypotheses:
        """Begin at the first decision."""
        first = first_detection(seen)
        place, zero = first.place - first.own, 0.0 * first.age
        depth, lateral = self._swing(zero)
        evidence = 0.0 * depth + lift(self.log_prior[:, None], depth)
        depth, lateral = first.place[..., 0, None, None] - depth, first.place[..., 1, None, None] - lateral
        track = kalman_filter.begin_track(self.noise, place, first.fresh)
        covariance, variance = track.covariance[..., :2, :2], track.height_variance
        drawn = self._drawn(depth, lateral, evidence, covariance)
        return Hypotheses(depth, lateral, evidence, covariance, first.place[..., 2], variance, zero, first.age, drawn)

    def step(self, state: Hypotheses, seen: Seen) -> Hypotheses:
        """Update with what is seen now."""
        state = super().step(state, seen)
        return state._replace(drawn=self._drawn(*state[:4]))

    def places(self, state: Hypotheses, time: Array) -> Places:
        """Return the place under each hypothesis that was drawn, a time [s] from now, shape B."""
        xp = namespace(state.age, time)
        speed, phase, *middle = (state.drawn[..., row, :] for row in range(4))
        depth, lateral = self._against_middle(phase, speed, (state.clock + state.age + time)[..., None])

        def variance(left: Array) -> Array:
            outer = left[..., :, None] * left[..., None, :]
            return xp.sum(outer * state.covariance, axis=(-2, -1))[..., None]

        return Places(xp.stack([middle[0] + depth, middle[1] + lateral], axis=-1), state.height[..., None], variance)

    def update(self, state: Hypotheses, seen: Detection) -> Hypotheses:
        """Update with a detection."""
        xp, place = namespace(state.age), seen.place - seen.own
        age = xp.where(seen.fresh, seen.age, state.age)
        clock = state.clock + state.age - age
        measured = kalman_filter.measurement_covariance(self.noise, place)
        precision, _ = kalman_filter.inverse_and_determinant(state.covariance + measured)
        gain = kalman_filter.matrix_product(state.covariance, precision)
        depth, lateral = self._swing(clock)
        # The innovations under each hypothesis; a detection that is not fresh has none.
        grid = seen.fresh[..., None, None]
        ahead = xp.where(grid, seen.place[..., 0, None, None] - depth - state.depth, 0.0)
        aside = xp.where(grid, seen.place[..., 1, None, None] - lateral - state.lateral, 0.0)
        square = _entry(precision, 0, 0) * ahead**2 + _entry(precision, 1, 1) * aside**2
        evidence = state.evidence - 0.5 * square - _entry(precision, 0, 1) * ahead * aside
        evidence = evidence - xp.max(evidence, axis=(-2, -1), keepdims=True)
        depth = state.depth + _entry(gain, 0, 0) * ahead + _entry(gain, 0, 1) * aside
        lateral = state.lateral + _entry(gain, 1, 0) * ahead + _entry(gain, 1, 1) * aside
        known = kalman_filter.symmetric(kalman_filter.matrix_product(gain, measured))
        covariance = xp.where(grid, known, state.covariance)
        noise = kalman_filter.height_noise(self.noise, place)
        share = xp.where(seen.fresh, state.height_variance / (state.height_variance + noise), 0.0)
        height = state.height + share * (seen.place[..., 2] - state.height)
        variance = (1.0 - share) * state.height_variance
        return Hypotheses(depth, lateral, evidence, covariance, height, variance, clock, age, state.drawn)

    def _against_middle(self, phase: Array, speed: Array, time: Array) -> tuple[Array, Array]:
        """Where eq (7) puts the target against the middle, x and y [m]."""
        lateral = self.half_width * triangle_wave(phase + speed * time / (4.0 * self.half_width))
        return self.curvature * lateral**2, lateral

    def _swing(self, time: Array) -> tuple[Array, Array]:
        """Return the same under all hypotheses, shape B → B + (V, P) each."""
        time = time[..., None, None]
        return self._against_middle(lift(self.phase[None, :], time), lift(self.speed[:, None], time), time)

    def _drawn(self, depth: Array, lateral: Array, evidence: Array, covariance: Array) -> Array:
        """Draw hypotheses to predict from, in proportion to the evidence and to where middles may lie."""
        xp, share = namespace(depth), 1.0
        for axis, mean in enumerate((depth, lateral)):
            scale = _entry(covariance, axis, axis) ** -0.5
            below, above = (distribution((self.middles[axis, end] - mean) * scale) for end in range(2))
            share = share * (above - below)
        # A target outside the range keeps a small weight.
        row, column = systematic_draw(xp.exp(evidence) * (share + 1e-9), HYPOTHESES_DRAWN)
        index, flat = row * self.phase.shape[0] + column, (*evidence.shape[:-2], -1)
        means = (xp.take_along_axis(xp.reshape(mean, flat), index, axis=-1) for mean in (depth, lateral))
        return xp.stack([xp.take(self.speed, row), xp.take(self.phase, column), *means], axis=-2)


def systematic_draw(weight: Array, draws: int) -> tuple[Array, Array]:
    """Draw hypotheses systematically: those at equal steps of the distribution function, column by column.

    Args:
      weight: not normalised, shape B + (V, P).
      draws: K, how many.

    Returns:
      Row and column of each, shape B + (K,).
    """
    xp = namespace(weight)
    columns = xp.sum(weight, axis=-2)
    upto = xp.cumulative_sum(columns, axis=-1)
    share = (xp.arange(draws, dtype=weight.dtype) + 0.5) / draws
    mark = upto[..., -1:] * lift(share, upto)
    column = xp.sum(upto[..., :-1, None] < mark[..., None, :], axis=-2)
    left = mark - xp.take_along_axis(upto - columns, column, axis=-1)
    drawn = xp.take_along_axis(weight, column[..., None, :], axis=-1)[..., :-1, :]

    def count(state: tuple[Array, Array], weights: Array) -> tuple[Array, Array]:
        within = state[1] + weights
        return state[0] + (within < left), within

    # A loop and no chain of sums, which a compiler would repeat in each of the many predictions that use the rows.
    return fold(count, (xp.zeros_like(column), xp.zeros_like(left)), drawn, weight.ndim - 2)[0], column


def _entry(matrix: Array, row: int, column: int) -> Array:
    """Return an entry of 2×2 matrices, to broadcast against a grid: shape B + (2, 2) → B + (1, 1)."""
    return matrix[..., row, column, None, None]


def make_parabola_aware(task: Task) -> ParabolaAware:
    """Build the predictor for exact detections of a task's targets."""
    return ParabolaAware(np.asarray(task.curvature_1_m), np.sqrt(np.asarray(task.rise_m / task.curvature_1_m)))


def make_parabola_filter(task: Task, scatter: float, noise: TrackerNoise) -> ParabolaFilter:
    """Build the filter.

    Args:
      task: the rule: curve, width, largest speed, where the middles lie; and the hit radius.
      scatter: standard deviation of the pellets' azimuth [rad].
      noise: of the camera.
    """
    moving = SPEED_HYPOTHESES - 1  # evenly up to the largest speed, each as likely as the others
    return ParabolaFilter(
        speed=task.max_speed_m_s * np.arange(SPEED_HYPOTHESES) / moving,
        phase=np.arange(PHASE_HYPOTHESES) / PHASE_HYPOTHESES,
        log_prior=np.log([STILL_SHARE, *[(1.0 - STILL_SHARE) / moving] * moving]),
        half_width=np.sqrt(np.asarray(task.rise_m / task.curvature_1_m)),
        curvature=np.asarray(task.curvature_1_m),
        middles=np.array([[np.min(task.ranges_m), np.max(task.ranges_m)], [-task.lateral_m, task.lateral_m]]),
        reach=np.asarray(task.hit_radius_m),
        scatter=np.asarray(scatter),
        noise=noise,
    )

"""A Bayes filter for targets of eq (7) whose rule is given, but not a target's speed, phase and middle.

The rule is the curve, the width within which the target goes to and fro, its largest speed, and where the middles lie.

- Speeds and phases form a grid of hypotheses. Under each of them the target's place against the middle is known at any
  time. So the middle is Gaussian, and one Kalman gain serves all hypotheses.
- Both coordinates of a detection count: the depth shows how far from the middle the target is.
- A prediction takes a systematic sample of the hypotheses, which stands for all of them.
"""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, fold, lift, namespace
from archerfish.targets.motion import triangle_wave
from archerfish.task import Task
from archerfish.tracking import kalman_filter
from archerfish.tracking.detections import Detection
from archerfish.tracking.interacting_models import STILL_SHARE
from archerfish.tracking.kalman_filter import TrackerNoise

SPEED_HYPOTHESES, PHASE_HYPOTHESES, HYPOTHESES_DRAWN = 48, 160, 96
"""Hypotheses of either kind, and how many are drawn to predict from. Finer ones change no hit rate by 0.1 points."""
_WIDTH = 4.25
"""Width of a parabolic density whose distribution function is nearest to the normal one, in standard deviations."""


class ParabolaRule(NamedTuple):
    """What is given of targets of eq (7); V speeds and P phases are taken as hypotheses."""

    speed: Array  # hypotheses of the speed [m/s], (V,)
    phase: Array  # hypotheses of the share of the cycle gone at the first detection, (P,)
    log_prior: Array  # log probability of each speed, (V,)
    half_width: Array  # distance from the middle at which the target turns back [m], ()
    curvature: Array  # c [1/m], ()
    middles: Array  # smallest and largest X₀ (row 0) and Y₀ [m], (2, 2)

    def against_middle(self, phase: Array, speed: Array, time: Array) -> tuple[Array, Array]:
        """Return where eq (7) puts the target against the middle, x and y [m]; all of shape B or to broadcast."""
        lateral = self.half_width * triangle_wave(phase + speed * time / (4.0 * self.half_width))
        return self.curvature * lateral**2, lateral

    def swing(self, time: Array) -> tuple[Array, Array]:
        """Return the same under all hypotheses, shape B → B + (V, P) each."""
        time = time[..., None, None]
        return self.against_middle(lift(self.phase[None, :], time), lift(self.speed[:, None], time), time)


def parabola_rule(task: Task) -> ParabolaRule:
    """Return the rule of a task's targets: curve, width, largest speed, and where the middles lie."""
    moving = SPEED_HYPOTHESES - 1  # evenly up to the largest speed, each as likely as the others
    return ParabolaRule(
        speed=task.max_speed_m_s * np.arange(SPEED_HYPOTHESES) / moving,
        phase=np.arange(PHASE_HYPOTHESES) / PHASE_HYPOTHESES,
        log_prior=np.log([STILL_SHARE, *[(1.0 - STILL_SHARE) / moving] * moving]),
        half_width=np.sqrt(np.asarray(task.rise_m / task.curvature_1_m)),
        curvature=np.asarray(task.curvature_1_m),
        middles=np.array([[np.min(task.ranges_m), np.max(task.ranges_m)], [-task.lateral_m, task.lateral_m]]),
    )


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


def begin_hypotheses(rule: ParabolaRule, noise: TrackerNoise, first: Detection) -> Hypotheses:
    """Begin at the first decision.

    Args:
      rule: of the targets.
      noise: of the camera; its part of the target is unused.
      first: detection, shape B.
    """
    place, zero = first.place - first.own, 0.0 * first.age
    depth, lateral = rule.swing(zero)
    evidence = 0.0 * depth + lift(rule.log_prior[:, None], depth)
    depth, lateral = first.place[..., 0, None, None] - depth, first.place[..., 1, None, None] - lateral
    track = kalman_filter.begin_track(noise, place, first.fresh)
    covariance, variance = track.covariance[..., :2, :2], track.height_variance
    drawn = draw_hypotheses(rule, depth, lateral, evidence, covariance)
    return Hypotheses(depth, lateral, evidence, covariance, first.place[..., 2], variance, zero, first.age, drawn)


def update_hypotheses(rule: ParabolaRule, noise: TrackerNoise, state: Hypotheses, seen: Detection) -> Hypotheses:
    """Update with a detection, shape B; arguments as of `begin_hypotheses`. What was drawn stays."""
    xp, place = namespace(state.age), seen.place - seen.own
    age = xp.where(seen.fresh, seen.age, state.age)
    clock = state.clock + state.age - age
    measured = kalman_filter.measurement_covariance(noise, place)
    precision, _ = kalman_filter.inverse_and_determinant(state.covariance + measured)
    gain = kalman_filter.matrix_product(state.covariance, precision)
    depth, lateral = rule.swing(clock)
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
    height_noise = kalman_filter.height_noise(noise, place)
    share = xp.where(seen.fresh, state.height_variance / (state.height_variance + height_noise), 0.0)
    height = state.height + share * (seen.place[..., 2] - state.height)
    variance = (1.0 - share) * state.height_variance
    return Hypotheses(depth, lateral, evidence, covariance, height, variance, clock, age, state.drawn)


def draw_hypotheses(rule: ParabolaRule, depth: Array, lateral: Array, evidence: Array, covariance: Array) -> Array:
    """Draw hypotheses to predict from, in proportion to the evidence and to where middles may lie; see `Hypotheses`."""
    xp, share = namespace(depth), 1.0
    for axis, mean in enumerate((depth, lateral)):
        scale = _entry(covariance, axis, axis) ** -0.5
        below, above = (distribution((rule.middles[axis, end] - mean) * scale) for end in range(2))
        share = share * (above - below)
    # A target outside the range keeps a small weight.
    row, column = systematic_draw(xp.exp(evidence) * (share + 1e-9), HYPOTHESES_DRAWN)
    index, flat = row * rule.phase.shape[0] + column, (*evidence.shape[:-2], -1)
    means = (xp.take_along_axis(xp.reshape(mean, flat), index, axis=-1) for mean in (depth, lateral))
    return xp.stack([xp.take(rule.speed, row), xp.take(rule.phase, column), *means], axis=-2)


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


def distribution(deviate: Array) -> Array:
    """Return the distribution function of a parabolic density: within 0.023 of the normal one, and far cheaper.

    Args:
      deviate: in standard deviations, shape B.
    """
    share = namespace(deviate).clip(0.5 + deviate * (1.0 / _WIDTH), 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)

"""Where a target of eq (7) will be, from noisy sights: a Bayes filter over speeds and phases.

The rule is known (the curve, the width within which the target goes to and fro, its largest speed, where the middles
lie), speed, phase and middle are not. Speeds and phases form a grid of hypotheses. Given both, where the target is
against the middle is known at any time, so the middle is Gaussian, and one Kalman gain serves all hypotheses. Both
coordinates of a sight count: the depth says how far from the middle the target is.

A prediction needs the place that most likely lies within the armor's reach of the pellet, not the mean: a target that
may or may not turn back is in one of two places, never between them. It takes a systematic draw of the hypotheses,
which stands for all of them.
"""

from typing import NamedTuple

import numpy as np

from archerfish.controllers.hit_window import across_sight, distribution, most_hits
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.paper.conditions import Conditions
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import (
    UNSEEN_SD,
    TrackerNoise,
    height_noise,
    inverse_and_determinant,
    matrix_product,
    measurement_covariance,
    symmetric,
)
from archerfish.targets.parabola import triangle_wave

SPEEDS, PHASES, DRAWN = 48, 160, 96
"""Hypotheses of either kind, and how many are drawn to predict from. Finer ones change no hit rate by 0.1 points."""
STANDING = 0.5
"""Probability that a target stands still, which the tables' targets do half of the time."""


class Drawn(NamedTuple):
    """Hypotheses that stand for all, each with the same probability; shape B + (K,) each."""

    speed: Array
    """[m/s]."""
    phase: Array
    """Part of the cycle gone at the first sight."""
    depth: Array
    """X₀, mean given the other two [m]."""
    lateral: Array
    """Y₀, mean given the other two [m]."""


class Hypotheses(NamedTuple):
    """What is known of one target; V speeds and P phases."""

    depth: Array
    """Mean of X₀ under each hypothesis [m], shape B + (V, P)."""
    lateral: Array
    """Mean of Y₀ under each [m], shape B + (V, P)."""
    evidence: Array
    """Log likelihood of each with its prior, the largest zero, shape B + (V, P)."""
    covariance: Array
    """Of X₀ and Y₀, the same under all [m²], shape B + (2, 2)."""
    height: Array
    """Mean of z [m], shape B."""
    height_variance: Array
    """Its variance [m²], shape B."""
    clock: Array
    """Since the first sight's exposure [s], shape B."""
    age: Array
    """Of the latest sight [s], shape B."""
    drawn: Drawn
    """Hypotheses to predict from."""


class ParabolaFilter(NamedTuple):
    """A predictor that knows the rule of eq (7), but not speed, phase and middle."""

    speed: Array
    """Hypotheses of the speed [m/s], shape (V,)."""
    phase: Array
    """Hypotheses of the part of the cycle gone at the first sight, shape (P,)."""
    log_prior: Array
    """Log probability of each speed, shape (V,)."""
    half_width: Array
    """Distance from the middle at which the target turns back [m]."""
    curvature: Array
    """c [1/m]."""
    low: Array
    """Smallest X₀ and Y₀ [m], shape (2,)."""
    high: Array
    """Largest X₀ and Y₀ [m], shape (2,)."""
    reach: Array
    """Hit radius [m]."""
    scatter: Array
    """Standard deviation of the pellets' azimuth [rad]."""
    draws: Array
    """Ones for each hypothesis that is drawn, shape (K,)."""
    noise: TrackerNoise
    """Of the camera; what it says of the target is unused."""

    def reset(self, seen: Seen) -> Hypotheses:
        """Begin at the first sight."""
        xp = namespace(seen.plate)
        plate, shown = seen.plate[..., 0, :], seen.fresh[..., 0]
        zero = 0.0 * plate[..., 0]
        depth, lateral = self._swing(zero)
        covariance = measurement_covariance(self.noise, plate)
        # A place that no frame has shown is a guess: it weighs next to nothing against the first sight.
        guess = UNSEEN_SD**2 * lift(xp.eye(2, dtype=plate.dtype), covariance)
        return self._with_draw(
            depth=plate[..., 0, None, None] - depth,
            lateral=plate[..., 1, None, None] - lateral,
            evidence=0.0 * depth + lift(self.log_prior[:, None], depth),
            covariance=xp.where(shown[..., None, None], covariance, guess + 0.0 * covariance),
            height=plate[..., 2],
            height_variance=xp.where(shown, height_noise(self.noise, plate), UNSEEN_SD**2 + zero),
            clock=zero,
            age=seen.plate_age[..., 0],
        )

    def step(self, state: Hypotheses, seen: Seen) -> Hypotheses:
        """Take in what is seen now."""
        xp = namespace(state.depth)
        plate, age = seen.plate[..., 0, :], seen.plate_age[..., 0]
        fresh = seen.fresh[..., 0] & (seen.elapsed > 0.0)
        clock = state.clock + state.age + seen.elapsed - age
        measured = measurement_covariance(self.noise, plate)
        precision, _ = inverse_and_determinant(state.covariance + measured)
        gain = matrix_product(state.covariance, precision)
        depth, lateral = self._swing(clock)
        # The innovations under each hypothesis; a sight that is not fresh brings none.
        grid = fresh[..., None, None]
        ahead = xp.where(grid, plate[..., 0, None, None] - depth - state.depth, 0.0)
        aside = xp.where(grid, plate[..., 1, None, None] - lateral - state.lateral, 0.0)
        square = _entry(precision, 0, 0) * ahead**2 + _entry(precision, 1, 1) * aside**2
        evidence = state.evidence - 0.5 * square - _entry(precision, 0, 1) * ahead * aside
        noise = height_noise(self.noise, plate)
        share = xp.where(fresh, state.height_variance / (state.height_variance + noise), 0.0)
        return self._with_draw(
            depth=state.depth + _entry(gain, 0, 0) * ahead + _entry(gain, 0, 1) * aside,
            lateral=state.lateral + _entry(gain, 1, 0) * ahead + _entry(gain, 1, 1) * aside,
            evidence=evidence - xp.max(evidence, axis=(-2, -1), keepdims=True),
            covariance=xp.where(grid, symmetric(matrix_product(gain, measured)), state.covariance),
            height=state.height + share * (plate[..., 2] - state.height),
            height_variance=(1.0 - share) * state.height_variance,
            clock=clock,
            age=age,
        )

    def mean_after(self, state: Hypotheses, time: Array) -> Array:
        """Return the mean of all places where the target may be, shape B + (3,)."""
        xp = namespace(state.age, time)
        level = xp.mean(self._places(state, time), axis=-2)
        return xp.concat([level, state.height[..., None] + 0.0 * level[..., :1]], axis=-1)

    def position_after(self, state: Hypotheses, time: Array) -> Array:
        """Return the place that a pellet most likely meets, shape B + (3,)."""
        xp = namespace(state.age, time)
        places = self._places(state, time)
        center = xp.mean(places, axis=-2)
        left, distance = across_sight(center)
        lateral = xp.sum((places - center[..., None, :]) * left[..., None, :], axis=-1)
        outer = left[..., :, None] * left[..., None, :]
        variance = xp.sum(outer * state.covariance, axis=(-2, -1)) + (self.scatter * distance) ** 2
        aim = most_hits(lateral, xp.sqrt(variance)[..., None], self.reach)
        level = center + aim[..., None] * left
        return xp.concat([level, state.height[..., None] + 0.0 * level[..., :1]], axis=-1)

    def _places(self, state: Hypotheses, time: Array) -> Array:
        """Place under each hypothesis that was drawn, x and y [m], shape B + (K, 2)."""
        drawn, when = state.drawn, (state.clock + state.age + time)[..., None]
        depth, lateral = self._against_middle(drawn.phase, drawn.speed, when)
        return namespace(depth).stack([drawn.depth + depth, drawn.lateral + lateral], axis=-1)

    def _against_middle(self, phase: Array, speed: Array, time: Array) -> tuple[Array, Array]:
        """Where eq (7) puts the target against the middle, x and y [m]."""
        lateral = self.half_width * triangle_wave(phase + speed * time / (4.0 * self.half_width))
        return self.curvature * lateral**2, lateral

    def _swing(self, time: Array) -> tuple[Array, Array]:
        """Return the same under all hypotheses, shape B → B + (V, P) each."""
        time = namespace(time).asarray(time)[..., None, None]
        return self._against_middle(lift(self.phase[None, :], time), lift(self.speed[:, None], time), time)

    def _with_draw(self, **known: Array) -> Hypotheses:
        xp = namespace(known["depth"])
        weight = xp.exp(known["evidence"]) * self._within(known["depth"], known["lateral"], known["covariance"])
        row, column = systematic_draw(weight, self.draws)
        index, flat = row * self.phase.shape[0] + column, (*weight.shape[:-2], -1)
        means = (xp.take_along_axis(xp.reshape(known[name], flat), index, axis=-1) for name in ("depth", "lateral"))
        drawn = Drawn(xp.take(self.speed, row), xp.take(self.phase, column), *means)
        return Hypotheses(**known, drawn=drawn)

    def _within(self, depth: Array, lateral: Array, covariance: Array) -> Array:
        """Share of the middle's density, under each hypothesis, that lies where middles may lie."""
        share = 1.0
        for axis, mean in enumerate((depth, lateral)):
            scale = _entry(covariance, axis, axis) ** -0.5
            below, above = (distribution((end[axis] - mean) * scale) for end in (self.low, self.high))
            share = share * (above - below)
        # A target from elsewhere is none that can't be.
        return share + 1e-9


def systematic_draw(weight: Array, draws: Array) -> tuple[Array, Array]:
    """Draw hypotheses systematically: those at equal steps of the distribution function, column by column.

    Args:
      weight: not normalised, shape B + (V, P).
      draws: ones, shape (K,).

    Returns:
      Row and column of each, shape B + (K,).
    """
    xp = namespace(weight)
    columns = xp.sum(weight, axis=-2)
    upto = xp.cumulative_sum(columns, axis=-1)
    share = (xp.arange(draws.shape[0], dtype=weight.dtype) + 0.5) / draws.shape[0]
    mark = upto[..., -1:] * lift(share, upto)
    column = xp.sum(upto[..., :-1, None] < mark[..., None, :], axis=-2)
    left = mark - xp.take_along_axis(upto - columns, column, axis=-1)
    # Row by row: one pass over what is drawn, which compiled is a tenth of the work of an array of cumulative sums.
    row, within = xp.zeros_like(column), xp.zeros_like(left)
    for each in range(weight.shape[-2] - 1):
        within = within + xp.take_along_axis(weight[..., each, :], column, axis=-1)
        row = row + (within < left)
    return row, column


def _entry(matrix: Array, row: int, column: int) -> Array:
    """Return an entry of 2×2 matrices, to meet a grid: shape B + (2, 2) → B + (1, 1)."""
    return matrix[..., row, column, None, None]


def parabola_filter(
    conditions: Conditions, scatter: float, noise: TrackerNoise, speeds: int = SPEEDS, phases: int = PHASES
) -> ParabolaFilter:
    """Build the filter.

    Args:
      conditions: the rule: curve, width, largest speed, where the middles lie; and the hit radius.
      scatter: standard deviation of the pellets' azimuth [rad].
      noise: of the camera.
      speeds: number of hypotheses, evenly from zero to the largest; all but zero are as likely as each other.
      phases: number of hypotheses.
    """
    prior = np.full(speeds, (1.0 - STANDING) / (speeds - 1))
    prior[0] = STANDING
    side, bins = conditions.max_lateral_offset, conditions.range_bins
    return ParabolaFilter(
        speed=conditions.max_lateral_speed * np.arange(speeds) / (speeds - 1),
        phase=np.arange(phases) / phases,
        log_prior=np.log(prior),
        half_width=np.asarray(conditions.reversal_half_width),
        curvature=np.asarray(conditions.parabola_curvature),
        low=np.array([bins[0][0], -side]),
        high=np.array([bins[-1][1], side]),
        reach=np.asarray(conditions.hit_radius),
        scatter=np.asarray(scatter),
        draws=np.ones(DRAWN),
        noise=noise,
    )

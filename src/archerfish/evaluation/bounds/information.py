"""The information bound: no aim hits more than what the sights leave open, were the gimbal without inertia.

A Bayes filter over a grid of speeds and phases, which knows the rule of eq (7), the cell and the camera. Given speed
and phase, the middle (X₀, Y₀) of the path is linear in what is measured: with the swing l at the exposure, bearing β
and distance r,

    X₀ cos β + Y₀ sin β = r − c l² cos β − l sin β,     Y₀ cos β − X₀ sin β = c l² sin β − l cos β,

with independent errors of r σ_r and r σ_β. So the middle is Gaussian under each hypothesis, and the cell enters by the
Gaussian's mass in it. The chance of an aim is the histogram of the bearings at the crossing, convolved with the chance
of one shot.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from archerfish.evaluation.bounds.aim_problem import AimProblem, Array
from archerfish.evaluation.bounds.hit_chance import hit_chance
from archerfish.evaluation.bounds.sights import Sights
from archerfish.simulation.scenario import Scenario
from archerfish.targets.parabola import triangle_wave

SPEEDS, PHASES = 64, 256
"""Of the grid: a finer one changes the bounds by thousandths of a point."""
AIMS = 512
"""Aims that are tried per shot."""
_SAMPLES = 321
"""Of the chance of a shot, linear between them."""
_IMPLAUSIBLE = 40.0
"""Hypotheses whose log weight is this far below the best are dropped."""


class Prior(NamedTuple):
    """What is known of a cell's targets before they are seen; eq (7)."""

    x: tuple[float, float]
    """X₀ is uniform between these [m]."""
    y: tuple[float, float]
    """Y₀ is uniform between these [m]."""
    half_width: float
    """Distance from the middle at which the target turns back [m]."""
    curvature: float
    """c [1/m]."""
    speed: Array
    """Hypotheses of the lateral speed [m/s], shape (H,)."""
    phase: Array
    """Of the phase at time zero, shape (H,)."""

    @property
    def rise(self) -> float:
        """Largest x − X₀ [m]."""
        return self.curvature * self.half_width**2

    def swing(self, time: float) -> Array:
        """Return the lateral distance from the middle at a time [s] under each hypothesis [m], shape (H,)."""
        cycles = self.phase + self.speed * time / (4.0 * self.half_width)
        return np.asarray(self.half_width * triangle_wave(cycles))


def make_prior(scenario: Scenario, speeds: int = SPEEDS, phases: int = PHASES) -> Prior:
    """Take the prior of a cell; its targets either all stand still or all move."""
    if float(scenario.static_share) == 1.0:
        speed, phase = np.zeros((1, 1)), np.full((1, 1), 0.25)
    else:
        middles = (np.arange(speeds) + 0.5) / speeds, (np.arange(phases) + 0.5) / phases
        speed, phase = np.meshgrid(float(scenario.max_speed) * middles[0], middles[1], indexing="ij")
    side = float(scenario.lateral)
    return Prior(
        x=(float(scenario.range_low), float(scenario.range_high)),
        y=(-side, side),
        half_width=float(scenario.half_width),
        curvature=float(scenario.curvature),
        speed=speed.ravel(),
        phase=phase.ravel(),
    )


class AimChances(NamedTuple):
    """Chances of the aims at every shot of one engagement, with the best pitch."""

    offset: Array
    """Yaw against the aim that meets the armor's centre [rad], rising, shape (T, AIMS)."""
    chance: Array
    """To hit, for who knows what was seen by then, shape (T, AIMS)."""
    level_sd: Array
    """Standard deviation of the armor's distance at the crossing [m], shape (T,)."""


def aim_chances(problem: AimProblem, seen: Sights, prior: Prior) -> AimChances:
    """Work out what the sights leave open at every shot.

    Args:
      problem: of one engagement.
      seen: of that engagement; shots after its last decision are taken to know everything.
      prior: of the cell.
    """
    belief, found = _no_belief(prior), []
    for shot in range(problem.geometry.x.shape[-1]):
        if shot < len(seen.fresh):
            if seen.fresh[shot]:
                belief = _informed(belief, seen, shot)
            belief, places = _places(belief, problem, shot)
        else:
            places = _Places(problem.geometry.bearing[0, shot : shot + 1], np.ones(1), 0.0, 0.0)
        found.append((*_chances(problem, shot, places), places.level_sd))
    return AimChances(*(np.array(each) for each in zip(*found, strict=True)))


class _Belief(NamedTuple):
    """H hypotheses, and sums over the frames."""

    prior: Prior
    precision: Array  # of (X₀, Y₀), shape (2, 2)
    vector: Array  # precision times mean, shape (H, 2)
    square: Array  # of what was measured less the hypothesis, over the variances, shape (H,)


def _no_belief(prior: Prior) -> _Belief:
    count = len(prior.speed)
    return _Belief(prior, np.zeros((2, 2)), np.zeros((count, 2)), np.zeros(count))


def _informed(belief: _Belief, seen: Sights, decision: int) -> _Belief:
    """Take a frame in."""
    bearing, level = float(seen.bearing[decision]), float(seen.level[decision])
    swing = belief.prior.swing(float(seen.exposed[decision]))
    place = np.stack([belief.prior.curvature * swing**2, swing], axis=-1)
    along = np.array([np.cos(bearing), np.sin(bearing)])
    across = np.array([-along[1], along[0]])
    _, precision, vector, square = belief
    # The errors grow with the true distance, which is known no better than this.
    rows = ((along, seen.distance[decision], level * seen.distance_sd), (across, 0.0, level * seen.bearing_sd))
    for row, measured, sd in rows:
        left = (measured - place @ row) / sd
        precision = precision + np.outer(row, row) / sd**2
        vector = vector + left[:, None] * row / sd
        square = square + left**2
    return _Belief(belief.prior, precision, vector, square)


class _Places(NamedTuple):
    """Where the armor may be when a pellet crosses its x."""

    bearing: Array  # [rad], shape (H,)
    weight: Array  # shape (H,)
    blur: float  # standard deviation of the bearing under each hypothesis [rad]
    level_sd: float  # of the distance, under all of them [m]


def _places(belief: _Belief, problem: AimProblem, shot: int) -> tuple[_Belief, _Places]:
    """Weigh the hypotheses, drop the implausible ones, and go on to the crossing."""
    covariance: Array = np.linalg.inv(belief.precision).astype(np.float64)
    mean = belief.vector @ covariance
    mass, middle = _within(mean, covariance, belief.prior)
    log = np.log(mass) - 0.5 * (belief.square - np.sum(belief.vector * mean, axis=-1))
    log = log - np.max(log)
    kept = log > -_IMPLAUSIBLE
    prior = belief.prior._replace(speed=belief.prior.speed[kept], phase=belief.prior.phase[kept])
    belief = _Belief(prior, belief.precision, belief.vector[kept], belief.square[kept])
    weight = np.exp(log[kept]) / np.sum(np.exp(log[kept]))
    swing = prior.swing(float(problem.geometry.crossing[0, shot]))
    x, y = middle[kept, 0] + prior.curvature * swing**2, middle[kept, 1] + swing
    bearing, level = np.arctan2(y, x), np.hypot(x, y)
    mean_level = float(np.sum(weight * level))
    toward = np.array([np.cos(problem.geometry.bearing[0, shot]), np.sin(problem.geometry.bearing[0, shot])])
    across = np.array([-toward[1], toward[0]])
    spread = np.sum(weight * (level - mean_level) ** 2) + toward @ covariance @ toward
    return belief, _Places(bearing, weight, float(np.sqrt(across @ covariance @ across)) / mean_level, np.sqrt(spread))


def _within(mean: Array, covariance: Array, prior: Prior) -> tuple[Array, Array]:
    """Mass of Gaussians in the cell, and their means there: X₀ first, then Y₀ given that."""
    sd = np.sqrt(covariance[0, 0])
    x_mass, x = _truncated(mean[:, 0], sd, prior.x)
    slope = covariance[0, 1] / covariance[0, 0]
    left = np.sqrt(max(covariance[1, 1] - slope * covariance[0, 1], 1e-18))
    y_mass, y = _truncated(mean[:, 1] + slope * (x - mean[:, 0]), left, prior.y)
    return np.maximum(x_mass * y_mass, 1e-300), np.stack([x, y], axis=-1)


def _truncated(mean: Array, sd: float, ends: tuple[float, float]) -> tuple[Array, Array]:
    """Mass of a Gaussian between two ends, and its mean there."""
    low, high = ((end - mean) / sd for end in ends)
    mass = ndtr(high) - ndtr(low)
    density = np.exp(-0.5 * low**2) - np.exp(-0.5 * high**2)
    within = mean + sd * density / (np.sqrt(2.0 * np.pi) * np.maximum(mass, 1e-12))
    return mass, np.clip(within, *ends)


def _chances(problem: AimProblem, shot: int, places: _Places) -> tuple[Array, Array]:
    """Offsets of the aims and their chances, shape (AIMS,) each."""
    geometry = problem.geometry
    x, bearing = geometry.x[0, shot], geometry.bearing[0, shot]
    per_yaw = x / np.cos(bearing) ** 2
    sd = np.array([geometry.sd[0, shot, 0], np.hypot(geometry.sd[0, shot, 1], per_yaw * places.blur)])
    window = 1.2 * (problem.radius + 6.0 * sd[1]) / per_yaw
    off = places.bearing - bearing
    offset = np.linspace(np.min(off) - window, np.max(off) + window, AIMS)
    stride = offset[1] - offset[0]
    cell = (off - offset[0]) / stride
    index, share = np.floor(cell).astype(np.int64), cell - np.floor(cell)
    histogram = np.bincount(index, places.weight * (1.0 - share), AIMS)
    histogram += np.bincount(np.minimum(index + 1, AIMS - 1), places.weight * share, AIMS)
    reach = int(window / stride)
    sampled = np.linspace(-window, window, _SAMPLES)
    missed = x * (np.tan(bearing + sampled) - np.tan(bearing))
    chance = hit_chance(np.stack([0.0 * missed, missed], axis=-1), sd, problem.radius)
    kernel = np.interp(stride * np.arange(-reach, reach + 1), sampled, chance)
    return offset, np.convolve(histogram, kernel)[reach : reach + AIMS]

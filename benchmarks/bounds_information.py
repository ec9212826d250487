"""The information bound: no aim hits more than what the detections leave open, were the gimbal without inertia.

A Bayes filter over a grid of speeds and phases, which knows the rule of eq (7), the cell and the camera. Given speed
and phase, the middle (X₀, Y₀) of the path is linear in what is measured: with the swing l at the exposure, bearing β
and distance r,

    X₀ cos β + Y₀ sin β = r − c l² cos β − l sin β,     Y₀ cos β − X₀ sin β = c l² sin β − l cos β,

with independent errors of r σ_r and r σ_β. So the middle is Gaussian under each hypothesis, and the cell enters by the
Gaussian's mass in it. The chance of an aim is the histogram of the bearings at the crossing, convolved with the chance
of one shot.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from archerfish.protocols import Engagement
from archerfish.simulation.camera import (
    MISSED,
    LinkedHardware,
    feedback_age,
    latest_exposure,
    measured_place,
    plate_place,
)
from archerfish.simulation.world import SimulatedWorld
from archerfish.targets.motion import triangle_wave
from archerfish.task import Scenario
from bounds_problem import AimProblem, Array, hit_chance, target_at

_EXACT = 1e-6
"""Standard deviation that exact detections are given [rad, and relative]."""


class Detections(NamedTuple):
    """Frames at the D decisions of E engagements."""

    bearing: Array  # Measured azimuth [rad], shape (E, D)
    distance: Array  # Measured horizontal distance [m], shape (E, D)
    level: Array  # true horizontal distance at the exposure [m], shape (E, D)
    exposed: Array  # Moment of the exposure since the engagement began [s], shape (E, D)
    fresh: NDArray[np.bool_]  # whether the frame is new at the decision, shape (E, D)
    bearing_sd: Array  # standard deviation of the azimuth [rad], shape (E,)
    distance_sd: Array  # that of the distance, relative to it, shape (E,)

    def pick(self, index: int) -> "Detections":
        """Return those of one engagement, without the leading dimension."""
        return Detections(*(each[index] for each in self))


def detections(world: SimulatedWorld, engagements: Engagement, draws: NDArray[np.float32]) -> Detections | None:
    """Gather the frames, with no more noise than the camera's own: none from the gimbal's motion.

    A controller sees the same frames, blurred further by its own turning; so it knows no more.

    Args:
      world: the simulator.
      engagements: E of them.
      draws: standard normals, shape (E, T, normals).

    Returns:
      The frames of all decisions; one decision only where detections are exact, since two of them show all there is to
      know; None where the noise depends on the distance, of which the filter knows nothing.
    """
    hardware, draw = world.hardware, engagements.plant
    time: Any = np.zeros(len(draws), np.float32)  # as in the world, or a frame may count a decision later
    if not isinstance(hardware, LinkedHardware):
        exact = np.full(len(draws), _EXACT)
        place = plate_place(engagements, time)
        return _detections(engagements, place[:, None], time[:, None], time[:, None] == 0.0, exact, exact)
    sensing, still = hardware.sensing, np.zeros((len(draws), 2), np.float32)
    if np.any(sensing.nearness[draw] != 0.0):
        return None
    # As the world begins: the normals of the first detection are those of the last step.
    phases = np.remainder(16.0 * draws[:, -1, :2], 1.0)
    found: list[tuple[Array, Array, NDArray[np.bool_]]] = []
    for step in range(-1, draws.shape[1] - 1):
        normals = draws[:, step]
        age = feedback_age(sensing, draw, phases[:, 1], time, normals)
        exposed = latest_exposure(sensing, draw, phases[:, 0], time, age, normals)
        place = measured_place(sensing, draw, plate_place(engagements, exposed), still, normals)
        fresh = np.full(len(draws), fill_value=True)  # the frame at the beginning counts, however old it is
        if found:
            fresh = (exposed > found[-1][1] + 1e-6) & (normals[:, MISSED] > sensing.miss[draw])
            place = np.where(fresh[:, None], place, found[-1][0])
            exposed = np.where(fresh, exposed, found[-1][1])
        found.append((place, exposed, fresh))
        time = time + world.period
    place, exposed, fresh = (np.stack(parts, axis=1) for parts in zip(*found, strict=True))
    across, along = (np.maximum(np.asarray(field, np.float64), _EXACT) for field in (sensing.across, sensing.along))
    return _detections(engagements, place, exposed, fresh, across[draw, 1], along[draw])


def _detections(
    engagements: Engagement, place: Array, exposed: Array, fresh: NDArray[np.bool_], across: Array, along: Array
) -> Detections:
    place, exposed = np.asarray(place, np.float64), np.asarray(exposed, np.float64)
    true = target_at(engagements, exposed)
    return Detections(
        bearing=np.arctan2(place[..., 1], place[..., 0]),
        distance=np.hypot(place[..., 0], place[..., 1]),
        level=np.hypot(true[..., 0], true[..., 1]),
        exposed=exposed,
        fresh=fresh,
        bearing_sd=across,
        distance_sd=along,
    )


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

    x: tuple[float, float]  # X₀ is uniform between these [m]
    y: tuple[float, float]  # Y₀ is uniform between these [m]
    half_width: float  # distance from the middle at which the target turns back [m]
    curvature: float  # c [1/m]
    speed: Array  # hypotheses of the lateral speed [m/s], shape (H,)
    phase: Array  # of the phase at time zero, shape (H,)

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
    if float(scenario.still_share) == 1.0:
        speed, phase = np.zeros((1, 1)), np.full((1, 1), 0.25)
    else:
        middles = (np.arange(speeds) + 0.5) / speeds, (np.arange(phases) + 0.5) / phases
        speed, phase = np.meshgrid(float(scenario.swing[0]) * middles[0], middles[1], indexing="ij")
    side = float(scenario.lateral)
    return Prior(
        x=(float(scenario.range_m[0]), float(scenario.range_m[1])),
        y=(-side, side),
        half_width=float(scenario.swing[1]),
        curvature=float(scenario.curvature),
        speed=speed.ravel(),
        phase=phase.ravel(),
    )


class AimChances(NamedTuple):
    """Chances of the aims at every shot of one engagement, with the best pitch."""

    offset: Array  # Yaw against the aim that meets the armor's centre [rad], rising, shape (T, AIMS)
    chance: Array  # to hit, for who knows what was seen by then, shape (T, AIMS)
    level_sd: Array  # standard deviation of the armor's distance at the crossing [m], shape (T,)


def aim_chances(problem: AimProblem, seen: Detections, prior: Prior) -> AimChances:
    """Work out what the detections leave open at every shot.

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


def _informed(belief: _Belief, seen: Detections, decision: int) -> _Belief:
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

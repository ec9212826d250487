"""Time offset, geometry and detection noise from a plate at rest while the gimbal sweeps, by maximum likelihood.

Detections scatter in azimuth, elevation and range; a jitter of the stamps moves them along with the plate's apparent
motion, which tells it from the noise of the detection: it acts only where the gimbal turns.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from archerfish.identification.sensing.gimbal_track import GimbalTrack
from archerfish.identification.sensing.plate_sighting import PRIOR_SD, Sighting, sighted_position, spherical
from archerfish.identification.sensing.stamp_timing import Z95, Interval, long_run_covariance
from archerfish.records.errors import InputError

Array = NDArray[np.float64]

OUTLIER = 5.0
"""A detection this many standard deviations off in any direction is not the plate: 2 in a million by chance."""
_ROUNDS = 30


class Spread(NamedTuple):
    """Variances of azimuth, elevation and range, and of the stamps, with their covariance."""

    variance: Array
    """Of azimuth, elevation [rad²], range [m²] and stamps [s²], shape (4,)."""
    error: Array
    """Standard errors of the four, shape (4,)."""


class PlateAlignment(NamedTuple):
    """How detections of a plate at rest lie on the gimbal's log."""

    offset: float
    """What is added to a stamp to get the moment of exposure on the gimbal log's clock [s]."""
    offset_sd: float
    """Its standard error, with serial correlation of the residuals [s]."""
    sighting: Sighting
    """Where plate and camera are."""
    spread: Spread
    """Noise."""
    moments: Array
    """Moments of the detections on the gimbal log's clock [s], shape (K,)."""
    residual: Array
    """Measured less modelled azimuth, elevation [rad] and range [m], shape (K, 3)."""
    inlier: NDArray[np.bool_]
    """Detections of the plate, shape (K,)."""
    drift: float
    """Rate of the camera's clock against the gimbal log's, less 1."""
    drift_sd: float
    """Its standard error."""


class _Problem(NamedTuple):
    """The data, inside the gimbal log."""

    track: GimbalTrack
    stamps: Array
    seen: Array
    start: float


def align_plate(track: GimbalTrack, stamps: Array, position: Array, start: float) -> PlateAlignment:
    """Fit offset, geometry and noise to the detections of a plate at rest.

    Args:
      track: the gimbal.
      stamps: of the detections, on the camera's clock [s], shape (K,), all inside the gimbal log at `start`.
      position: of the plate in the camera's frame [m], shape (K, 3).
      start: rough offset [s].

    Raises:
      InputError: if fewer than half of the detections are of one plate at rest.
    """
    problem = _Problem(track, stamps, spherical(position), start)
    parameters = _robust_start(problem)
    inlier = np.ones(stamps.size, dtype=bool)
    spread = Spread(np.append(_robust_variance(_residual(problem, parameters)), 0.0), np.zeros(4))
    for _ in range(_ROUNDS):
        residual, slope = _residual(problem, parameters), _slope(problem, parameters)
        found = np.all(np.abs(residual) < OUTLIER * np.sqrt(_variances(spread, slope)), axis=1)
        if found.mean() < 0.5:
            raise InputError(
                f"only {found.mean():.0%} of the detections fit one plate at rest; keep plate and robot still, one "
                "plate in view"
            )
        last, spread = spread, _estimated_spread(residual[found], slope[found])
        parameters = _fitted(problem, parameters, _variances(spread, slope), found)
        settled = np.allclose(spread.variance[:3], last.variance[:3], rtol=1e-4)
        if settled and np.array_equal(found, inlier):
            break
        inlier = found
    return _assembled(problem, parameters, spread, inlier)


def _modelled(problem: _Problem, parameters: Array) -> Array:
    yaw, pitch = problem.track.angles(problem.stamps + (problem.start + parameters[-1])).T
    return spherical(sighted_position(Sighting(*parameters[:-1]), yaw, pitch))


def _residual(problem: _Problem, parameters: Array) -> Array:
    difference = problem.seen - _modelled(problem, parameters)
    difference[:, 0] = (difference[:, 0] + np.pi) % (2 * np.pi) - np.pi
    return difference


def _slope(problem: _Problem, parameters: Array, step: float = 1e-3) -> Array:
    """Return how modelled azimuth, elevation and range change with the offset, shape (K, 3)."""
    move = np.zeros(parameters.size)
    move[-1] = step
    return (_residual(problem, parameters - move) - _residual(problem, parameters + move)) / (2 * step)


def _robust_variance(residual: Array) -> Array:
    return np.asarray((1.4826 * np.median(np.abs(residual - np.median(residual, axis=0)), axis=0)) ** 2)


def _robust_start(problem: _Problem) -> Array:
    yaw = problem.track.angles(problem.stamps + problem.start)[:, 0]
    azimuth, elevation, distance = np.median(problem.seen + np.outer(yaw, [1, 0, 0]), axis=0)
    start = np.array([azimuth, distance, 0.0, 0.0, distance * np.sin(elevation), 0.0, 0.0, 0.0])
    scale = np.sqrt(_robust_variance(_residual(problem, start)))
    prior = np.array([*PRIOR_SD, np.inf])
    return np.asarray(
        least_squares(
            lambda values: np.append(_residual(problem, values) / scale, values / prior),
            start,
            loss="soft_l1",
            x_scale=_SCALE,
        ).x
    )


_SCALE = np.array([0.01, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.01])


def _fitted(problem: _Problem, start: Array, variances: Array, inlier: NDArray[np.bool_]) -> Array:
    weight = np.where(inlier[:, None], 1 / np.sqrt(variances), 0.0)
    prior = np.array([*PRIOR_SD, np.inf])
    return np.asarray(
        least_squares(
            lambda values: np.append(weight * _residual(problem, values), values / prior),
            start,
            method="lm",
            x_scale=_SCALE,
        ).x
    )


def _variances(spread: Spread, slope: Array) -> Array:
    """Variance of each residual: noise, and the stamp's jitter times the apparent motion, shape (K, 3)."""
    return np.asarray(spread.variance[:3] + slope**2 * spread.variance[3])


def _estimated_spread(residual: Array, slope: Array) -> Spread:
    """Estimate the four variances by Fisher scoring: squared residuals regressed on what they are expected to be."""
    count, squares = len(residual), residual**2
    of_each = np.zeros((count, 3, 4))
    of_each[:, [0, 1, 2], [0, 1, 2]] = 1.0
    of_each[:, :, 3] = slope**2
    design, squares = of_each.reshape(-1, 4), squares.reshape(-1)
    variance = np.append(np.mean(residual**2, axis=0), 0.0)
    floor = 1e-6 * variance[:3]
    for _ in range(50):
        weight = 1 / (design @ variance) ** 2
        new = _non_negative(design, squares, weight)
        new[:3] = np.maximum(new[:3], floor)
        settled = np.allclose(new, variance, rtol=1e-6, atol=0.0)
        variance = new
        if settled:
            break
    expected = design @ variance
    weight = 1 / expected**2
    bread = np.linalg.inv(_scaled_normal(design, weight))
    score = (design * (weight * (squares - expected))[:, None]).reshape(count, 3, 4).sum(axis=1)
    return Spread(variance, np.sqrt(np.diag(bread @ (score.T @ score) @ bread)))


def _scaled_normal(design: Array, weight: Array) -> Array:
    normal = design.T @ (weight[:, None] * design)
    # Without any apparent motion the jitter has no equation; a tiny diagonal leaves it unknown, not the rest.
    return np.asarray(normal + np.diag(1e-9 * np.diag(normal) + 1e-300))


def _non_negative(design: Array, squares: Array, weight: Array) -> Array:
    """Solve the weighted normal equations; a negative variance of the stamps becomes zero, and the rest follows."""
    solution = np.linalg.solve(_scaled_normal(design, weight), design.T @ (weight * squares))
    if solution[3] < 0:
        rest = design[:, :3]
        solution = np.append(np.linalg.solve(_scaled_normal(rest, weight), rest.T @ (weight * squares)), 0.0)
    return np.asarray(solution)


def _assembled(problem: _Problem, parameters: Array, spread: Spread, inlier: NDArray[np.bool_]) -> PlateAlignment:
    residual, slope = _residual(problem, parameters), _slope(problem, parameters)
    weight = np.where(inlier[:, None], 1 / _variances(spread, slope), 0.0)
    jacobian = _jacobian(problem, parameters)
    bread = np.linalg.inv(
        np.einsum("kcp,kc,kcq->pq", jacobian, weight, jacobian) + np.diag([*(1 / np.array(PRIOR_SD) ** 2), 0.0])
    )
    score = np.einsum("kcp,kc->kp", jacobian, weight * residual)[inlier]
    covariance = bread @ (long_run_covariance(score) * len(score)) @ bread
    drift, drift_sd = _drift(problem.stamps, residual, jacobian, weight)
    offset = problem.start + float(parameters[-1])
    return PlateAlignment(
        offset=offset,
        offset_sd=float(np.sqrt(covariance[-1, -1])),
        sighting=Sighting(*parameters[:-1]),
        spread=spread,
        moments=problem.stamps + offset,
        residual=residual,
        inlier=inlier,
        drift=drift,
        drift_sd=drift_sd,
    )


def _jacobian(problem: _Problem, parameters: Array) -> Array:
    """Return how the modelled values change with the parameters, shape (K, 3, 8), by central differences."""
    steps = 1e-2 * _SCALE
    columns = []
    for index, step in enumerate(steps):
        move = np.zeros(parameters.size)
        move[index] = step
        columns.append((_residual(problem, parameters - move) - _residual(problem, parameters + move)) / (2 * step))
    return np.stack(columns, axis=-1)


def _drift(stamps: Array, residual: Array, jacobian: Array, weight: Array) -> tuple[float, float]:
    """Take one Gauss–Newton step with a drift of the camera's clock as a further parameter."""
    ramp = (stamps - stamps.mean())[:, None] * jacobian[:, :, -1]
    design = np.concatenate([jacobian, ramp[:, :, None]], axis=-1)
    scale = np.array([*_SCALE, 1e-3])
    normal = np.einsum("kcp,kc,kcq->pq", design * scale, weight, design * scale)
    normal += np.diag(np.append((scale[:-1] / np.array([*PRIOR_SD, np.inf])) ** 2, 0.0))
    inverse = np.linalg.inv(normal)
    step = inverse @ np.einsum("kcp,kc->p", design * scale, weight * residual)
    return float(step[-1] * scale[-1]), float(np.sqrt(inverse[-1, -1]) * scale[-1])


def deviation_interval(variance: float, error: float) -> Interval:
    """Return the 95 % interval of a standard deviation from its square and that square's standard error."""
    if variance > 2 * error:
        # The logarithm of a variance is nearly normal long before the variance is.
        half = Z95 * error / variance
        return float(np.sqrt(variance * np.exp(-half))), float(np.sqrt(variance * np.exp(half)))
    return 0.0, float(np.sqrt(variance + Z95 * error))

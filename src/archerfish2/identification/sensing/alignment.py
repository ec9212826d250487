"""Time offset, geometry and detection noise from a plate at rest while the gimbal sweeps, by restricted likelihood.

Detections scatter in azimuth, elevation and range. A jitter of the stamps moves them along the plate's apparent motion,
which separates it from the noise of the detection: it acts only where the gimbal turns.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import f as fisher

from archerfish2.errors import InputError
from archerfish2.identification.sensing.timing import deviation_estimate, normal_estimate
from archerfish2.identification.sensing.track import GimbalTrack
from archerfish2.identification.statistics import Array, VarianceComponents, long_run_covariance, variance_components
from archerfish2.reports.table import Estimate

STEP_S, NEAR_S = 0.005, 1.0
"""Distance of the offsets of the scan, and the largest of them where the clocks of both logs overlap [s]."""
_AMBIGUOUS, _APART_S = 1.5, 0.05
"""A misfit below so many times the least, so far from it, is another solution."""
_OUTLIER = 5.0  # standard deviations in any direction from which it is not the plate: 2 in a million
_ROUNDS = 30

# Parameters: azimuth of the plate in the base frame less the camera's on the gimbal, horizontal distance of the plate
# from the pivot, position of the pivot in the camera's frame (x, y, z; z with the plate's height, which a sweep in yaw
# can't separate), tilt and roll of the camera on the gimbal, and the time offset.
_SCALE = np.array([0.01, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.01])
_PRIOR_SD = np.array([np.inf, np.inf, 0.3, 0.3, np.inf, 0.2, 0.2, np.inf]) / _SCALE
"""A camera sits within about a hand's breadth of the pivot, roughly level. Small sweeps leave this undetermined, and
without it the fit would explain noise by a camera metres away."""
_HELD = np.isfinite(_PRIOR_SD)


class OffsetScan(NamedTuple):
    """How well the azimuth mirrors the yaw at each offset."""

    offset: Array  # what is added to the stamps of detections [s], (M,)
    misfit: Array  # robust standard deviation of azimuth plus yaw [rad], (M,)
    best: float  # offset of the least misfit [s]


class Alignment(NamedTuple):
    """How detections of a plate at rest lie on the gimbal's log."""

    offset: Estimate  # what is added to a stamp to get the moment of exposure on the gimbal log's clock [s]
    noise: tuple[Estimate, ...]  # standard deviations: azimuth, elevation [rad], range [m], stamps [s]
    drift: Estimate  # rate of the camera's clock against the gimbal log's, less 1
    moments: Array  # of the detections on the gimbal log's clock [s], (K,)
    residual: Array  # measured less modelled azimuth, elevation [rad] and range [m], (K, 3)
    inlier: Array  # whether a detection is the plate, (K,)
    motion_share: float  # of the azimuth residual's power, that the gimbal's motion explains
    motion_p: float  # probability of as much if the alignment were right (F test)


def scan_offsets(
    track: GimbalTrack, time: Array, azimuth: Array, limit_s: float | None = None, apart_s: float = 0.0
) -> OffsetScan:
    """Find where the plate's azimuth best mirrors the yaw, to `STEP_S`.

    Args:
      track: the gimbal.
      time: stamps of the detections, on the camera's clock [s], shape (K,).
      azimuth: of the plate in the camera's frame [rad], shape (K,).
      limit_s: largest offset of the clocks [s]; `NEAR_S` if not given and the clocks overlap, else any.
      apart_s: offset of these stamps where that of the clocks is 0: the camera's origin less the gimbal log's [s].

    Raises:
      InputError: if the logs can't overlap, or the azimuth mirrors the yaw at no offset, or at several.
    """
    slack = 0.2 * (time[-1] - time[0])
    low, high = track.time[0] - time[0] - slack, track.time[-1] - time[-1] + slack
    limit = limit_s or (NEAR_S if low <= apart_s <= high else np.inf)
    low, high = max(low, apart_s - limit), min(high, apart_s + limit)
    if low > high:
        problem = f"the gimbal log ({np.ptp(track.time):.1f} s) does not cover the detections ({np.ptp(time):.1f} s)"
        remedy = "log the gimbal before, during and after the sweep, or raise max_offset_s"
        raise InputError(f"{problem} at any offset within ±{limit:g} s; {remedy}", "no-overlap")
    offsets = np.arange(np.floor(low / STEP_S), np.ceil(high / STEP_S) + 1) * STEP_S
    # A few detections of something else must not steer the search.
    reach = 3 * _robust_sd(azimuth)
    clipped = np.clip(azimuth, np.median(azimuth) - reach, np.median(azimuth) + reach)
    misfit, lines = np.full(offsets.size, np.inf), np.zeros((offsets.size, 2))
    for place, offset in enumerate(offsets):
        moments = time + offset
        inside = (moments >= track.time[0]) & (moments <= track.time[-1])
        if inside.sum() >= 10:
            yaw = np.interp(moments[inside], track.time, track.yaw)
            covariance = np.cov(yaw, clipped[inside])
            scale = np.maximum([np.sqrt(covariance[0, 0] * covariance[1, 1]), covariance[0, 0]], 1e-300)
            misfit[place], lines[place] = _robust_sd(azimuth[inside] + yaw), covariance[0, 1] / scale
    _check_mirror(*lines[np.argmax(np.abs(lines[:, 0]))])
    best = int(np.argmin(misfit))
    other = np.where(np.abs(offsets - offsets[best]) > _APART_S, misfit, np.inf)
    if other.min() < _AMBIGUOUS * misfit[best]:
        problem = "offsets of {:.3f} s and {:.3f} s fit alike".format(*offsets[[best, np.argmin(other)]] - apart_s)
        remedy = "record a sweep whose frequency changes, or narrow max_offset_s"
        raise InputError(f"the sweep repeats itself: {problem}; {remedy}", "ambiguous-offset")
    return OffsetScan(offsets, misfit, float(offsets[best]))


def _robust_sd(values: Array) -> Array:
    return np.asarray(1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0))


def _check_mirror(correlation: float, slope: float) -> None:
    if correlation < -0.9 and -1.4 < slope < -0.7:
        return
    problem, remedy = f"moves by {slope:.3g} times the yaw, expected about -1", "check units and the lens' calibration"
    if abs(correlation) < 0.9:
        problem = f"follows the yaw at no offset (correlation {correlation:.2f} at best)"
        remedy = "keep the plate still, sweep by more than 10° and pass the two logs of one recording"
    elif 0.7 < slope < 1.4:
        problem, remedy = "moves with the yaw, not against it", "turn the sign of one, or name the detections' frame"
    elif 0.7 < np.radians(abs(slope)) < 1.4 or 0.7 < np.degrees(abs(slope)) < 1.4:
        remedy = "check whether the gimbal's angles are in degrees"
    raise InputError(f"the plate's bearing {problem}; {remedy}", "no-alignment")


def spherical(position: Array) -> Array:
    """Return azimuth, elevation [rad] and range [m] of positions of shape B + (3,), in the same shape."""
    x, y, z = np.moveaxis(position, -1, 0)
    level = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), np.arctan2(z, level), np.hypot(level, z)], axis=-1)


def plate_in_camera(geometry: Array, yaw: Array, pitch: Array) -> Array:
    """Return where a plate at rest is in the camera's frame [m].

    Args:
      geometry: azimuth, distance, x, y, z, tilt and roll as above [rad, m], shape (7,).
      yaw: of the gimbal [rad], shape B.
      pitch: of the gimbal [rad], shape B.

    Returns:
      Shape B + (3,).
    """
    azimuth, distance, x, y, z, tilt, roll = geometry
    forward, left = distance * np.cos(azimuth - yaw), distance * np.sin(azimuth - yaw)
    up, cos, sin = -np.sin(pitch + tilt) * forward, np.cos(roll), np.sin(roll)
    return np.stack([np.cos(pitch + tilt) * forward + x, cos * left + sin * up + y, cos * up - sin * left + z], axis=-1)


def align(track: GimbalTrack, time: Array, position: Array, start: float) -> Alignment:
    """Fit offset, geometry and noise to the detections of a plate at rest.

    Args:
      track: the gimbal.
      time: stamps of the detections, on the camera's clock [s], shape (K,), all inside the gimbal log at `start`.
      position: of the plate in the camera's frame [m], shape (K, 3).
      start: rough offset [s].

    Raises:
      InputError: if fewer than half of the detections are of one plate at rest.
    """
    measured = spherical(position)

    def residual(x: Array) -> Array:
        values = x * _SCALE
        angles = track.angles(time + (start + values[-1]))
        left = measured - spherical(plate_in_camera(values[:-1], *angles.T))
        left[:, 0] = (left[:, 0] + np.pi) % (2 * np.pi) - np.pi
        return left

    def slopes(x: Array) -> Array:
        moves = 1e-2 * np.eye(x.size)
        return np.stack([(residual(x - each) - residual(x + each)) / 2e-2 for each in moves], axis=-1)

    azimuth, elevation, distance = np.median(measured + np.outer(track.angles(time + start)[:, 0], [1, 0, 0]), axis=0)
    x = np.array([azimuth, distance, 0, 0, distance * np.sin(elevation), 0, 0, 0]) / _SCALE
    unit = _robust_sd(residual(x))
    x = least_squares(lambda each: np.append(residual(each) / unit, each / _PRIOR_SD), x, loss="soft_l1").x
    sd, inlier = np.broadcast_to(_robust_sd(residual(x)), measured.shape), np.zeros(time.size, dtype=bool)
    for _ in range(_ROUNDS):
        left, slope, last = residual(x), slopes(x), inlier
        inlier = np.all(np.abs(left) < _OUTLIER * sd, axis=1)
        if inlier.mean() < 0.5:
            problem = f"only {inlier.mean():.0%} of the detections fit one plate at rest"
            raise InputError(f"{problem}; keep plate and robot still, one plate in view", "not-one-plate")
        fit = _step(left[inlier] / unit, slope[inlier] / unit[:, None], x)
        variance = fit.variances * np.append(unit**2, _SCALE[-1] ** 2)
        sd, x = np.sqrt(variance[:3] + (slope[..., -1] / _SCALE[-1]) ** 2 * variance[3]), x + fit.coefficients
        if np.array_equal(inlier, last) and np.all(fit.coefficients**2 < 1e-4 * np.diag(fit.covariance)):
            break
    left, rows = residual(x), slopes(x) / sd[..., None]
    score = np.einsum("kcp,kc->kp", rows, left / sd)[inlier]
    covariance = fit.covariance @ (long_run_covariance(score) * len(score)) @ fit.covariance
    ramp = (time - time.mean())[:, None] * rows[..., -1]
    design = np.concatenate([rows, ramp[..., None]], axis=-1)[inlier].reshape(-1, 9)
    bread = np.linalg.inv(design.T @ design + np.diag(np.append(_PRIOR_SD**-2.0, 0.0))) * _SCALE[-1]
    drift = bread[-1] @ (design.T @ (left / sd)[inlier].reshape(-1))
    offset = start + float(x[-1] * _SCALE[-1])
    errors = np.sqrt(np.diag(fit.variances_covariance)) * np.append(unit**2, _SCALE[-1] ** 2)
    return Alignment(
        normal_estimate(offset, float(np.sqrt(covariance[-1, -1]) * _SCALE[-1])),
        tuple(map(deviation_estimate, variance.tolist(), errors.tolist(), ("rad", "rad", "m", "s"))),
        normal_estimate(float(drift), float(np.sqrt(bread[-1, -1] * _SCALE[-1])), ""),
        time + offset,
        left,
        inlier,
        *_motion_share(track, (time + offset)[inlier], left[inlier, 0]),
    )


def _step(residual: Array, slopes: Array, x: Array) -> VarianceComponents:
    """Take a Gauss–Newton step, by whose residuals the four variances are estimated.

    Args:
      residual: in robust standard deviations, shape (K, 3).
      slopes: of the modelled values over the parameters, shape (K, 3, 8).
      x: parameters, shape (8,).
    """
    scales = np.zeros((*residual.shape, 4))
    scales[:, range(3), range(3)], scales[..., 3] = 1.0, slopes[..., -1] ** 2
    held = np.diag(np.ones(x.size))[_HELD]
    return variance_components(
        np.append(residual, -x[_HELD]),
        np.concatenate([slopes.reshape(-1, x.size), held]),
        np.concatenate([scales.reshape(-1, 4), np.zeros((len(held), 4))]),
        np.append(np.zeros(residual.size), _PRIOR_SD[_HELD] ** 2),
    )


def _motion_share(track: GimbalTrack, moments: Array, residual: Array) -> tuple[float, float]:
    """Regress the azimuth's residual on angle (to the third power), rate, its size, and acceleration.

    Noise of a detector is independent of the gimbal's motion. A lens that distorts bends the bearing with the angle, an
    offset that drifts or an angle that lags moves it with the rate and its change.
    """
    angle, rate, change = (track.angles(moments, order)[:, 0] for order in range(3))
    columns = np.column_stack([np.ones_like(angle), angle, angle**2, angle**3, rate, np.abs(rate), change])
    left = residual - columns @ np.linalg.lstsq(columns, residual)[0]
    freedom, terms = residual.size - columns.shape[1], columns.shape[1] - 1
    unexplained = max(float(left @ left), 1e-300) / max(float(np.sum((residual - residual.mean()) ** 2)), 1e-300)
    ratio = (1 / unexplained - 1) * freedom / terms
    return max(1 - unexplained * (residual.size - 1) / freedom, 0.0), float(fisher.sf(ratio, terms, freedom))

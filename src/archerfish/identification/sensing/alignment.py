"""Time offset, geometry and detection noise from a plate at rest while the gimbal sweeps, by restricted likelihood.

A gimbal log is interpolated, so that it gives angles at the moments of the detections.

Detections scatter in azimuth, elevation and range. A jitter of the stamps moves them along the plate's apparent motion,
which separates it from the noise of the detection: it acts only where the gimbal turns.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from archerfish.dynamics.aiming import line_of_sight
from archerfish.errors import file_error
from archerfish.identification import statistics
from archerfish.identification.statistics import Array
from archerfish.logs.recording import by_lines
from archerfish.logs.timing import GimbalLog
from archerfish.reports.table import Estimate

_SMOOTHED_S = 0.025  # span of the local cubics: a gimbal moves at some 10 Hz and below, where they are exact to 0.1 %
_HELD_SHARE = 0.2  # of repeated angles during motion, from which the feedback is slower than the log
_GAP_S, _GAP = 0.05, 3.0  # longest intervals that are no gap: in seconds, and in median intervals
GRID_STEP_S, NEAR_S = 0.005, 1.0
"""Step of the search for the offset, and the largest offset where the clocks of both logs overlap [s]."""
_MIRRORED, _AMBIGUOUS, _APART_S = 0.4, 1.5, 0.05
"""Largest misfit, as a share of the azimuth's scatter; a misfit below so many times the least one, at an offset so far
from it [s], makes the offset ambiguous."""
_OUTLIER = 5.0  # standard deviations in one coordinate beyond which it is not the plate: 1 in 2 million
_INSIGNIFICANT = 11.5
"""Explained power above its mean, in that of the residual per degree of freedom, that 1 in 100 right alignments exceed
by chance (χ² of 7 terms)."""
_LEAST_SD = 1e-9  # of a coordinate [rad, m], so that one without noise has a weight
_NOISE = {"bearing_sd": "rad", "elevation_sd": "rad", "range_sd": "m", "stamp_jitter": "s"}

# Parameters: azimuth of the plate in the base frame less the camera's on the gimbal, horizontal distance of the plate
# from the pivot, position of the pivot in the camera's frame (x, y, z; z with the plate's height, which a sweep in yaw
# can't separate), tilt and roll of the camera on the gimbal, and the time offset.
_PRIOR_SD = np.array([np.inf, np.inf, 0.3, 0.3, np.inf, 0.2, 0.2, np.inf])
"""A camera sits within about a hand's breadth of the pivot, roughly level. Small sweeps leave this undetermined, and
without it the fit would explain noise by a camera metres away."""


class GimbalTrack(NamedTuple):
    """A gimbal's angles between samples."""

    time: Array  # moments of the nodes [s], (N,)
    angles: Any  # spline, moments (...) → yaw and pitch (..., 2) [rad]
    stamps: Array  # of the log's samples [s], (M,)
    rate_hz: float  # at which the logged yaw is refreshed [Hz]
    quantum: float | None  # step of the logged yaw [rad], where it is visible
    unbroken: Any  # whether the log has no gap before each stamp, (M + 1,); false at its ends

    def covers(self, moments: Array) -> Any:
        """Return at which moments, shape (K,), the log has angles: neither outside it nor in a gap; shape (K,)."""
        return self.unbroken[np.searchsorted(self.stamps, moments)]


def gimbal_track(log: GimbalLog) -> GimbalTrack:
    """Interpolate a log's fresh angles by cubics; where they are dense, smooth the encoder's steps first.

    Raises:
      InputError: if the log has fewer than 20 samples or its yaw never changes.
    """
    time, yaw = np.asarray(log.time, float), np.asarray(log.yaw, float)
    if time.size < 20 or np.ptp(yaw) == 0:
        problem = f"the yaw has {np.unique(yaw).size} values in {time.size} samples"
        raise file_error(log.source, problem, "log at least 20, in which it moves", "no-motion")
    quantum, fresh, changed = quantum_of(yaw), np.ones(time.size, dtype=bool), np.diff(yaw) != 0
    # Neighbouring samples may agree only because an angle is rounded; not while it crosses several steps per sample.
    period = float(np.median(np.diff(time)))
    reach = max(int(_SMOOTHED_S / period), 2)
    speed = np.abs(yaw[2 * reach :] - yaw[: -2 * reach]) / (2 * reach)
    moving = np.pad(speed > 2 * (quantum or 1e-9), reach)[1:]
    repeated = float(np.mean(~changed[moving])) if moving.sum() >= 20 else 0.0
    rate = (time.size - 1) / float(time[-1] - time[0])
    if repeated > _HELD_SHARE:
        fresh[1:], rate = changed | ~moving, (1 - repeated) / period
    nodes, angles = time[fresh], np.column_stack([yaw, log.pitch])[fresh]
    count = int(_SMOOTHED_S / float(np.median(np.diff(nodes)))) // 2 * 2 + 1
    if 7 <= count < nodes.size:
        even = np.linspace(nodes[0], nodes[-1], nodes.size)
        nodes, angles = even, savgol_filter(by_lines(nodes, angles, even), count, 3, axis=0)
    unbroken = np.diff(time, prepend=-np.inf, append=np.inf) <= max(_GAP_S, _GAP * period)
    return GimbalTrack(nodes, CubicSpline(nodes, angles), time, rate, quantum, unbroken)


def quantum_of(values: Array) -> float | None:
    """Return the step of which all differences of values of shape (N,) are multiples; None if there are too many."""
    gaps = np.diff(np.unique(values))
    gaps = gaps[gaps > 1e-9]
    if gaps.size < 2:
        return None
    quantum = float(np.mean(gaps[gaps < 1.5 * gaps.min()]))  # printing rounds: the smallest gaps scatter about the step
    steps = gaps / quantum
    return quantum if np.mean(np.abs(steps - np.round(steps)) < 0.2) > 0.95 else None


class Alignment(NamedTuple):
    """Detections of a plate at rest aligned with the gimbal's log, which covers K of them."""

    estimates: dict[str, Estimate]  # of time offset, noise and outliers, by the names of the record
    moments: Array  # of the detections on the gimbal log's clock [s], (K,)
    residual: Array  # measured less modelled azimuth, elevation [rad] and range [m], (K, 3)
    inlier: Array  # whether a detection is the plate, (K,)
    motion_share: float  # of the azimuth residual's power, that the gimbal's motion explains; 0 if insignificant
    drift: float  # rate of the camera's clock against the gimbal log's, less 1


def rough_offset(
    track: GimbalTrack, time: Array, azimuth: Array, limit_s: float | None = None, source: str = "plate"
) -> float:
    """Find the offset at which the plate's azimuth best mirrors the yaw, to `GRID_STEP_S`.

    Args:
      track: the gimbal.
      time: stamps of the detections, on the camera's clock [s], shape (K,).
      azimuth: of the plate in the camera's frame [rad], shape (K,).
      limit_s: largest offset [s]; `NEAR_S` where the clocks overlap, else any, if None.
      source: name of the detections' log, for messages.

    Returns:
      What is added to the stamps [s].

    Raises:
      InputError: if the gimbal log covers fewer than 20 detections at every offset, or the azimuth mirrors the yaw at
        no offset, or at several.
    """
    slack = 0.2 * (time[-1] - time[0])
    low, high = track.time[0] - time[0] - slack, track.time[-1] - time[-1] + slack
    limit = limit_s or (NEAR_S if low <= 0 <= high else np.inf)
    steps = np.arange(np.floor(max(low, -limit) / GRID_STEP_S), np.ceil(min(high, limit) / GRID_STEP_S) + 1)
    offsets, yaws = steps * GRID_STEP_S, track.angles(track.time)[:, 0]
    misfit = np.full(offsets.size, np.inf)
    for place, offset in enumerate(offsets):
        covered = track.covers(time + offset)
        if covered.sum() >= 20:
            misfit[place] = _robust_sd(azimuth[covered] + np.interp((time + offset)[covered], track.time, yaws))
    if np.all(misfit == np.inf):
        problem = f"the gimbal log covers fewer than 20 detections at any offset within ±{limit:g} s"
        raise file_error(source, problem, "log both at once, for longer, or raise max_offset_s", "no-overlap")
    best, motion = int(np.argmin(misfit)), _robust_sd(azimuth)
    if misfit[best] > _MIRRORED * motion:
        ratio = motion / _robust_sd(yaws)
        problem = f"the plate's bearing mirrors the yaw at no offset, and moves by {ratio:.3g} times as much"
        remedy = "check signs, frame and degrees ([sensing] in logs.toml), and that the plate was at rest"
        raise file_error(source, problem, remedy, "no-alignment")
    other = np.where(np.abs(offsets - offsets[best]) > _APART_S, misfit, np.inf)
    if other.min() < _AMBIGUOUS * misfit[best]:
        problem = f"the sweep repeats itself, {offsets[best]:.3f} s and {offsets[np.argmin(other)]:.3f} s fit alike"
        remedy = (
            "sweep through several frequencies (archerfish excite yaw), narrow max_offset_s, or log receive_s, which "
        )
        remedy += "shows frames that were dropped and a clock that was set"
        raise file_error(source, problem, remedy, "ambiguous-offset")
    return float(offsets[best])


def _robust_sd(values: Array) -> Array:
    found = 1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0)
    # Of coarsely rounded values most may be equal.
    return np.asarray(np.maximum(np.where(found > 0, found, values.std(axis=0)), _LEAST_SD))


def spherical(position: Array) -> Array:
    """Return azimuth, elevation [rad] and range [m] of positions of shape B + (3,), in the same shape."""
    pitch, yaw = np.moveaxis(line_of_sight(position), -1, 0)
    return np.stack([yaw, pitch, np.linalg.norm(position, axis=-1)], axis=-1)


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
      time: stamps of the detections, on the camera's clock [s], shape (N,).
      position: of the plate in the camera's frame [m], shape (N, 3).
      start: rough offset [s].
    """
    covered = track.covers(time + start)
    moments, measured = time[covered] + start, spherical(position[covered])

    def residual(x: Array) -> Array:
        angles = track.angles(moments + x[-1])
        return np.asarray(measured - spherical(plate_in_camera(x[:-1], *angles.T)))

    def weighted(x: Array, weight: Array) -> Array:
        return np.append(weight * residual(x), x / _PRIOR_SD)

    azimuth, elevation, distance = np.median(measured + np.outer(track.angles(moments)[:, 0], [1, 0, 0]), axis=0)
    x = np.array([azimuth, distance, 0, 0, distance * np.sin(elevation), 0, 0, 0])
    sd, inlier = np.broadcast_to(_robust_sd(residual(x)), measured.shape), np.ones(len(measured), bool)
    for loss in ("soft_l1", "linear", "linear"):
        x = least_squares(weighted, x, loss=loss, x_scale="jac", args=(inlier[:, None] / sd,)).x
        left = residual(x)
        slope = np.stack([(residual(x - h) - residual(x + h)) / 2e-4 for h in 1e-4 * np.eye(x.size)], axis=-1)
        sd = np.broadcast_to(_robust_sd(left), measured.shape) if loss == "soft_l1" else sd
        inlier = np.all(np.abs(left) < _OUTLIER * sd, axis=1)
        columns = slope[inlier].reshape(-1, x.size)
        scales = np.column_stack([np.tile(np.eye(3), (inlier.sum(), 1)), columns[:, -1] ** 2])
        noise = statistics.variance_components(left[inlier].ravel(), columns, scales)
        sd = np.sqrt(noise.variances[:3] + slope[..., -1] ** 2 * noise.variances[3] + _LEAST_SD**2)
    errors = np.sqrt(np.diag(noise.variances_covariance))
    found = {"camera.outlier_share": statistics.share_estimate(int(np.sum(~inlier)), inlier.size)}
    for (name, unit), variance, error in zip(_NOISE.items(), noise.variances, errors, strict=True):
        found[f"camera.{name}"] = statistics.deviation_estimate(float(variance), float(error), unit)
    rows = slope[inlier] / sd[inlier, :, None]
    bread = np.linalg.inv(np.einsum("kcp,kcq->pq", rows, rows) + np.diag(_PRIOR_SD**-2.0))
    score = np.einsum("kcp,kc->kp", rows, (left / sd)[inlier])
    spread = len(score) * bread @ statistics.long_run_covariance(score) @ bread
    found["camera.time_offset"] = statistics.normal_estimate(start + x[-1], np.sqrt(spread[-1, -1]))
    found["camera.noise_range"] = Estimate(float(np.median(measured[inlier, 2])), np.nan, np.nan, "m")
    moments = moments + x[-1]
    return Alignment(found, moments, left, inlier, *_motion_share(track, moments[inlier], left[inlier, 0]))


def _motion_share(track: GimbalTrack, moments: Array, residual: Array) -> tuple[float, float]:
    """Regress the azimuth's residual on the angle's powers, rate, speed, acceleration and a drift of the offset.

    Noise of a detector is independent of the gimbal's motion. A lens that distorts bends the bearing with the angle, an
    offset that drifts or an angle that lags moves it with the rate and its change.
    """
    angle, rate, change = (track.angles(moments, order)[:, 0] for order in range(3))
    ramp = -rate * (moments - moments.mean())
    columns = np.column_stack([np.ones_like(angle), angle, angle**2, angle**3, rate, np.abs(rate), change, ramp])
    solution, freedom = np.linalg.lstsq(columns, residual)[0], len(columns) - columns.shape[1]
    unexplained = np.var(residual - columns @ solution) / max(np.var(residual), 1e-300)
    share = float(1 - unexplained * (len(columns) - 1) / freedom)
    return share if share > _INSIGNIFICANT / freedom else 0.0, float(solution[-1])

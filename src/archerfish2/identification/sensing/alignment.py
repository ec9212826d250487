"""Time offset, geometry and detection noise from a plate at rest while the gimbal sweeps, by restricted likelihood.

Detections scatter in azimuth, elevation and range. A jitter of the stamps moves them along the plate's apparent motion,
which separates it from the noise of the detection: it acts only where the gimbal turns.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import f as fisher

from archerfish2.errors import InputError
from archerfish2.identification import statistics
from archerfish2.identification.sensing.track import GimbalTrack
from archerfish2.identification.statistics import Array
from archerfish2.reports.style import new_figure, plot_style
from archerfish2.reports.table import Estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP_S, NEAR_S = 0.005, 1.0
"""Distance of the offsets of the scan, and the largest of them where the clocks of both logs overlap [s]."""
_MIRRORED, _AMBIGUOUS, _APART_S = 0.4, 1.5, 0.05
"""Largest misfit for the azimuth's motion; a misfit below so many times the least, so far from it, is another."""
_OUTLIER, _ROUNDS = 5.0, 3  # standard deviations in a direction from which it is not the plate: 2 in a million

# Parameters: azimuth of the plate in the base frame less the camera's on the gimbal, horizontal distance of the plate
# from the pivot, position of the pivot in the camera's frame (x, y, z; z with the plate's height, which a sweep in yaw
# can't separate), tilt and roll of the camera on the gimbal, and the time offset.
_SCALE = np.array([0.01, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.01])
_PRIOR_SD = np.array([np.inf, np.inf, 0.3, 0.3, np.inf, 0.2, 0.2, np.inf]) / _SCALE
"""A camera sits within about a hand's breadth of the pivot, roughly level. Small sweeps leave this undetermined, and
without it the fit would explain noise by a camera metres away."""


class Alignment(NamedTuple):
    """How detections of a plate at rest lie on the gimbal's log."""

    estimates: dict[str, Estimate]  # of time offset and noise, by the names of the record
    moments: Array  # of the detections on the gimbal log's clock [s], (K,)
    residual: Array  # measured less modelled azimuth, elevation [rad] and range [m], (K, 3)
    inlier: Array  # whether a detection is the plate, (K,)
    motion_share: float  # of the azimuth residual's power, that the gimbal's motion explains
    motion_p: float  # probability of as much if the alignment were right (F test)
    drift: float  # rate of the camera's clock against the gimbal log's, less 1, by that regression


def scan_offsets(track: GimbalTrack, time: Array, azimuth: Array, limit_s: float = 0.0, apart_s: float = 0.0) -> Array:
    """Find where the plate's azimuth best mirrors the yaw.

    Args:
      track: the gimbal.
      time: stamps of the detections, on the camera's clock [s], shape (K,).
      azimuth: of the plate in the camera's frame [rad], shape (K,).
      limit_s: largest offset of the clocks [s]; if 0 it is `NEAR_S` where the clocks overlap, else any.
      apart_s: offset of these stamps where that of the clocks is 0: the camera's origin less the gimbal log's [s].

    Returns:
      Offsets, what is added to the stamps [s], and at each the robust standard deviation of azimuth plus yaw [rad],
      shape (2, M).

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
    yaws, misfit = track.angles(track.time)[:, 0], np.full(offsets.size, np.inf)
    for place, offset in enumerate(offsets):
        inside = (time + offset >= track.time[0]) & (time + offset <= track.time[-1])
        if inside.sum() >= 10:
            misfit[place] = _robust_sd(azimuth[inside] + np.interp((time + offset)[inside], track.time, yaws))
    best, motion = int(np.argmin(misfit)), _robust_sd(azimuth)
    if misfit[best] > _MIRRORED * motion:
        problem = f"does not mirror the yaw at any offset, and moves by {motion / _robust_sd(yaws):.3g} times as much"
        remedy = "check signs and the frame, whether angles are in degrees, and that the plate was at rest"
        raise InputError(f"the plate's bearing {problem}; {remedy}", "no-alignment")
    other = np.where(np.abs(offsets - offsets[best]) > _APART_S, misfit, np.inf)
    if other.min() < _AMBIGUOUS * misfit[best]:
        problem = "offsets of {:.3f} s and {:.3f} s fit alike".format(*offsets[[best, int(np.argmin(other))]] - apart_s)
        remedy = "record a sweep whose frequency changes, or narrow max_offset_s"
        raise InputError(f"the sweep repeats itself: {problem}; {remedy}", "ambiguous-offset")
    return np.stack([offsets, misfit])


def _robust_sd(values: Array) -> Array:
    return np.asarray(1.4826 * np.median(np.abs(values - np.median(values, axis=0)), axis=0))


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
        return np.asarray(measured - spherical(plate_in_camera(values[:-1], *angles.T)))

    def slopes(x: Array) -> Array:
        moves = 1e-2 * np.eye(x.size)
        return np.stack([(residual(x - each) - residual(x + each)) / 2e-2 for each in moves], axis=-1)

    azimuth, elevation, distance = np.median(measured + np.outer(track.angles(time + start)[:, 0], [1, 0, 0]), axis=0)
    x = np.array([azimuth, distance, 0, 0, distance * np.sin(elevation), 0, 0, 0]) / _SCALE
    unit = _robust_sd(residual(x))
    sd, weight, loss, held = measured, 1 / unit, "soft_l1", np.isfinite(_PRIOR_SD)
    for number in range(_ROUNDS):
        x = least_squares(lambda each: np.append(weight * residual(each), each / _PRIOR_SD), x, loss=loss).x  # noqa: B023
        left, slope = residual(x), slopes(x)
        sd = sd if number else np.broadcast_to(_robust_sd(left), measured.shape)
        inlier = np.all(np.abs(left) < _OUTLIER * sd, axis=1)
        if inlier.mean() < 0.5:
            problem = f"only {inlier.mean():.0%} of the detections fit one plate at rest"
            raise InputError(f"{problem}; keep plate and robot still, one plate in view", "not-one-plate")
        rows = (slope[inlier] / unit[:, None]).reshape(-1, x.size)
        scales = np.column_stack([np.tile(np.eye(3), (inlier.sum(), 1)), rows[:, -1] ** 2])
        fit = statistics.variance_components(
            np.append(left[inlier] / unit, -x[held]),
            np.concatenate([rows, np.eye(x.size)[held]]),
            np.pad(scales, ((0, held.sum()), (0, 0))),
            np.append(np.zeros(len(rows)), _PRIOR_SD[held] ** 2),
        )
        variance = fit.variances * np.append(unit, _SCALE[-1]) ** 2
        sd = np.sqrt(variance[:3] + (slope[..., -1] / _SCALE[-1]) ** 2 * variance[3])
        weight, loss = inlier[:, None] / sd, "linear"
    rows, best = slope / sd[..., None], start + x[-1] * _SCALE[-1]
    score = np.einsum("kcp,kc->kp", rows, left / sd)[inlier]
    spread = fit.covariance @ (statistics.long_run_covariance(score) * len(score)) @ fit.covariance
    errors = np.sqrt(np.diag(fit.variances_covariance)) * np.append(unit, _SCALE[-1]) ** 2
    names = ("bearing_sd", "rad"), ("elevation_sd", "rad"), ("range_sd", "m"), ("stamp_jitter", "s")
    found = {
        f"camera.{name}": statistics.deviation_estimate(float(variance[place]), float(errors[place]), of)
        for place, (name, of) in enumerate(names)
    }
    found["camera.time_offset"] = statistics.normal_estimate(best, np.sqrt(spread[-1, -1]) * _SCALE[-1])
    return Alignment(found, time + best, left, inlier, *_motion_share(track, (time + best)[inlier], left[inlier, 0]))


def _motion_share(track: GimbalTrack, moments: Array, residual: Array) -> tuple[float, float, float]:
    """Regress the azimuth's residual on angle (to the third power), rate, its size, acceleration and an offset's drift.

    Noise of a detector is independent of the gimbal's motion. A lens that distorts bends the bearing with the angle, an
    offset that drifts or an angle that lags moves it with the rate and its change.
    """
    angle, rate, change = (track.angles(moments, order)[:, 0] for order in range(3))
    ramp = -rate * (moments - moments.mean())
    columns = np.column_stack([np.ones_like(angle), angle, angle**2, angle**3, rate, np.abs(rate), change, ramp])
    solution, terms, freedom = np.linalg.lstsq(columns, residual)[0], columns.shape[1] - 1, len(columns) - 8
    unexplained = np.var(residual - columns @ solution) / max(np.var(residual), 1e-300)
    ratio = (1 / max(unexplained, 1e-300) - 1) * freedom / terms
    share = 1 - unexplained * (freedom + terms) / freedom
    return max(float(share), 0.0), float(fisher.sf(ratio, terms, freedom)), float(solution[-1])


def alignment_plot(scan: Array, track: GimbalTrack, alignment: Alignment, *, title: str = "Alignment") -> "Figure":
    """Draw the misfit over the offset, and gimbal and camera in the second of fastest motion; scan of shape (2, M)."""
    with plot_style():
        figure, ((left, right),) = new_figure(1, 2, width=10.0)
        apart = scan[0] - alignment.estimates["camera.time_offset"].value
        left.plot(1e3 * apart[np.abs(apart) < 0.25], 1e3 * scan[1, np.abs(apart) < 0.25])
        left.set(title=title, xlabel="Offset less that of the record [ms]", ylabel="Misfit of bearing and yaw [mrad]")
        rates = np.abs(track.angles(alignment.moments, 1)[:, 0])
        fastest = np.abs(alignment.moments - alignment.moments[np.argmax(rates)]) < 0.5
        time, yaw = alignment.moments[fastest], track.angles(alignment.moments[fastest])[:, 0]
        right.plot(time, np.degrees(yaw), time, np.degrees(yaw - alignment.residual[fastest, 0]), ".")
        right.set(title="Gimbal (line) and camera (dots)", xlabel="Time in the gimbal's log [s]", ylabel="Yaw [°]")
    return figure

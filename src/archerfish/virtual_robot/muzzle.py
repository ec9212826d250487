"""The muzzle: speed with scatter and droop, dispersion, boresight, the barrel's own motion, and its heat."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import MuzzleTable, RefereeTable
from archerfish.virtual_robot.frames import gimbal_axes, into_base

Array = NDArray[np.float64]
Fired = NDArray[np.bool_]
_ROUNDING = 1e-9


class LastShot(NamedTuple):
    """What the last shots of B robots left."""

    time: Array  # of the last shot [s], −∞ before the first, (B,)
    deficit: Array  # speed that its pellet lacked, with what the shot itself took from the wheels [m/s], (B,)
    heat: Array  # right after it, (B,)


class Launch(NamedTuple):
    """Pellets as they leave."""

    position: Array  # of the muzzle in the base frame [m], (B, 3)
    velocity: Array  # of the pellet [m/s], (B, 3)
    speed: Array  # relative to the muzzle, which a speed sensor measures [m/s], (B,)


def deficit_at(muzzle: MuzzleTable, last: LastShot, time: float) -> Array:
    """Return the speed that a pellet fired at a time [s] lacks [m/s], shape (B,)."""
    return np.asarray(last.deficit * np.exp(-(time - last.time) / (1e-3 * muzzle.droop_recovery_ms)))


def heat_at(referee: RefereeTable, last: LastShot, time: float) -> Array:
    """Return the heat at a time [s], shape (B,)."""
    # Before the first shot there is nothing to cool; without cooling it would be zero times an infinite time.
    lost = referee.cooling_per_s * np.where(np.isfinite(last.time), time - last.time, 0.0)
    return np.maximum(last.heat - lost, 0.0)


def allowed(referee: RefereeTable, last: LastShot, time: float) -> Fired:
    """Return which robots may fire at a time [s] by rate and heat, shape (B,)."""
    waited = time - last.time >= 1.0 / referee.max_rate_hz - _ROUNDING
    left = referee.heat_limit - heat_at(referee, last, time)
    return waited & (left >= (1.0 - _ROUNDING) * referee.heat_per_shot)


def after_shot(muzzle: MuzzleTable, referee: RefereeTable, last: LastShot, time: float, fired: Fired) -> LastShot:
    """Return what is left after a time [s] at which some robots fired, shape (B,)."""
    deficit = deficit_at(muzzle, last, time) + muzzle.droop_per_shot_m_s
    heat = heat_at(referee, last, time) + referee.heat_per_shot
    return LastShot(
        np.where(fired, time, last.time), np.where(fired, deficit, last.deficit), np.where(fired, heat, last.heat)
    )


def launch(muzzle: MuzzleTable, deficit: Array, angle: Array, rate: Array, normals: Array) -> Launch:
    """Launch pellets.

    Args:
      muzzle: the muzzle.
      deficit: speed that they lack [m/s], shape (B,).
      angle: true pitch and yaw [rad], shape (B, 2).
      rate: true rates [rad/s], shape (B, 2).
      normals: standard normals of elevation, azimuth and speed, shape (B, 3).
    """
    axes = gimbal_axes(angle)
    sd = np.radians([muzzle.dispersion_pitch_deg, muzzle.dispersion_yaw_deg])
    deflection = np.radians([muzzle.boresight_pitch_deg, muzzle.boresight_yaw_deg]) + sd * normals[:, :2]
    direction = into_base(axes, gimbal_axes(deflection)[:, 0])
    # Turning friction wheels never pull a pellet back in.
    speed = np.maximum(muzzle.speed_m_s - deficit + muzzle.speed_sd_m_s * normals[:, 2], 0.1)
    tip = into_base(axes, np.broadcast_to([muzzle.forward_m, muzzle.left_m, muzzle.up_m], (len(angle), 3)))
    turning = rate[:, 1:] * np.array([0.0, 0.0, 1.0]) - rate[:, :1] * axes[:, 1]
    return Launch(tip, speed[:, None] * direction + np.cross(turning, tip), speed)

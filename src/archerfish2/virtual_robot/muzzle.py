"""The muzzle: speed with scatter and droop, dispersion, boresight, and the barrel's own motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import MuzzleTable
from archerfish2.virtual_robot.frames import gimbal_axes, into_base

Array = NDArray[np.float64]


class Wheels(NamedTuple):
    """The friction wheels, which each shot slows down."""

    deficit: Array
    """Speed that pellets lacked right after the last shot [m/s], shape (B,)."""
    since: Array
    """When that was [s], shape (B,)."""


class Launch(NamedTuple):
    """Pellets as they leave."""

    position: Array
    """Muzzle in the base frame [m], shape (B, 3)."""
    velocity: Array
    """Of the pellet [m/s], shape (B, 3)."""
    speed: Array
    """Relative to the muzzle, which is what a speed sensor shows [m/s], shape (B,)."""


def rested_wheels(batch: int) -> Wheels:
    """Return wheels at full speed, of B robots."""
    return Wheels(np.zeros(batch), np.zeros(batch))


def deficit_at(muzzle: MuzzleTable, wheels: Wheels, time: float) -> Array:
    """Return the speed that a pellet fired at a time [s] lacks [m/s], shape (B,)."""
    return np.asarray(wheels.deficit * np.exp(-(time - wheels.since) / (1e-3 * muzzle.droop_recovery_ms)))


def after_shot(muzzle: MuzzleTable, wheels: Wheels, time: float, fired: NDArray[np.bool_]) -> Wheels:
    """Return the wheels after a time [s] at which some robots fired, shape (B,)."""
    deficit = deficit_at(muzzle, wheels, time) + muzzle.droop_per_shot_m_s
    return Wheels(np.where(fired, deficit, wheels.deficit), np.where(fired, time, wheels.since))


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
    aside = np.radians([muzzle.boresight_pitch_deg, muzzle.boresight_yaw_deg]) + sd * normals[:, :2]
    direction = gimbal_axes(aside)[:, 0]
    # Friction wheels that are still turning never suck a pellet back in.
    speed = np.maximum(muzzle.speed_m_s - deficit + muzzle.speed_sd_m_s * normals[:, 2], 0.1)
    tip = into_base(axes, np.broadcast_to([muzzle.forward_m, muzzle.left_m, muzzle.up_m], (len(angle), 3)))
    turning = rate[:, 1:] * np.array([0.0, 0.0, 1.0]) - rate[:, :1] * axes[:, 1]
    velocity = speed[:, None] * into_base(axes, direction) + np.cross(turning, tip)
    return Launch(tip, velocity, speed)

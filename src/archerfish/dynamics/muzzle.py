"""A pellet at the muzzle: eq (6), with the gimbal's angles and its motion added."""

from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.records.muzzle import MuzzleRecord

NORMALS = 3
"""Standard normals of a pellet: elevation, azimuth, speed; the first three of a decision in every world."""


class Muzzle(NamedTuple):
    """Parameters of the muzzle; each may have a batch shape."""

    speed: Array  # mean muzzle speed [m/s], B
    speed_sd: Array  # standard deviation of the speed [m/s], B
    offset: Array  # mean disturbance angles in pitch and yaw [rad], B + (2,)
    sd: Array  # standard deviations of the disturbance angles [rad], B + (2,)
    drag: Array  # k [1/m], B
    length: Array  # from the pivot to the muzzle [m], B


def muzzle_from_record(record: MuzzleRecord) -> Muzzle:
    """Take the parameters out of a muzzle record."""
    return Muzzle(
        speed=np.asarray(record.speed),
        speed_sd=np.asarray(record.speed_sd),
        offset=np.array([record.pitch_offset, record.yaw_offset]),
        sd=np.array([record.pitch_sd, record.yaw_sd]),
        drag=np.asarray(record.drag),
        length=np.asarray(record.length),
    )


def direction(angle: Array) -> Array:
    """Return the unit vector of a pitch and a yaw [rad], shape B + (2,) → B + (3,); x forward, y left, z up."""
    xp = namespace(angle)
    pitch, yaw = angle[..., 0], angle[..., 1]
    return xp.stack([xp.cos(pitch) * xp.cos(yaw), xp.cos(pitch) * xp.sin(yaw), xp.sin(pitch)], axis=-1)


def pellet_at_muzzle(muzzle: Muzzle, angle: Array, rate: Array, normals: Array) -> tuple[Array, Array]:
    """Position and velocity of a pellet as it leaves the muzzle.

    Eq (6) prints the disturbance angles alone; the gimbal's angles are added to them (docs/paper.md). A muzzle away
    from the pivot moves with the gimbal, which adds ω × r.

    Args:
      muzzle: its parameters.
      angle: pitch and yaw of the gimbal [rad], shape B + (2,).
      rate: their rates [rad/s], shape B + (2,).
      normals: standard, for elevation, azimuth and speed, shape B + (3,).

    Returns:
      Position [m] and velocity [m/s] in the gimbal's frame, origin at the pivot, shape B + (3,) each.
    """
    speed = muzzle.speed + muzzle.speed_sd * normals[..., 2]
    departure = direction(angle + lift(muzzle.offset, angle) + lift(muzzle.sd, angle) * normals[..., :2])
    length = lift(namespace(angle).asarray(muzzle.length)[..., None], angle)
    position = length * direction(angle)
    return position, speed[..., None] * departure + length * _direction_rate(angle, rate)


def _direction_rate(angle: Array, rate: Array) -> Array:
    """Time derivative of `direction` [1/s], shape B + (3,)."""
    xp = namespace(angle, rate)
    pitch, yaw = angle[..., 0], angle[..., 1]
    pitch_rate, yaw_rate = rate[..., 0], rate[..., 1]
    forward = -xp.sin(pitch) * xp.cos(yaw) * pitch_rate - xp.cos(pitch) * xp.sin(yaw) * yaw_rate
    left = -xp.sin(pitch) * xp.sin(yaw) * pitch_rate + xp.cos(pitch) * xp.cos(yaw) * yaw_rate
    return xp.stack([forward, left, xp.cos(pitch) * pitch_rate], axis=-1)

"""The camera on the barrel: where a plate appears in a frame, with noise, and whether it is found."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import Camera
from archerfish2.virtual_robot.frames import gimbal_axes, into_gimbal

Array = NDArray[np.float64]

NORMALS = 4
"""Standard normals per frame: noise in bearing, elevation and range, then that of the stamp."""
UNIFORMS = 2
"""Uniform numbers per frame: latency, and whether the plate is missed."""


class Detection(NamedTuple):
    """What the detector makes of a frame."""

    found: NDArray[np.bool_]
    """Whether it has the plate, shape B."""
    position: Array
    """Plate in the camera's frame: x forward, y left, z up [m]; NaN where not found, shape B + (3,)."""


def detect(camera: Camera, plate: Array, angle: Array, normals: Array, chance: Array) -> Detection:
    """Detect a plate in frames.

    Args:
      camera: the camera.
      plate: its place in the base frame at the exposure [m], shape B + (3,).
      angle: true pitch and yaw of the gimbal then [rad], shape B + (2,).
      normals: standard normals, of which the first three are used, shape B + (NORMALS,).
      chance: uniform number that decides on a miss, shape B.
    """
    seen = _in_camera(camera, plate, angle)
    distance = np.sqrt(np.sum(seen**2, axis=-1))
    visible = _in_view(camera, seen) & (chance >= camera.miss_probability)
    noisy = seen + _noise(camera, seen, distance, normals)
    return Detection(visible, np.where(visible[..., None], noisy, np.nan))


def _in_camera(camera: Camera, plate: Array, angle: Array) -> Array:
    mount = np.array([camera.forward_m, camera.left_m, camera.up_m])
    turned = gimbal_axes(np.radians([camera.misalignment_pitch_deg, camera.misalignment_yaw_deg]))
    return into_gimbal(turned, into_gimbal(gimbal_axes(angle), plate) - mount)


def _in_view(camera: Camera, seen: Array) -> NDArray[np.bool_]:
    wide = np.tan(np.radians(0.5 * camera.field_of_view_yaw_deg))
    high = np.tan(np.radians(0.5 * camera.field_of_view_pitch_deg))
    forward = seen[..., 0]
    inside = (np.abs(seen[..., 1]) <= wide * forward) & (np.abs(seen[..., 2]) <= high * forward)
    return np.asarray(inside & (forward > 0.0))


def _noise(camera: Camera, seen: Array, distance: Array, normals: Array) -> Array:
    """Return the error of a position: across the line of sight sideways and upwards, and along it."""
    along = seen / distance[..., None]
    level = np.hypot(along[..., 0], along[..., 1])
    zero = 0.0 * level
    left = np.stack([-along[..., 1] / level, along[..., 0] / level, zero], axis=-1)
    up = np.stack([-along[..., 2] * left[..., 1], along[..., 2] * left[..., 0], level], axis=-1)
    lateral = 1e-3 * camera.lateral_sd_mm
    sideways = np.hypot(1e-3 * camera.bearing_sd_mrad * distance, lateral) * normals[..., 0]
    upwards = np.hypot(1e-3 * camera.elevation_sd_mrad * distance, lateral) * normals[..., 1]
    outwards = 0.01 * camera.range_sd_percent * distance * normals[..., 2]
    return np.asarray(sideways[..., None] * left + upwards[..., None] * up + outwards[..., None] * along)

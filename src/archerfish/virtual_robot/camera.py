"""The camera on the barrel: where a plate appears in a frame, with noise, and whether it is found."""

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import Camera
from archerfish.virtual_robot.frames import gimbal_axes, into_gimbal

Array = NDArray[np.float64]


def detect(camera: Camera, plate: Array, angle: Array, normals: Array, uniform: Array) -> Array:
    """Detect a plate in frames.

    Args:
      camera: the camera.
      plate: its position in the base frame at the exposure [m], shape B + (3,).
      angle: true pitch and yaw of the gimbal then [rad], shape B + (2,).
      normals: standard normals of the noise sideways, upwards and along the line of sight, shape B + (3,).
      uniform: uniform number that decides whether the plate is missed, shape B.

    Returns:
      Position in the camera's frame, x forward, y left, z up [m], shape B + (3,); NaN where it is not found.
    """
    mount = np.array([camera.forward_m, camera.left_m, camera.up_m])
    misalignment = np.radians([camera.misalignment_pitch_deg, camera.misalignment_yaw_deg])
    seen = into_gimbal(gimbal_axes(misalignment), into_gimbal(gimbal_axes(angle), plate) - mount)
    forward, left, up = np.moveaxis(seen, -1, 0)
    width = np.tan(np.radians(0.5 * camera.field_of_view_yaw_deg))
    height = np.tan(np.radians(0.5 * camera.field_of_view_pitch_deg))
    in_view = (np.abs(left) <= width * forward) & (np.abs(up) <= height * forward) & (forward > 0.0)
    found = in_view & (uniform >= camera.miss_probability)
    return np.where(found[..., None], seen + _noise(camera, seen, normals), np.nan)


def _noise(camera: Camera, seen: Array, normals: Array) -> Array:
    """Return the error of a position [m], across the line of sight sideways and upwards, and along it."""
    distance = np.sqrt(np.sum(seen**2, axis=-1))
    along = seen / distance[..., None]
    level = np.hypot(along[..., 0], along[..., 1])
    left = np.stack([-along[..., 1] / level, along[..., 0] / level, 0.0 * level], axis=-1)
    up = np.stack([-along[..., 2] * left[..., 1], along[..., 2] * left[..., 0], level], axis=-1)
    lateral = 1e-3 * camera.lateral_sd_mm
    sideways = np.hypot(1e-3 * camera.bearing_sd_mrad * distance, lateral) * normals[..., 0]
    upwards = np.hypot(1e-3 * camera.elevation_sd_mrad * distance, lateral) * normals[..., 1]
    outwards = 0.01 * camera.range_sd_percent * distance * normals[..., 2]
    return np.asarray(sideways[..., None] * left + upwards[..., None] * up + outwards[..., None] * along)

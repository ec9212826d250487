"""A plate at rest as a camera on a moving gimbal sees it: azimuth, elevation and range."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Sighting(NamedTuple):
    """What places a plate at rest, and the camera on its gimbal.

    The horizontal line from pivot to plate is the reference: the camera's own yaw and the plate's height are no
    parameters of their own, because a sweep in yaw shows only their sums with `azimuth` and `camera_z`.
    """

    azimuth: Array
    """Azimuth of the plate in the base frame, less the camera's on the gimbal [rad], shape ()."""
    distance: Array
    """Horizontal distance from the pivot to the plate [m], shape ()."""
    camera_x: Array
    """Shift of positions in the camera's frame: how far the pivot is ahead of the camera [m], shape ()."""
    camera_y: Array
    """How far it is to the left [m], shape ()."""
    camera_z: Array
    """How far it is above, and the plate's height over the pivot [m], shape ()."""
    tilt: Array
    """Pitch of the camera on the gimbal [rad], shape ()."""
    roll: Array
    """Roll of the camera on the gimbal [rad], shape ()."""


PRIOR_SD = Sighting(*(np.array(sd) for sd in (np.inf, np.inf, 0.3, 0.3, np.inf, 0.2, 0.2)))
"""A camera sits within about a hand's breadth of the pivot, roughly level: small sweeps leave this undetermined, and
without it the fit would explain noise by a camera metres away."""


def sighted_position(sighting: Sighting, yaw: Array, pitch: Array) -> Array:
    """Return where the plate is in the camera's frame [m].

    Args:
      sighting: where things are.
      yaw: of the gimbal, left positive [rad], shape B.
      pitch: of the gimbal, muzzle up positive [rad], shape B.

    Returns:
      x forward, y left, z up, shape B + (3,).
    """
    to_plate, elevation = sighting.azimuth - yaw, pitch + sighting.tilt
    forward, left = sighting.distance * np.cos(to_plate), sighting.distance * np.sin(to_plate)
    x, up = np.cos(elevation) * forward, -np.sin(elevation) * forward
    y = np.cos(sighting.roll) * left + np.sin(sighting.roll) * up
    z = -np.sin(sighting.roll) * left + np.cos(sighting.roll) * up
    return np.stack([x + sighting.camera_x, y + sighting.camera_y, z + sighting.camera_z], axis=-1)


def spherical(position: Array) -> Array:
    """Return azimuth, elevation [rad] and range [m] of positions of shape B + (3,), in the same shape."""
    x, y, z = np.moveaxis(position, -1, 0)
    level = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), np.arctan2(z, level), np.hypot(level, z)], axis=-1)

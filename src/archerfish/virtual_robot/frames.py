"""The frame that turns with the gimbal: x along the barrel, y left, z up, relative to the base frame."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def gimbal_axes(angle: Array) -> Array:
    """Return the rotation from the base frame into the gimbal's, whose rows are the gimbal's x, y and z.

    Args:
      angle: pitch and yaw [rad], shape B + (2,).

    Returns:
      Shape B + (3, 3).
    """
    cos_pitch, cos_yaw = np.moveaxis(np.cos(angle), -1, 0)
    sin_pitch, sin_yaw = np.moveaxis(np.sin(angle), -1, 0)
    forward = [cos_pitch * cos_yaw, cos_pitch * sin_yaw, sin_pitch]
    left = [-sin_yaw, cos_yaw, 0.0 * cos_pitch]
    up = [-sin_pitch * cos_yaw, -sin_pitch * sin_yaw, cos_pitch]
    return np.stack(forward + left + up, axis=-1).reshape(*angle.shape[:-1], 3, 3)


def into_gimbal(axes: Array, vector: Array) -> Array:
    """Turn a vector from the base frame into the gimbal's, shape B + (3, 3) and B + (3,) → B + (3,)."""
    return np.asarray((axes @ vector[..., None])[..., 0])


def into_base(axes: Array, vector: Array) -> Array:
    """Turn a vector from the gimbal's frame into the base's, shape B + (3, 3) and B + (3,) → B + (3,)."""
    return np.asarray((vector[..., None, :] @ axes)[..., 0, :])

"""The frame that rides on the gimbal: x along the barrel, y left, z up, against the base frame."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def gimbal_axes(angle: Array) -> Array:
    """Return the gimbal's x, y and z in the base frame as the rows of a matrix.

    Args:
      angle: pitch and yaw [rad], shape B + (2,).

    Returns:
      Rotation from the base frame into the gimbal's, shape B + (3, 3).
    """
    cos, sin = np.cos(angle), np.sin(angle)
    up, across, lift, aside = cos[..., 0], cos[..., 1], sin[..., 0], sin[..., 1]
    rows = [up * across, up * aside, lift, -aside, across, 0.0 * up, -lift * across, -lift * aside, up]
    return np.stack(rows, axis=-1).reshape(*angle.shape[:-1], 3, 3)


def into_gimbal(axes: Array, vector: Array) -> Array:
    """Turn a vector from the base frame into the gimbal's, shape B + (3, 3) and B + (3,) → B + (3,)."""
    return np.asarray((axes @ vector[..., None])[..., 0])


def into_base(axes: Array, vector: Array) -> Array:
    """Turn a vector from the gimbal's frame into the base's, shape B + (3, 3) and B + (3,) → B + (3,)."""
    return np.asarray((vector[..., None, :] @ axes)[..., 0, :])

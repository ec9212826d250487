"""Where a pellet lands on level ground by eq (5): closed form in distance, gravity alone in height."""

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import GRAVITY, printed_position

Array = NDArray[np.float64]


def landing_distance(speed: Array, pitch: Array, yaw: Array, height: float, drag: float) -> Array:
    """Horizontal distance from the muzzle to the landing point, eq (5).

    The height h + v_z t − g t²/2 is zero at t = (v_z + √(v_z² + 2 g h)) / g, whatever the drag: eq (5) has none in z.
    Its x and y rows are damped each by itself, so the distance depends a little on the yaw: below 0.1 % at 5° and 6 m.

    Args:
      speed: muzzle speed [m/s], shape B.
      pitch: elevation of departure [rad], shape B.
      yaw: azimuth of departure [rad], shape B.
      height: height of the muzzle above the ground [m].
      drag: k [1/m].

    Returns:
      Distance [m], shape B.
    """
    velocity = speed[..., None] * direction(np.stack(np.broadcast_arrays(pitch, yaw), axis=-1))
    rise = velocity[..., 2]
    time = (rise + np.sqrt(rise**2 + 2 * GRAVITY * height)) / GRAVITY
    landing = printed_position(velocity, np.asarray(drag), time)
    return np.asarray(np.hypot(landing[..., 0], landing[..., 1]))

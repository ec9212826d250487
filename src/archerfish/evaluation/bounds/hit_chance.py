"""The chance that one shot hits, given how far the mean pellet passes from the armor's centre.

    f(m) = P(|m + N(0, diag(s_y², s_z²))| ≤ R)

m is the mean offset in the armor's plane. No controller knows the dispersion of a shot beforehand, so no bound needs
to: it uses this probability and never the realised draw.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Engagement

Array = NDArray[np.float64]

SLACK = 3e-4
"""Every aim is taken to be this much nearer to the armor than it is [rad]. What `ShotGeometry` leaves out, the coupling
of the axes above all, would else make the chance of one shot in some tens of thousands a hundredth too small."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_TAILS = 8.0
"""Standard deviations beyond which nothing is integrated."""


class ShotGeometry(NamedTuple):
    """Aims, scales and dispersion of the shots of E engagements, T each; index 0 is pitch or z, 1 is yaw or y."""

    aim: Array
    """Aim of the gimbal whose mean pellet meets the armor's centre [rad], shape (E, T, 2)."""
    bearing: Array
    """Azimuth of the armor when the pellet crosses its x [rad], shape (E, T)."""
    x: Array
    """x of the armor then [m], shape (E, T)."""
    height_per_pitch: Array
    """Change of the height in the armor's plane per change of the pitch [m/rad], shape (E, T)."""
    sd: Array
    """Standard deviation of the pellet in z and y in that plane [m], shape (E, T, 2)."""
    rate_share: Array
    """By how much the gimbal's rate turns the pellet [s], shape (E, T): the aim is angle + rate_share · rate."""
    crossing: Array
    """When the pellet crosses the armor's x, since the engagement began [s], shape (E, T)."""
    drop: Array
    """Drop of the pellet until then [m], shape (E, T)."""

    def lateral(self, yaw: Array) -> Array:
        """Return the mean offset in y [m] of an aim that is off by a yaw [rad], shape (E, T)."""
        # A bearing beyond a right angle crosses no plane of constant x; next to it the offset is metres already.
        return np.asarray(self.x * (np.tan(np.clip(self.bearing + yaw, -1.55, 1.55)) - np.tan(self.bearing)))


def hit_chance(offset: Array, sd: Array, radius: float) -> Array:
    """Return the chance to hit.

    Args:
      offset: mean offset in z and y [m], shape B + (2,).
      sd: standard deviations in z and y [m], shape B + (2,).
      radius: R, largest miss that hits [m].
    """
    offset, sd = np.broadcast_arrays(offset, np.maximum(sd, 1e-9))
    (z, y), (sd_z, sd_y) = np.moveaxis(offset, -1, 0), np.moveaxis(sd, -1, 0)
    # The height is integrated over as R sin θ: smooth where the disc ends.
    low, high = (np.arcsin(np.clip((z + side * _TAILS * sd_z) / radius, -1.0, 1.0)) for side in (-1, 1))
    angle = (low + high)[..., None] / 2 + (high - low)[..., None] / 2 * _NODES
    height, half_width = radius * np.sin(angle), radius * np.cos(angle)
    deviation = (height - z[..., None]) / sd_z[..., None]
    density = np.exp(-0.5 * deviation**2) / (np.sqrt(2 * np.pi) * sd_z[..., None])
    within = ndtr((half_width - y[..., None]) / sd_y[..., None]) - ndtr((-half_width - y[..., None]) / sd_y[..., None])
    return np.asarray((high - low) / 2 * np.sum(_WEIGHTS * density * within * half_width, axis=-1))


def shot_geometry(engagements: Engagement, muzzle: Muzzle, fired: Array) -> ShotGeometry:
    """Work out the geometry of every shot, in float64.

    Args:
      engagements: E of them.
      muzzle: the true one, shape () or (E,).
      fired: times of the shots [s], shape (T,).
    """
    motion = map_arrays(lambda each: np.asarray(each, np.float64)[:, None], engagements.motion)
    muzzle = Muzzle(*(_per_shot(each, name in ("offset", "sd")) for name, each in muzzle._asdict().items()))
    time = np.zeros((len(engagements.start), 1)) + fired
    aim = intercept(motion.position, time, muzzle)
    place = motion.position(time + aim.flight_time)
    level, bearing = np.hypot(place[..., 0], place[..., 1]), np.arctan2(place[..., 1], place[..., 0])
    slant = level / np.cos(aim.angle[..., 0])
    departure = aim.angle[..., 0] + (1.0 - muzzle.length / slant) * muzzle.offset[..., 0]
    drop = level * np.tan(departure) - place[..., 2]
    # A steeper pellet flies farther, and the drop grows with the square of the way.
    falling = 2.0 * drop * np.tan(departure)
    rise = np.cos(departure) ** -2
    sd_z = np.hypot(
        ((level - muzzle.length) * rise - falling) * muzzle.sd[..., 0], 2.0 * drop / muzzle.speed * muzzle.speed_sd
    )
    sd_y = (level - muzzle.length) / np.cos(bearing) * muzzle.sd[..., 1]
    rate_share = (1.0 - muzzle.length / slant) * muzzle.length / muzzle.speed
    return ShotGeometry(
        aim=aim.angle,
        bearing=bearing,
        x=place[..., 0],
        height_per_pitch=level * rise - falling,
        sd=np.stack([sd_z, sd_y], axis=-1),
        rate_share=rate_share,
        crossing=time + aim.flight_time,
        drop=drop,
    )


def _per_shot(parameter: Array, vector: bool) -> Array:
    array = np.asarray(parameter, np.float64)
    return array[:, None] if array.ndim > vector else array

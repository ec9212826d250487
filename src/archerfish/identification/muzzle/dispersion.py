"""What a muzzle's scatter comes to at a distance: eq (6), carried to a vertical plane by the flight."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from archerfish.dynamics.muzzle import direction
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.records.muzzle import MuzzleRecord

_SPEED_STEP = 1e-3
"""Of the speed, as a share of it."""
_ANGLE_STEP = 1e-4
"""Of the elevation [rad]."""


class Dispersion(NamedTuple):
    """Scatter of the hits on a plane straight ahead."""

    distance: float
    """Distance of the plane [m]."""
    vertical_sd: float
    """Standard deviation of the height [m]."""
    lateral_sd: float
    """Standard deviation to the side [m]; 0 where no lateral distances were measured."""


def dispersion_at(muzzle: MuzzleRecord, distances: Sequence[float]) -> list[Dispersion]:
    """Return the scatter of level shots by the delta method, with the flight of the simulator.

    Args:
      muzzle: the muzzle.
      distances: of the planes [m].
    """
    step = _SPEED_STEP * muzzle.speed
    found = []
    for distance in distances:
        by_speed = _height(muzzle, distance, step, 0.0) - _height(muzzle, distance, -step, 0.0)
        by_angle = _height(muzzle, distance, 0.0, _ANGLE_STEP) - _height(muzzle, distance, 0.0, -_ANGLE_STEP)
        parts = muzzle.speed_sd * by_speed / (2 * step), muzzle.pitch_sd * by_angle / (2 * _ANGLE_STEP)
        found.append(Dispersion(distance, float(np.hypot(*parts)), distance * muzzle.yaw_sd))
    return found


def _height(muzzle: MuzzleRecord, distance: float, faster: float, higher: float) -> float:
    velocity = (muzzle.speed + faster) * direction(np.array([muzzle.pitch_offset + higher, 0.0]))
    crossing = flat_fire_crossing(np.zeros(3), velocity, np.asarray(distance), np.asarray(muzzle.drag))
    return float(crossing.height)

"""Shots at plates at several distances and at the ground, with the measured speed of each pellet."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.batch import RobotBatch

Array = NDArray[np.float64]
CADENCE_TICKS = 20
"""Between the pellets of a burst, as in an engagement."""
_SETTLE_TICKS, _READ_TICKS, _PAUSE_TICKS = 1500, 100, 1000


class Plate(NamedTuple):
    """A plate straight ahead, as large as need be."""

    distance: float  # from the pivot [m]

    def position(self, time: Array) -> Array:
        """Return the position of its centre [m] at times [s], shape (B,) → (B, 3)."""
        return np.stack([self.distance + 0.0 * time, 0.0 * time, 0.0 * time], axis=-1)


class PlateShot(NamedTuple):
    """A pellet at a plate, with the fields of shots.csv."""

    pitch_deg: float  # elevation of the barrel, as the robot reports it at rest
    yaw_deg: float  # azimuth
    plane_distance_m: float  # from the muzzle to the plate, straight ahead
    hit_height_m: float  # above the muzzle
    lateral_m: float  # left of straight ahead
    speed_m_s: float  # measured
    burst: int  # number of the burst, 0 for a single shot


class LandingShot(NamedTuple):
    """A pellet at the ground, with the fields of landings.csv."""

    pitch_deg: float  # elevation of the barrel, as the robot reports it at rest
    yaw_deg: float  # azimuth
    distance_m: float  # along the ground, from below the muzzle
    lateral_m: float  # left of the barrel's vertical plane
    speed_m_s: float  # measured


def shoot_plates(
    robot: RobotBatch, distances: Sequence[float], pitch: float, single: int, burst: int, seed: int
) -> Iterator[PlateShot]:
    """Fire single shots and a burst at each of some plates.

    Args:
      robot: batch of one.
      distances: of the plates from the pivot [m].
      pitch: commanded elevation [rad].
      single: shots at each plate with a pause after each.
      burst: shots at each plate at the cadence of an engagement, after the single ones.
      seed: of the dispersion.
    """
    muzzle, draws = robot.description.muzzle, np.random.default_rng(seed)
    robot.reset(np.zeros((1, 2)), Plate(distances[0]))
    for number, distance in enumerate(distances, 1):
        angle = _aim(robot, Plate(distance), pitch, 0.0)
        pitch_deg, yaw_deg = np.degrees(angle).tolist()
        # As a tape measures it once the barrel points there.
        ahead = distance - muzzle.forward_m * float(np.cos(angle[0]))
        height = muzzle.forward_m * float(np.sin(angle[0])) + muzzle.up_m * float(np.cos(angle[0]))
        for pause, count, name in ((_PAUSE_TICKS, single, 0), (CADENCE_TICKS, burst, number)):
            for _ in range(count):
                flight = robot.shoot(draws.standard_normal((1, 3)))
                robot.advance(pause)
                left, up = flight.miss[0].tolist()
                speed = float(flight.muzzle_speed_measured[0])
                yield PlateShot(pitch_deg, yaw_deg, ahead, up - height, left - muzzle.left_m, speed, name)


def shoot_landings(
    robot: RobotBatch, angles: Sequence[tuple[float, float]], shots: int, seed: int
) -> Iterator[LandingShot]:
    """Fire single shots at the ground.

    Args:
      robot: batch of one.
      angles: commanded pitch and yaw of each setting [rad].
      shots: at each.
      seed: of the dispersion.
    """
    draws = np.random.default_rng(seed)
    robot.reset(np.zeros((1, 2)), Plate(3.0))
    for pitch, yaw in angles:
        pitch_deg, yaw_deg = np.degrees(_aim(robot, Plate(3.0), pitch, yaw)).tolist()
        for _ in range(shots):
            landing = robot.shoot_down(draws.standard_normal((1, 3)))
            robot.advance(_PAUSE_TICKS)
            distance, lateral = float(landing.distance[0]), float(landing.lateral[0])
            yield LandingShot(pitch_deg, yaw_deg, distance, lateral, float(landing.muzzle_speed_measured[0]))


def _aim(robot: RobotBatch, plate: Plate, pitch: float, yaw: float) -> Array:
    """Let the gimbal settle on a command, and read its angles [rad]; the wheels are at full speed again by then."""
    robot.retarget(plate)
    robot.send(np.array([[pitch, yaw]]))
    robot.advance(_SETTLE_TICKS)
    # A team notes what its robot reports, to a hundredth of a degree.
    read = np.nanmean(robot.advance(_READ_TICKS).feedback.angle[0], axis=0)
    return np.asarray(np.radians(np.round(np.degrees(read), 2)))

"""The firing range: plates at several distances, and the ground, with the measured speed of each pellet."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.virtual_robot.batch import RobotBatch
from archerfish2.virtual_robot.description import RobotDescription

Array = NDArray[np.float64]

CADENCE_TICKS = 20
"""Between the pellets of a burst, as in an engagement [ms]."""
_SETTLE_TICKS = 1500
_READ_TICKS = 100
_PAUSE_TICKS = 1000


class Plate(NamedTuple):
    """A plate straight ahead at a distance, as large as need be."""

    distance: float
    """From the pivot [m]."""

    def position(self, time: Array) -> Array:
        """Return the position of its centre [m] at times [s], shape (B,) → (B, 3)."""
        return np.stack([self.distance + 0.0 * time, 0.0 * time, 0.0 * time], axis=-1)


class ShotRow(NamedTuple):
    """One pellet, in the order of fire."""

    pitch: float
    """Elevation of the barrel, as the robot reports it at rest [rad]."""
    yaw: float
    """Azimuth [rad]."""
    plane_distance: float
    """From the muzzle to the plate, straight ahead [m]; NaN for the ground."""
    hit_height: float
    """Above the muzzle [m]; NaN for the ground."""
    landing_distance: float
    """Along the ground [m]; NaN for a plate."""
    lateral: float
    """How far left of the barrel's plane (ground), or of straight ahead (plate) [m]."""
    speed: float
    """Measured [m/s]."""
    burst: int
    """Number of the burst, 0 for a single shot."""


def check_aim(robot: RobotDescription, pitch: float, yaw: float) -> None:
    """Refuse angles [rad] beyond the robot's limits.

    Raises:
      InputError: naming them.
    """
    for name, angle, limits in (("pitch", pitch, robot.limits.pitch), ("yaw", yaw, robot.limits.yaw)):
        degrees = float(np.degrees(angle))
        if not limits.low_deg - 1e-9 <= degrees <= limits.high_deg + 1e-9:
            raise InputError(
                f"the {name} {degrees:g}° is beyond the limits of {robot.schema.name}, {limits.low_deg:g}…"
                f"{limits.high_deg:g}°; choose another"
            )


def shoot_plates(
    robot: RobotBatch, distances: tuple[float, ...], pitch: float, single: int, burst: int, seed: int
) -> Iterator[ShotRow]:
    """Fire single shots and a burst at each of some plates.

    Args:
      robot: batch of one.
      distances: of the plates from the pivot [m].
      pitch: commanded elevation [rad].
      single: shots at each plate with a pause after each.
      burst: shots at each plate at the cadence of an engagement, after the single ones.
      seed: of the dispersion.

    Yields:
      The shots as they are fired.
    """
    muzzle = robot.description.muzzle
    draws = np.random.default_rng(seed)
    robot.reset(np.zeros((1, 2)), Plate(distances[0]))
    for number, distance in enumerate(distances, 1):
        reported = _aim(robot, Plate(distance), pitch, 0.0)
        # What a team measures with a tape once the barrel points there.
        ahead = distance - muzzle.forward_m * float(np.cos(reported[0]))
        height = muzzle.forward_m * float(np.sin(reported[0])) + muzzle.up_m * float(np.cos(reported[0]))
        for pause, count, name in ((_PAUSE_TICKS, single, 0), (CADENCE_TICKS, burst, number)):
            for _ in range(count):
                flight = robot.shoot(draws.standard_normal((1, 3)))
                robot.advance(pause)
                y, z = flight.miss[0].tolist()
                speed = float(flight.muzzle_speed_measured[0])
                yield ShotRow(*reported, ahead, z - height, np.nan, y - muzzle.left_m, speed, name)


def shoot_ground(robot: RobotBatch, angles: list[tuple[float, float]], shots: int, seed: int) -> Iterator[ShotRow]:
    """Fire single shots at the ground.

    Args:
      robot: batch of one.
      angles: commanded pitch and yaw of each setting [rad].
      shots: at each.
      seed: of the dispersion.

    Yields:
      The shots as they are fired.
    """
    draws = np.random.default_rng(seed)
    robot.reset(np.zeros((1, 2)), Plate(3.0))
    for pitch, yaw in angles:
        reported = _aim(robot, Plate(3.0), pitch, yaw)
        for _ in range(shots):
            landing = robot.shoot_down(draws.standard_normal((1, 3)))
            robot.advance(_PAUSE_TICKS)
            distance, lateral = float(landing.distance[0]), float(landing.lateral[0])
            speed = float(landing.muzzle_speed_measured[0])
            yield ShotRow(*reported, np.nan, np.nan, distance, lateral, speed, 0)


def _aim(robot: RobotBatch, plate: Plate, pitch: float, yaw: float) -> tuple[float, float]:
    """Let the gimbal settle on a command, and read its angles; by then the wheels are at full speed again."""
    robot.retarget(plate)
    robot.send(np.array([[pitch, yaw]]))
    robot.advance(_SETTLE_TICKS)
    # A team notes what its robot reports, to a hundredth of a degree.
    read = np.nanmean(robot.advance(_READ_TICKS).feedback.angle[0], axis=0)
    found = np.radians(np.round(np.degrees(read), 2))
    return float(found[0]), float(found[1])

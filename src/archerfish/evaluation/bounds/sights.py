"""What any controller may have seen by each of its decisions: the bearings and distances of the frames."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.muzzle import DRAWS as MUZZLE_DRAWS
from archerfish.evaluation.bounds.hit_chance import Array
from archerfish.sensing.camera import feedback_age, first_sight, next_sight, phase
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.identified import IdentifiedWorld
from archerfish.simulation.shooting import ShootingWorld

_EXACT = 1e-6
"""Standard deviation that exact sights are given [rad, and relative]."""


class Sights(NamedTuple):
    """Frames at the D decisions of E engagements."""

    bearing: Array
    """Measured azimuth [rad], shape (E, D)."""
    distance: Array
    """Measured horizontal distance [m], shape (E, D)."""
    level: Array
    """True horizontal distance at the exposure [m], shape (E, D)."""
    exposed: Array
    """Moment of the exposure since the engagement began [s], shape (E, D)."""
    fresh: NDArray[np.bool_]
    """Whether the frame is new at the decision, shape (E, D)."""
    bearing_sd: Array
    """Standard deviation of the azimuth [rad], shape (E,)."""
    distance_sd: Array
    """That of the distance, relative to it, shape (E,)."""

    def pick(self, index: int) -> "Sights":
        """Return those of one engagement, without the leading dimension."""
        return Sights(*(each[index] for each in self))


def sights(world: PureWorld, engagements: Engagement, draws: NDArray[np.float32]) -> Sights | None:
    """Gather the frames, with no more noise than the camera's own: none from the gimbal's motion.

    A controller sees the same frames, blurred further by its own turning; so it knows no more.

    Args:
      world: the simulator.
      engagements: E of them.
      draws: standard normals, shape (E, T, normals).

    Returns:
      The frames of all decisions; one decision only where sights are exact, since two of them show all there is to
      know; None where sights are noisy in a way that this doesn't know.
    """
    if isinstance(world, IdentifiedWorld):
        return _by_camera(world, engagements, draws)
    if isinstance(world, ShootingWorld) and not np.any(world.position_noise > 0.0):
        start = np.zeros((len(engagements.start), 1))
        plate = _places(engagements, start)
        return _sights(engagements, plate, start, start == 0.0, start[:, 0] + _EXACT, start[:, 0] + _EXACT)
    return None


def _places(engagements: Engagement, time: Array) -> Array:
    motion = map_arrays(lambda each: np.asarray(each, np.float64)[:, None], engagements.motion)
    return np.asarray(motion.position(time))


def _by_camera(world: IdentifiedWorld, engagements: Engagement, draws: NDArray[np.float32]) -> Sights:
    sensing, draw, motion = world.sensing, engagements.plant, engagements.motion
    time = np.zeros(len(draws), np.float32)
    # As the world begins: the normals of the first sight are those of the last step.
    noise, phases = draws[:, -1, MUZZLE_DRAWS:], phase(draws[:, -1, :2])
    age = feedback_age(sensing, draw, phases[:, 1], time, noise)
    sight = first_sight(sensing, draw, phases[:, 0], motion, age, noise)
    found, still = [sight], np.zeros((len(draws), 2), np.float32)
    for step in range(draws.shape[1] - 1):
        time, noise = time + world.period, draws[:, step, MUZZLE_DRAWS:]
        age = feedback_age(sensing, draw, phases[:, 1], time, noise)
        sight = next_sight(sensing, draw, phases[:, 0], sight, time, motion, still, age, noise)
        found.append(sight)
    plate, exposed, fresh = (
        np.stack([getattr(each, name) for each in found], 1) for name in ("plate", "exposed", "fresh")
    )
    # The frame at the beginning counts, however old it is.
    fresh[:, 0] = True
    across, along = (np.maximum(np.asarray(each, np.float64), _EXACT) for each in (sensing.across, sensing.along))
    return _sights(engagements, plate, exposed, fresh, across[draw, 1], along[draw])


def _sights(
    engagements: Engagement, plate: Array, exposed: Array, fresh: NDArray[np.bool_], across: Array, along: Array
) -> Sights:
    plate, exposed = np.asarray(plate, np.float64), np.asarray(exposed, np.float64)
    place = _places(engagements, exposed)
    return Sights(
        bearing=np.arctan2(plate[..., 1], plate[..., 0]),
        distance=np.hypot(plate[..., 0], plate[..., 1]),
        level=np.hypot(place[..., 0], place[..., 1]),
        exposed=exposed,
        fresh=fresh,
        bearing_sd=across,
        distance_sd=along,
    )

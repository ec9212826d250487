"""Positions over time, and one disc that follows any of them: eq (7), sampled paths, a user's own.

A position is a tree with one function, `position(time)`; its arrays begin with the batch shape B.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, map_arrays, namespace, tree
from archerfish.protocols import Plates

STEP_S = 0.02
"""Between two points of a path [s]: a line between them is at most 0.5 mm off a curve at 10 m/s²."""
BEGIN_S, LONGEST_S = -0.3, 3.0
"""Begin of a path, before an engagement, since cameras show the past; longest engagement on a path [s]."""
FLIGHT_S = 0.7
"""A path continues for so long after its engagement [s]: no pellet flies longer."""
TIMES = BEGIN_S + STEP_S * np.arange(round((LONGEST_S + FLIGHT_S - BEGIN_S) / STEP_S) + 1)
"""Times of the points [s], shape (N,)."""
ZERO = round(-BEGIN_S / STEP_S)
"""Index of time zero."""


class Parabola(NamedTuple):
    """Eq (7): to and fro on x = X₀ + c (y − Y₀)², turning back where |y − Y₀| reaches the half width.

    Eq (7) prints X₀ − 0.04 ≤ x ≤ X₀ + 0.04, but x never falls below X₀ on this parabola; only the upper bound acts.
    """

    vertex: Array  # X₀, Y₀ and the constant height [m], B + (3,)
    speed: Array  # lateral speed |ẏ| [m/s], B; zero stands still
    phase: Array  # share of the cycle gone at time zero, 0…1, B; 0 is at the right-hand turn, moving left
    half_width: Array  # largest |y − Y₀| [m], B
    curvature: Array  # c [1/m], B

    def position(self, time: Array) -> Array:
        """Return the position [m] at times [s] of shape B or (N,) + B, shape of the times + (3,)."""
        xp = namespace(self.vertex, time)
        speed, phase, half_width, curvature = (lift(field, time) for field in self[1:])
        lateral = half_width * triangle_wave(phase + speed * time / (4.0 * half_width))
        vertex = lift(self.vertex, lateral[..., None]) + 0.0 * lateral[..., None]
        forward = vertex[..., 0] + curvature * lateral**2
        return xp.stack([forward, vertex[..., 1] + lateral, vertex[..., 2]], axis=-1)


def triangle_wave(cycles: Array) -> Array:
    """Triangle wave of period one between −1 (at whole cycles) and 1, shape B."""
    xp = namespace(cycles)
    return 1.0 - 4.0 * xp.abs(cycles - xp.floor(cycles) - 0.5)


class Path(NamedTuple):
    """Places at even times, linear between them, at rest before the first and after the last."""

    places: Array  # [m], B + (N, 3); or B + (N, 2) of level paths
    begin: Array  # time of the first [s], B
    step: Array  # between two [s], B

    def position(self, time: Array) -> Array:
        """Return the position [m] at times [s] of shape B or (N,) + B, shape of the times + (3,) or (2,)."""
        xp = namespace(self.places, time)
        count, batch = self.places.shape[-2], self.places.shape[:-2]
        at = xp.clip((time - lift(self.begin, time)) / lift(self.step, time), 0.0, count - 1.0)
        whole = xp.clip(xp.floor(at), 0.0, count - 2.0)
        before, share = xp.astype(whole, xp.int32), (at - whole)[..., None]
        # Rows of one table, so that a path takes several times at once by broadcasting.
        rows = xp.reshape(self.places, (-1, self.places.shape[-1]))
        member = xp.reshape(xp.arange(math.prod(batch), dtype=xp.int32), batch)
        row = count * lift(member, before) + before
        return (1.0 - share) * rows[row] + share * rows[row + 1]


@tree()
class Disc:
    """A target of one plate that faces −x."""

    motion: Any  # any position
    normal_yaw: Array  # [rad], B + (1,)

    plates = 1

    def at(self, time: Array) -> Plates:
        """Return the plate at times [s] of shape B or (N,) + B."""
        lead = (1,) * (time.ndim + 1 - self.normal_yaw.ndim)
        motion = map_arrays(lambda array: array.reshape(lead + array.shape), self.motion) if lead else self.motion
        zero = 0.0 * time[..., None]
        return Plates(motion.position(time)[..., None, :], lift(self.normal_yaw, zero) + zero)


def disc(motion: Any, place: Array) -> Disc:
    """Return the disc that follows a position.

    Args:
      motion: any position.
      place: of any kind, for its batch shape and type, shape B + (3,).
    """
    return Disc(motion, 0.0 * place[..., :1] + math.pi)

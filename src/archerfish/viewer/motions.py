"""How the target of the page may move: as a task says, or dragged by hand."""

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import Array
from archerfish.protocols import Plates
from archerfish.task import DRAWN, EQ_7, Task

HAND = "dragged by hand"
"""The motion that no formula gives."""
REACTION_S = 0.12
"""Time constant with which a dragged target takes up the speed of the hand [s]."""
LOW_M, HIGH_M = (0.8, -2.5, -0.3), (8.0, 2.5, 1.0)
"""Bounds of a dragged target [m]."""
FloatArray = NDArray[np.floating]


def motion_names(task: Task) -> tuple[str, ...]:
    """Return the motions that the page offers, that of the task first."""
    return tuple(dict.fromkeys((task.motion, *DRAWN, *EQ_7, HAND)))


class HandPath:
    """A target of one plate that was dragged; after the last known moment it is at rest."""

    plates = 1

    def __init__(self, place: FloatArray, capacity: int) -> None:
        self._times, self._places = np.zeros(capacity), np.zeros((capacity, 3))
        self._places[0], self._known = place, 1

    def at(self, time: Array) -> Plates:
        """Return the plate at times since the engagement began [s], of any shape B."""
        times = self._times[: self._known]
        axes = [np.interp(time, times, self._places[: self._known, axis]) for axis in range(3)]
        position = np.stack(axes, axis=-1, dtype=np.float32)[..., None, :]
        return Plates(position, np.full(position.shape[:-1], np.pi, np.float32))

    def add(self, time: float, place: FloatArray) -> None:
        """Add a moment [s] and a place [m], shape (3,)."""
        self._times[self._known], self._places[self._known] = time, place
        self._known += 1

    @property
    def places(self) -> FloatArray:
        """All places so far [m], shape (N, 3)."""
        return self._places[: self._known]


def follow(place: FloatArray, velocity: FloatArray, hand: FloatArray, speed: float, period_s: float) -> FloatArray:
    """Move a target for a period towards where the hand holds it, at a bounded speed.

    Args:
      place: of the target [m], shape (3,).
      velocity: of the target [m/s], shape (3,).
      hand: where the hand is [m], shape (3,).
      speed: largest speed [m/s].
      period_s: [s].

    Returns:
      Place [m] and velocity [m/s] after the period, shape (2, 3).
    """
    desired = (np.clip(hand, LOW_M, HIGH_M) - place) / REACTION_S
    length = float(np.linalg.norm(desired))
    desired = desired * min(1.0, speed / length) if length > 0.0 else desired
    velocity = velocity + (desired - velocity) * min(1.0, period_s / REACTION_S)
    return np.stack([place + period_s * velocity, velocity])

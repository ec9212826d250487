"""The referee: counts shots and hits, and knows who may fire by rate and heat."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import RefereeTable

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ROUNDING_S = 1e-9


class RefereeState(NamedTuple):
    """What the referee has seen of B robots."""

    shots: NDArray[np.int64]
    """Shots so far, shape (B,)."""
    hits: NDArray[np.int64]
    """Of them hits, shape (B,)."""
    heat: Array
    """Heat right after the last shot, shape (B,)."""
    last: Array
    """When that was [s], minus infinity before the first, shape (B,)."""


def fresh_referee(batch: int) -> RefereeState:
    """Return a referee who has seen nothing yet of B robots."""
    none = np.zeros(batch, np.int64)
    return RefereeState(none, none, np.zeros(batch), np.full(batch, -np.inf))


def heat_at(referee: RefereeTable, state: RefereeState, time: float) -> Array:
    """Return the heat at a time [s], shape (B,)."""
    # Before the first shot `last` is minus infinity, which cools for ever; without cooling that would be 0 times it.
    lost = referee.cooling_per_s * np.where(np.isfinite(state.last), time - state.last, 0.0)
    return np.maximum(state.heat - lost, 0.0)


def heat_left(referee: RefereeTable, state: RefereeState, time: float) -> Array:
    """Return how many shots the heat limit allows at a time [s], shape (B,); infinite where shots don't heat."""
    if referee.heat_per_shot == 0:
        return np.full(len(state.heat), np.inf)
    room = referee.heat_limit - heat_at(referee, state, time)
    return np.floor(room / referee.heat_per_shot + _ROUNDING_S)


def allowed(referee: RefereeTable, state: RefereeState, time: float) -> Flags:
    """Return who may fire at a time [s] by rate and heat, shape (B,)."""
    waited = time - state.last >= 1.0 / referee.max_rate_hz - _ROUNDING_S
    return waited & (heat_left(referee, state, time) >= 1.0)


def count_shots(referee: RefereeTable, state: RefereeState, time: float, fired: Flags, miss: Array) -> RefereeState:
    """Count shots.

    Args:
      referee: the rules.
      state: before the shots.
      time: of the shots [s].
      fired: who fired, shape (B,).
      miss: pellet minus plate in y and z where it crosses the plate's x [m], NaN if it never does, shape (B, 2).
    """
    hit = fired & (np.hypot(miss[:, 0], miss[:, 1]) <= referee.hit_radius_m)
    heat = np.where(fired, heat_at(referee, state, time) + referee.heat_per_shot, state.heat)
    return RefereeState(state.shots + fired, state.hits + hit, heat, np.where(fired, time, state.last))

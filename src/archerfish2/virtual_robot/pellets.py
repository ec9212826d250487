"""Pellets in the air: gravity and quadratic drag in three dimensions, by Runge–Kutta steps of their own."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Event = Callable[[Array, Array], Array]
"""From time of flight [s], shape B, and position [m], shape B + (3,), to a number that is zero at the event and below
zero before it."""

GRAVITY = 9.81
"""[m/s²]."""
_STEP_S = 0.03
"""The cubic through the ends of a step is within 1e-8 m of the flight at 18 m/s, and within 1e-7 m at 28 m/s."""
_LONGEST_S = 3.0
_NEAR = 1e-12
"""An event is met when its number is this near to zero [m]."""
_ROUNDS = 60
"""Of the search for an event at most; it usually takes four."""


class Arrival(NamedTuple):
    """Where flights end."""

    time: Array
    """Time of flight [s], NaN where the event never comes, shape B."""
    position: Array
    """[m], likewise, shape B + (3,)."""


def fly(position: Array, velocity: Array, drag: float, event: Event) -> Arrival:
    """Fly pellets until an event, v̇ = −k |v| v − g, for at most three seconds.

    Args:
      position: where they leave the muzzle [m], shape (B, 3).
      velocity: with which [m/s], shape (B, 3).
      drag: k [1/m].
      event: what ends a flight; it must begin below zero.
    """
    # Coordinates first, trials last: loops over trials are long, loops over three coordinates are not.
    state = np.stack([position.T, velocity.T])
    start, end, begun = state.copy(), state.copy(), np.full(len(position), np.nan)
    flying = event(np.zeros(len(position)), position) < 0.0
    for index in range(round(_LONGEST_S / _STEP_S)):
        following = _step(state, drag)
        time = np.full(len(position), (index + 1) * _STEP_S)
        now = flying & (event(time, following[0].T) >= 0.0)
        start, end = np.where(now, state, start), np.where(now, following, end)
        begun[now] = index * _STEP_S
        flying &= ~now
        if not flying.any():
            break
        state = following
    return _refined(start, end, begun, event)


def crossing(position: Array, velocity: Array, drag: float, plate: Callable[[Array], Array]) -> Arrival:
    """Fly pellets until they have the x of a plate that moves on.

    Args:
      position: where they leave the muzzle [m], shape (B, 3).
      velocity: with which [m/s], shape (B, 3).
      drag: k [1/m].
      plate: its position [m], shape (B, 3), from the time of flight [s], shape (B,).
    """
    return fly(position, velocity, drag, lambda time, place: np.asarray(place[:, 0] - plate(time)[:, 0]))


def landing(position: Array, velocity: Array, drag: float, ground: float) -> Arrival:
    """Fly pellets down to the ground.

    Args:
      position: where they leave the muzzle [m], shape (B, 3).
      velocity: with which [m/s], shape (B, 3).
      drag: k [1/m].
      ground: its height [m].
    """
    return fly(position, velocity, drag, lambda _, place: np.asarray(ground - place[:, 2]))


def _slope(state: Array, drag: float) -> Array:
    """Return the rates of positions and velocities, shape (2, 3, B)."""
    x, y, z = state[1]
    slope = np.empty_like(state)
    slope[0] = state[1]
    slope[1] = -drag * np.sqrt(x**2 + y**2 + z**2) * state[1]
    slope[1, 2] -= GRAVITY
    return slope


def _step(state: Array, drag: float) -> Array:
    first = _slope(state, drag)
    second = _slope(state + 0.5 * _STEP_S * first, drag)
    third = _slope(state + 0.5 * _STEP_S * second, drag)
    fourth = _slope(state + _STEP_S * third, drag)
    return state + _STEP_S / 6.0 * (first + 2.0 * (second + third) + fourth)


def _refined(start: Array, end: Array, begun: Array, event: Event) -> Arrival:
    """Search the step of the event on the cubic through its ends, by false position with halved weights (Illinois).

    The event stays between two ends, since the plate may turn within the step.
    """
    way = _cubic(start, end)
    low, high = np.zeros(len(begun)), np.ones(len(begun))
    below, above = event(begun, start[0].T), event(begun + _STEP_S, end[0].T)
    place, share = end[0].T.copy(), high
    searched = above > _NEAR
    side = np.zeros(len(begun), np.int64)  # on which the last place tried was
    for _ in range(_ROUNDS):
        if not searched.any():
            break
        # Each flight by itself, and at rest once it is met, so that its company changes nothing.
        share = np.where(searched, (low * above - high * below) / (above - below), share)
        place = _along(way, share).T
        value = event(begun + share * _STEP_S, place)
        before = value < 0.0
        ends = np.where(before, 1, -1)
        halved = np.where(side == ends, 0.5, 1.0)
        low, high = np.where(before, share, low), np.where(before, high, share)
        below, above = np.where(before, value, below * halved), np.where(before, above * halved, value)
        side, searched = ends, searched & (np.abs(value) > _NEAR)
    return Arrival(begun + share * _STEP_S, np.where(np.isnan(begun)[:, None], np.nan, place))


def _cubic(start: Array, end: Array) -> Array:
    """Return the coefficients of the cubics that have both ends' positions and velocities, shape (4, 3, B)."""
    leaving, arriving, between = _STEP_S * start[1], _STEP_S * end[1], end[0] - start[0]
    bend = 3.0 * between - 2.0 * leaving - arriving
    return np.stack([start[0], leaving, bend, leaving + arriving - 2.0 * between])


def _along(way: Array, share: Array) -> Array:
    """Return positions at a share of a step, shape (3, B)."""
    return np.asarray(way[0] + share * (way[1] + share * (way[2] + share * way[3])))

"""Excitations: sweeps and steps about rest, sampled at the firmware's ticks."""

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S

Array = NDArray[np.float64]

REST_S = 0.5
"""At rest before and after every excitation [s]."""
_STEP_LEVELS = ((1.0, -1.0, 1.0, -1.0), (-1.0, 0.6, -0.6, 1.0))
"""Levels of a step log and of the one that is held back, with rests between them."""


def sweep(amplitude: float, low_hz: float, high_hz: float, duration_s: float, *, held_back: bool = False) -> Array:
    """Return a sine of constant amplitude whose frequency rises linearly, between two rests.

    Args:
      amplitude: [rad].
      low_hz: first frequency.
      high_hz: last frequency.
      duration_s: less the rests.
      held_back: whether it runs the other way round, from high to low and down first, so that it tells something new.

    Returns:
      Excitation about zero [rad], shape (N,).
    """
    time = TICK_S * np.arange(round(duration_s / TICK_S))
    first, last = (high_hz, low_hz) if held_back else (low_hz, high_hz)
    cycles = first * time + 0.5 * (last - first) * time**2 / duration_s
    sign = -1.0 if held_back else 1.0
    return _between_rests(sign * amplitude * np.sin(2.0 * np.pi * cycles))


def steps(size: float, hold_s: float, *, held_back: bool = False) -> Array:
    """Return steps to both sides, each held and followed by a rest as long, shape (N,).

    Args:
      size: of the largest [rad].
      hold_s: how long each is held.
      held_back: whether they have other sizes and another order, so that they tell something new.
    """
    hold = round(hold_s / TICK_S)
    levels = [level for each in _STEP_LEVELS[held_back] for level in (each, 0.0)]
    return _between_rests(np.repeat(size * np.array(levels), hold))


def _between_rests(signal: Array) -> Array:
    rest = np.zeros(round(REST_S / TICK_S))
    return np.concatenate([rest, signal, rest])

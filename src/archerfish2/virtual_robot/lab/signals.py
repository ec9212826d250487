"""Excitations: sweeps and steps about rest, sampled at the firmware's ticks."""

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.description import TICK_S

Array = NDArray[np.float64]

REST_S = 0.5
"""At rest before and after every excitation [s]."""
_STEP_LEVELS = (
    (1.0, 0.03, -0.94, 0.05, -1.0, -0.04, 0.97, -0.02, 0.91, 0.07),
    (-1.0, 0.02, 0.63, 0.06, -0.58, -0.03, 0.98, 0.04, -0.95, -0.05),
)
"""Levels of a step log and of the one that is held back. They are uneven, since an encoder's step and friction leave an
error that depends on the level: always back to the same one, it would be the same each time and pass for a gain."""
_HOLDS = (1.0, 0.7, 1.3, 0.85, 1.15, 0.75, 1.2, 1.05, 0.8, 1.2)
"""How long each level is held, of the time asked for. Friction leaves a small error after each step; at equal
intervals these errors would look like a slow oscillation of the axis, and a fit would make a pole of it."""


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
    """Return steps to both sides, each held and followed by one back to near the middle, shape (N,).

    Args:
      size: of the largest [rad].
      hold_s: how long each is held, about.
      held_back: whether they have other sizes and another order, so that they tell something new.
    """
    counts = [round(share * hold_s / TICK_S) for share in _HOLDS]
    return _between_rests(np.repeat(size * np.array(_STEP_LEVELS[held_back]), counts))


def _between_rests(signal: Array) -> Array:
    rest = np.zeros(round(REST_S / TICK_S))
    return np.concatenate([rest, signal, rest])

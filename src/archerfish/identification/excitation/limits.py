"""Excitation within what a gimbal may be asked: its travel, rate and acceleration, judged sample by sample."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.records.limits import AxisLimits

Array = NDArray[np.float64]

_SHARPNESS = 6.0
"""Exponent of the soft minimum: a rounded corner lies 11 % below a sharp one."""


class Budget(NamedTuple):
    """How far, how fast and how sharply a signal may leave the centre angle."""

    angle: float
    """Largest distance from the centre [rad]."""
    rate: float
    """Largest rate [rad/s]."""
    acceleration: float
    """Largest acceleration [rad/s²]."""


class Demand(NamedTuple):
    """What a signal asks of the axis, from its samples, with rest before and after."""

    low: float
    """Smallest angle [rad]."""
    high: float
    """Largest angle [rad]."""
    rate: float
    """Largest difference of neighbouring samples per sampling period [rad/s]."""
    acceleration: float
    """Largest second difference per sampling period squared [rad/s²]."""


def excitation_budget(limits: AxisLimits, centre: float, share: float) -> Budget:
    """Return what a signal about a centre angle may use.

    Args:
      limits: of the axis.
      centre: angle that the signal begins and ends at [rad].
      share: of the limits that is used, 0…1; the rest is for the axis' own overshoot.

    Raises:
      InputError: if the centre lies outside the travel, or the share is not above 0 and at most 1.
    """
    if not limits.low < centre < limits.high:
        raise InputError(
            f"the centre, {np.degrees(centre):g}°, must be inside the travel of {np.degrees(limits.low):g}° to "
            f"{np.degrees(limits.high):g}°; choose another --centre-deg"
        )
    if not 0 < share <= 1:
        raise InputError(f"the share of the limits that is used must be above 0 and at most 1, got {share:g}")
    reach = min(limits.high - centre, centre - limits.low)
    return Budget(share * reach, share * limits.max_rate, share * limits.max_acceleration)


def sine_amplitude(frequency_hz: Array, budget: Budget) -> Array:
    """Return the largest amplitude of a sine at each frequency.

        A(f) = min(angle, rate / 2πf, acceleration / (2πf)²), its corners rounded off

    In a sweep a corner of A(f) is a jump of the rate, and an acceleration beyond all limits.

    Args:
      frequency_hz: frequencies [Hz], shape (F,).
      budget: what may be used.

    Returns:
      Amplitudes [rad], shape (F,).
    """
    omega = np.maximum(2 * np.pi * frequency_hz, 1e-9)
    bounds = np.stack([np.full_like(omega, budget.angle), budget.rate / omega, budget.acceleration / omega**2])
    return np.asarray(np.sum(bounds**-_SHARPNESS, axis=0) ** (-1 / _SHARPNESS))


def demand(command: Array, sample_period_s: float) -> Demand:
    """Measure what a command, shape (N,) in radians, asks; it comes from rest and ends at rest."""
    padded = np.concatenate([command[:1], command[:1], command, command[-1:], command[-1:]])
    rate = np.diff(padded) / sample_period_s
    return Demand(
        float(command.min()),
        float(command.max()),
        float(np.abs(rate).max()),
        float(np.abs(np.diff(rate)).max() / sample_period_s),
    )


def fitted(signal: Array, budget: Budget, sample_period_s: float) -> Array:
    """Scale a signal about zero, shape (N,), so that it fits the budget and spends at least one part of it whole."""
    asked = demand(signal, sample_period_s)
    ratios = (
        max(-asked.low, asked.high) / budget.angle,
        asked.rate / budget.rate,
        asked.acceleration / budget.acceleration,
    )
    # A hair less, so that rounding of the centre's sum keeps the limit too.
    return np.asarray(signal * ((1 - 1e-9) / max(ratios)))


def faded(signal: Array, fade_s: float, sample_period_s: float) -> Array:
    """Let a signal, shape (N,), swell from zero and die away within `fade_s` at either end (half a cosine each)."""
    count = min(round(fade_s / sample_period_s), len(signal) // 2)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / max(count, 1))
    window = np.ones(len(signal))
    window[:count] = ramp
    window[len(signal) - count :] = ramp[::-1]
    return np.asarray(signal * window)


def slew_time(jump: float, budget: Budget) -> float:
    """Return the shortest time [s] for a jump [rad] from rest to rest that accelerates, then brakes, both evenly.

    max(2 √(jump / acceleration), 2 jump / rate)
    """
    return max(2 * float(np.sqrt(jump / budget.acceleration)), 2 * jump / budget.rate)


def slewed(signal: Array, slew_s: float, sample_period_s: float) -> Array:
    """Give each jump of a signal, shape (N,), `slew_s` of even acceleration and even braking.

    The signal is averaged over half that time twice: the rate of a jump becomes a triangle.
    """
    half = max(1, int(np.ceil(0.5 * slew_s / sample_period_s)))
    for _ in range(2):
        padded = np.concatenate([np.full(half - 1, signal[0]), signal])
        # Windowed sums are differences of one running sum, which would leave its rounding in a constant stretch.
        signal = np.convolve(padded, np.full(half, 1 / half), mode="valid")
    return np.asarray(signal)

"""Commands with which strangers excite an axis: sweeps, steps, staircases, held levels, multisines, binary sequences."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from strangers_rigs import Rig, log_uniform

Array = NDArray[np.float64]

_HIGHEST = 0.4
"""Highest frequency of an excitation, as a share of the sampling rate."""


def command(kind: str, count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Draw a command of peak 1 or below.

    Args:
      kind: one of `COMMANDS`.
      count: samples.
      period_s: sampling period [s].
      rig: the axis; its bandwidth and settling set the scale.
      generator: source of the draws.

    Returns:
      Command at each sample, shape (count,).
    """
    return COMMANDS[kind](count, period_s, rig, generator)


def sweep(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Sweep from far below the bandwidth to above it, linearly or logarithmically in time."""
    time, duration = period_s * np.arange(count), period_s * count
    low = rig.bandwidth_hz * log_uniform(generator, 0.02, 0.5)
    high = max(min(rig.bandwidth_hz * log_uniform(generator, 2.0, 6.0), _HIGHEST / period_s), 1.5 * low)
    if generator.random() < 0.5:
        return np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * duration)))
    growth = np.log(high / low) / duration
    return np.asarray(np.sin(2 * np.pi * low * np.expm1(growth * time) / growth))


def step(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Step once the axis has rested for 0.1 to 2 s, at most half of the log; of every other log, also step back."""
    rest = int(min(log_uniform(generator, 0.1, 2.0) / period_s, count / 2))
    return _stepped(count, rest, generator)


def early_step(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Step within the first samples of the log."""
    return _stepped(count, int(generator.integers(0, 6)), generator)


def _stepped(count: int, rest: int, generator: np.random.Generator) -> Array:
    signal = np.where(np.arange(count) < rest, 0.0, generator.choice([-1.0, 1.0]))
    if generator.random() < 0.5:
        signal[rest + int((count - rest) * generator.uniform(0.4, 0.7)) :] = 0.0
    return signal


def staircase(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Step up and down again, one level after another."""
    stairs = int(generator.integers(2, 6))
    levels = np.concatenate([np.arange(stairs), np.arange(stairs, 0, -1)]) / stairs
    return np.asarray(levels[np.arange(count) * len(levels) // count])


def held_levels(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Hold random levels for random times, some too short to settle."""
    shortest = max(0.3 * rig.settle_s / period_s, 1.0)
    spans = np.ceil(shortest * 10 ** generator.uniform(0, 1, int(count / shortest) + 1)).astype(int)
    return np.repeat(generator.uniform(-1, 1, len(spans)), spans)[:count]


def multisine(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Sum sines of random phases in and around the band."""
    low = max(0.05 * rig.bandwidth_hz, 1 / (count * period_s))
    high = max(min(4 * rig.bandwidth_hz, _HIGHEST / period_s), 2 * low)
    return sum_of_sines(count, period_s, np.geomspace(low, high, int(generator.integers(8, 30))), generator)


def sum_of_sines(count: int, period_s: float, frequency_hz: Array, generator: np.random.Generator) -> Array:
    """Sum sines of equal amplitude and random phases to a peak of 1.

    Args:
      count: samples.
      period_s: sampling period [s].
      frequency_hz: of the sines [Hz], shape (L,).
      generator: source of the phases.
    """
    time = period_s * np.arange(count)
    signal = np.zeros(count)
    for frequency, phase in zip(frequency_hz, generator.uniform(0, 2 * np.pi, len(frequency_hz)), strict=True):
        signal += np.sin(2 * np.pi * frequency * time + phase)
    return np.asarray(signal / np.abs(signal).max())


def binary(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Draw one of two levels at every tick of a clock about as fast as the axis."""
    clock = max(round(log_uniform(generator, 0.1, 0.8) / rig.bandwidth_hz / period_s), 1)
    return np.repeat(generator.choice([-1.0, 1.0], -(-count // clock)), clock)[:count]


def sine(count: int, period_s: float, rig: Rig, generator: np.random.Generator) -> Array:
    """Move in a single sine."""
    frequency = rig.bandwidth_hz * log_uniform(generator, 0.1, 2.0)
    return np.asarray(np.sin(2 * np.pi * frequency * period_s * np.arange(count)))


COMMANDS: dict[str, Callable[[int, float, Rig, np.random.Generator], Array]] = {
    "sweep": sweep,
    "step": step,
    "early step": early_step,
    "staircase": staircase,
    "held levels": held_levels,
    "multisine": multisine,
    "binary": binary,
    "sine": sine,
}
"""Name → how to draw it."""

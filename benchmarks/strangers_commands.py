"""Commands by which strangers move an axis: sweeps, steps, staircases, held levels, multisines, binary sequences."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from strangers_rigs import Rig, log_uniform

Array = NDArray[np.float64]

_HIGHEST = 0.4
"""Highest frequency of an excitation, as a share of the sampling rate."""


class Occasion(NamedTuple):
    """What a command is for."""

    samples: int
    """How many samples it has."""
    period_s: float
    """Sampling period [s]."""
    rig: Rig
    """The axis; its bandwidth and settling set the scale."""
    generator: np.random.Generator
    """Source of the draws."""


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
    return COMMANDS[kind](Occasion(count, period_s, rig, generator))


def sweep(log: Occasion) -> Array:
    """Sweep from far below the bandwidth to above it, linearly or logarithmically in time."""
    time, duration = log.period_s * np.arange(log.samples), log.period_s * log.samples
    low = log.rig.bandwidth_hz * log_uniform(log.generator, 0.02, 0.5)
    high = max(min(log.rig.bandwidth_hz * log_uniform(log.generator, 2.0, 6.0), _HIGHEST / log.period_s), 1.5 * low)
    if log.generator.random() < 0.5:
        return np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * duration)))
    growth = np.log(high / low) / duration
    return np.asarray(np.sin(2 * np.pi * low * np.expm1(growth * time) / growth))


def step(log: Occasion) -> Array:
    """Step once the axis has rested for 0.1 to 2 s, at most half of the log; of every other log, also step back."""
    rest = int(min(log_uniform(log.generator, 0.1, 2.0) / log.period_s, log.samples / 2))
    return _stepped(log, rest)


def early_step(log: Occasion) -> Array:
    """Step within the first samples of the log."""
    return _stepped(log, int(log.generator.integers(0, 6)))


def _stepped(log: Occasion, rest: int) -> Array:
    signal = np.where(np.arange(log.samples) < rest, 0.0, log.generator.choice([-1.0, 1.0]))
    if log.generator.random() < 0.5:
        signal[rest + int((log.samples - rest) * log.generator.uniform(0.4, 0.7)) :] = 0.0
    return signal


def staircase(log: Occasion) -> Array:
    """Step up and down again, one level after another."""
    stairs = int(log.generator.integers(2, 6))
    levels = np.concatenate([np.arange(stairs), np.arange(stairs, 0, -1)]) / stairs
    return np.asarray(levels[np.arange(log.samples) * len(levels) // log.samples])


def held_levels(log: Occasion) -> Array:
    """Hold random levels for random times, some too short to settle."""
    shortest = max(0.3 * log.rig.settle_s / log.period_s, 1.0)
    spans = np.ceil(shortest * 10 ** log.generator.uniform(0, 1, int(log.samples / shortest) + 1)).astype(int)
    return np.repeat(log.generator.uniform(-1, 1, len(spans)), spans)[: log.samples]


def multisine(log: Occasion) -> Array:
    """Sum sines of random phases in and around the band."""
    low = max(0.05 * log.rig.bandwidth_hz, 1 / (log.samples * log.period_s))
    high = max(min(4 * log.rig.bandwidth_hz, _HIGHEST / log.period_s), 2 * low)
    return sum_of_sines(
        log.samples, log.period_s, np.geomspace(low, high, int(log.generator.integers(8, 30))), log.generator
    )


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


def binary(log: Occasion) -> Array:
    """Draw one of two levels at every tick of a clock about as fast as the axis."""
    clock = max(round(log_uniform(log.generator, 0.1, 0.8) / log.rig.bandwidth_hz / log.period_s), 1)
    return np.repeat(log.generator.choice([-1.0, 1.0], -(-log.samples // clock)), clock)[: log.samples]


def sine(log: Occasion) -> Array:
    """Move in a single sine."""
    frequency = log.rig.bandwidth_hz * log_uniform(log.generator, 0.1, 2.0)
    return np.asarray(np.sin(2 * np.pi * frequency * log.period_s * np.arange(log.samples)))


COMMANDS: dict[str, Callable[[Occasion], Array]] = {
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

"""The sound log that every bad one is made from: a simulated axis that follows its command."""

import io
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

PERIOD = 0.01
SAMPLES = 600
WORDS = ["--order", "2", "--max-delay", "3"]


def response(command, delay=1):
    """Follow a command with a steady gain of 1, two poles at 0.85 ± 0.15i, and a delay."""
    poles = np.array([0.85 + 0.15j, 0.85 - 0.15j])
    denominator = np.real(np.poly(poles))
    numerator = np.concatenate([np.zeros(delay), [denominator.sum()]])
    return lfilter(numerator, denominator, command)


def noise(count, seed, share=0.01):
    return share * np.random.default_rng(seed).standard_normal(count)


def command(count=SAMPLES, seed=0):
    """Steps of random height and length: rich, and slow enough for a gimbal."""
    rng = np.random.default_rng(seed)
    heights = np.repeat(rng.uniform(-0.3, 0.3, count), rng.integers(5, 30, count))
    return heights[:count]


def sweep(count=SAMPLES, low=0.5, high=15.0, period=PERIOD):
    time = period * np.arange(count)
    return 0.3 * np.sin(2 * np.pi * (low * time + (high - low) * time**2 / (2 * period * count)))


def sound(count=SAMPLES, seed=0, u=None, delay=1):
    """Return time, command and angle of a log without faults."""
    u = command(count, seed) if u is None else u
    y = response(u, delay)
    return PERIOD * np.arange(len(u)), u, y + 0.01 * y.std() * np.random.default_rng(seed + 100).standard_normal(len(u))


def table(time, u, y, *, names=("time_s", "u", "y"), separator=",", end="\n"):
    """Return a log as text."""
    text = io.StringIO()
    np.savetxt(text, np.column_stack([time, u, y]), fmt="%.10g", delimiter=separator, newline=end)
    return separator.join(names) + end + text.getvalue()


def write(folder: Path, text, name="log.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path

"""Logs as spectra with their transients.

At the lines of the discrete Fourier transform of a log of N samples a linear system has the exact response

    Y(z) = G(z) z^d U(z) + Σ (c₁ + c₂ z) / (1 + a₁ z + a₂ z²) + …,    z = e^{−2πik/N}

whose transients (Pintelon and Schoukens, System Identification, 2012, section 6.3.2) stand for all that happened before
the log and after it. The line of the mean is left out, so levels of inputs and outputs don't matter.

A log that begins at rest is extended backwards by its own length, which more than halves the scatter of the steady gain
of one step. Of a log that begins in a motion, which its inputs don't show, the first samples are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.fft import rfft
from numpy.typing import NDArray

from archerfish.identification.simulation import TINY, Array, Complex

_EDGES = (3, 6, 12, 24, 48, 96)  # lines between which the power law of a slow wander is fitted
_STEEP, _STEEPEST = -0.7, -2.0  # slope of the law from which it is taken, and at most
_LEAST_LEFT = 0.2  # share of the noise in a residual


def noise_power(squares: Array) -> Array:
    """Return a residual's power at each line, smooth over octaves: each counts the next higher one as eight lines more.

    Args:
      squares: of the residual, shape (F,).
    """
    n = len(squares)
    edges = list(dict.fromkeys([0, *(2**k - 1 for k in range(1, int(np.log2(n + 1)) + 1)), n]))
    above, means = squares[n // 2 :].mean(), []
    for low, high in zip(edges[-2::-1], edges[:0:-1], strict=True):
        above = (squares[low:high].sum() + 8 * above) / (high - low + 8)
        means.append(np.log(max(above, TINY)))
    centres = [np.log(0.5 * (low + high + 1)) for low, high in pairwise(edges)]
    return np.asarray(np.exp(np.interp(np.log(np.arange(1, n + 1)), centres, means[::-1])))


def slow_wander(squares: Array, most: int) -> Array:
    """Return the power law of a slow wander, continued to the lowest lines, from which a fit removes it; 0 without one.

    Args:
      squares: of the residual, shape (F,).
      most: lines to which the law is fitted at most.
    """
    law = np.zeros(len(squares))
    edges = [edge for edge in _EDGES if edge <= min(len(squares), most)]
    means = np.array([squares[low - 1 : high - 1].mean() for low, high in pairwise(edges)])
    if len(means) < 2 or not np.all(means > 0):
        return law
    centres = [0.5 * np.log(low * high) for low, high in pairwise(edges)]
    slope, level = np.polyfit(centres, np.log(means), 1, w=np.sqrt(np.diff(edges)))
    if slope < _STEEP:
        law[: edges[-1] - 1] = np.exp(level + max(slope, _STEEPEST) * np.log(np.arange(1, edges[-1])))
    return law


def local_power(squares: Array, left: Array) -> Array:
    """Return the power of the noise around each line, for draws, shape (F,).

    Args:
      squares: of a residual, shape (F,).
      left: share of the noise that is in it, shape (F,).
    """
    width = 2 * max(2, round(np.sqrt(len(squares)) / 2)) + 1
    padded = np.pad([squares, left], ((0, 0), (width // 2, width // 2)), mode="symmetric")
    power, share = (np.convolve(row, np.full(width, 1 / width), mode="valid") for row in padded)
    return np.asarray(np.maximum(power / np.maximum(share, _LEAST_LEFT), slow_wander(squares, width)))


Indices = NDArray[np.int64]
Weights = Sequence[Array] | None
_HELD = 1e-9  # of an input's range, within which it counts as held
_LINES_A_LOG, _FEWEST_LINES = 60, 6  # that each log keeps, of up to ten logs and of very many
ROUNDING = 1e-16
"""Of the outputs' power; no residual counts as smaller."""


class Lines(NamedTuple):
    """Some lines of a log at one delay, each multiplied by a weight; or soft constraints, which have no transients."""

    z: Complex  # delay of one sample, (F,)
    inputs: Complex  # delayed, (m, F)
    outputs: Complex  # (p, F)
    impulse: Complex  # at the first sample, which transients start from, (F,); (0,) of constraints
    own: Complex  # columns of this log alone that don't depend on poles, (q, F)
    feedthrough: bool = True  # whether the plant may have one

    def pick(self, indices: Indices, weight: Array | None = None) -> "Lines":
        """Return some lines, multiplied by weights.

        Args:
          indices: of the lines, shape (k,).
          weight: of all lines, shape (F,).
        """
        w = np.ones(len(indices)) if weight is None else weight[indices]
        return self._replace(
            z=self.z[indices],
            inputs=self.inputs[:, indices] * w,
            outputs=self.outputs[:, indices] * w,
            impulse=self.impulse[indices] * w,
            own=self.own[:, indices] * w,
        )


@dataclass(eq=False)
class Experiment:
    """One log of N samples of m inputs and p outputs, and how its beginning is taken."""

    u: Array  # (N, m)
    y: Array  # (N, p)
    pad: int = 0  # samples of its first rest that are put before it
    rest: int = 1  # samples whose mean is the level of that rest
    skip: int = 0  # samples that are left out at its beginning
    drift: bool = False  # whether its outputs drift, by a polynomial of third degree
    length: int = field(init=False)  # samples that are transformed
    measured: int = field(init=False)  # those of them that were measured
    z: Complex = field(init=False)  # delay of one sample at each line, (F,)
    outputs: Complex = field(init=False)  # (p, F)

    def __post_init__(self) -> None:
        y = self.lengthened(self.y)
        n = self.length = len(y)
        self.measured = n - self.pad
        k = np.arange(1, n // 2 + 1)
        self.z = np.exp(-2j * np.pi * k / n)
        # Squared sizes over the lines sum to those over the samples, so the line at half the sampling rate counts half.
        self.size = np.where(2 * k == n, np.sqrt(0.5), 1.0).astype(complex)
        self.outputs = self.transform(y)
        # The level of the rest is known no better than its samples' noise allows, so it is estimated as well.
        level = (np.arange(n) < self.pad).astype(float)[:, None]
        time = np.concatenate([np.full(self.pad, -1.0), np.linspace(-1, 1, len(self.y))])[self.skip :, None]
        self._own = self.transform(np.hstack([level[:, : self.pad > 0], time ** np.arange(1, 1 + 3 * self.drift)]))
        self._lines = lru_cache(16)(self._delayed)

    def at(self, delay: int, feedthrough: bool = True) -> Lines:
        """Return all lines with inputs that are delayed by some samples."""
        return self._lines(delay)._replace(feedthrough=feedthrough)

    def lengthened(self, x: Array) -> Array:
        """Return signals of the log, shape (N, k), with the rest that is put before it and without its beginning."""
        return np.vstack([np.repeat(x[: self.rest].mean(0)[None], self.pad, 0), x])[self.skip :]

    def transform(self, x: Array) -> Complex:
        """Return the lines of k signals, shape (N, k) → (k, F)."""
        scaled = np.sqrt(2 / self.length) * self.size[:, None] * rfft(x, axis=0)[1:]
        return np.ascontiguousarray(scaled.T)

    def _delayed(self, delay: int) -> Lines:
        u = np.vstack([np.repeat(self.u[:1], self.pad + delay, 0), self.u[: len(self.u) - delay]])
        return Lines(self.z, self.transform(u[self.skip :]), self.outputs, self.size, self._own)


def resting_samples(u: Array, y: Array) -> int:
    """Return for how many samples, from the first, inputs are held and no output changes by more than noise.

    Args:
      u: inputs, shape (N, m).
      y: outputs, shape (N, p).
    """
    n = int(np.argmax((np.abs(u - u[0]) > _HELD * np.ptp(u, axis=0)).any(1)))
    if n < 2:
        return 0
    third = max(1, n // 3)
    change = np.abs(y[n - third : n].mean(0) - y[:third].mean(0))
    noise = np.std(np.diff(y[:n], axis=0), axis=0) / np.sqrt(2) if n > 2 else np.zeros(y.shape[1])
    still = change <= np.maximum(0.01 * np.ptp(y, axis=0), 6 * noise * np.sqrt(2 / third))
    return n if np.all(still & (y[:n].std(0) <= 0.3 * y.std(0))) else 0


def mostly_held(u: Array) -> bool:
    """Return whether inputs, shape (N, m), are held for most of a log, as those of steps are."""
    still = np.abs(np.diff(u, axis=0)) <= _HELD * np.ptp(u, axis=0)
    return bool(np.mean(np.all(still, axis=1)) > 0.5)


def begun_log(u: Array, y: Array, longest: int) -> Experiment:
    """Return a log, extended by its rest if it has one and its inputs are mostly held.

    Args:
      u: inputs, shape (N, m).
      y: outputs, shape (N, p).
      longest: delay that is considered [samples].
    """
    if rest := resting_samples(u, y):
        return Experiment(u, y, pad=len(y) if mostly_held(u) else 0, rest=rest)
    return Experiment(u, y, skip=unsettled_samples(u, longest))


def unsettled_samples(u: Array, longest: int) -> int:
    """Return how many samples of a log inputs from before it may act on; 0 where its inputs move most at its beginning.

    Args:
      u: inputs, shape (N, m).
      longest: delay that is considered [samples].
    """
    moves = np.diff(u, axis=0) ** 2
    share = moves[:longest].sum(0) / np.maximum(moves.sum(0), TINY)
    return longest if longest and share.max() <= 2 * longest / len(moves) else 0


def rounding_floor(experiments: Sequence[Experiment]) -> float:
    """Return the sum of squares below which a residual is rounding."""
    return ROUNDING * sum(float(np.sum(np.abs(log.outputs) ** 2)) for log in experiments) + TINY


def lines_of(
    logs: Sequence[Experiment], picks: Sequence[Indices], delay: int, feedthrough: bool = True, weights: Weights = None
) -> list[Lines]:
    """Return some lines of each log.

    Args:
      logs: the logs.
      picks: indices of each log's lines, shape (k,).
      delay: of the inputs [samples].
      feedthrough: whether the plant may have one.
      weights: of all lines of each log, shape (F,).
    """
    every: Sequence[Array | None] = weights or [None] * len(picks)
    return [e.at(delay, feedthrough).pick(k, w) for e, k, w in zip(logs, picks, every, strict=True)]


def _lines_of_each(logs: int) -> int:
    """Return how many lines each log keeps at least, fewer where there are more than ten logs."""
    return max(_FEWEST_LINES, min(_LINES_A_LOG, 10 * _LINES_A_LOG // logs))


def thinned(experiments: Sequence[Experiment], count: int) -> list[Indices]:
    """Return indices of about `count` lines: half those of the strongest input, the others spread over the rest."""
    total, kept = sum(len(log.z) for log in experiments), list[Indices]()
    for log in experiments:
        size = len(log.z)
        here = max(_lines_of_each(len(experiments)), count * size // total)
        if size <= here:
            kept.append(np.arange(size))
            continue
        power = np.abs(log.at(0).inputs) ** 2
        power = (power / np.maximum(power.mean(1, keepdims=True), TINY)).sum(0)
        order = np.argsort(-power, kind="stable")
        rest = np.sort(order[here // 2 :])
        step = -(-len(rest) // (here - here // 2))
        kept.append(np.sort(np.append(order[: here // 2], rest[::step])))
    return kept


def strongest(powers: Sequence[Array], count: float) -> list[Indices]:
    """Return indices of the lines of the largest power, some of each log and at least a fiftieth.

    Args:
      powers: of the lines of each log, shape (F,) each.
      count: of lines, in all.
    """
    total, kept = sum(map(len, powers)), list[Indices]()
    for power in powers:
        size = len(power)
        fewest = max(min(size, _lines_of_each(len(powers))), size // 50)
        here = int(np.clip(count * size / total, fewest, size))
        kept.append(np.sort(np.argsort(-power, kind="stable")[:here]))
    return kept

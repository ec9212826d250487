"""The steady gain as a constraint: known from the drawing, or from a static measurement, and not up to the logs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import stdtrit

from archerfish.identification.axis.pole_refinement import Problem
from archerfish.identification.axis.simulation_fit import Penalty
from archerfish.records.recording import Recording

_FEWEST_PLATEAUS, _ROUNDING = 3, 1e-6
_FIRMNESS = 1e4
"""Weight of the constraint over the size of the measured outputs; the gain is then held to about its inverse square."""


class PlateauGain(NamedTuple):
    """The steady gain by the plateaus of steps."""

    gain: float
    """Output per input."""
    low: float
    """Lower end of its 95 % interval, by the scatter of the plateaus."""
    high: float
    """Upper end."""


def plateau_gain(recording: Recording, hold_s: float = 1.0) -> PlateauGain | None:
    """Return the steady gain that the steps of a log show where they have come to rest, None without such steps.

    Where friction holds an axis short of its aim, a fit of the whole log lets a slow pole of its own invention explain
    that; the plateaus, reached from both sides, don't care how they were reached.

    Args:
      recording: one input and one output.
      hold_s: how long an input must be held to count; the last fifth of the time is looked at.
    """
    u, y = recording.inputs[:, 0], recording.outputs[:, 0]
    ends = np.append(np.flatnonzero(np.abs(np.diff(u)) > _ROUNDING * np.ptp(u)), len(u) - 1)
    begins = np.append(0, ends[:-1] + 1)
    long = ends - begins >= hold_s / recording.sample_period_s
    held = [(begin + (end - begin) * 4 // 5, end) for begin, end in zip(begins[long], ends[long], strict=True)]
    levels = np.array([u[end] for _, end in held])
    if len(levels) < _FEWEST_PLATEAUS or np.ptp(levels) == 0:
        return None
    reached = np.array([y[begin : end + 1].mean() for begin, end in held])
    centred = levels - levels.mean()
    squares = float(centred @ centred)
    gain = float(centred @ reached) / squares
    scatter = reached - reached.mean() - gain * centred
    error = float(np.sqrt(scatter @ scatter / (len(levels) - 2) / squares))
    half = float(stdtrit(len(levels) - 2, 0.975)) * error
    return PlateauGain(gain, gain - half, gain + half)


def constrained_gain(problem: Problem, gains: Sequence[float], scale: float) -> Problem:
    """Add to a problem with one output that its steady gains be what is given.

    Args:
      problem: experiments with m inputs and one output in units of `scale`.
      gains: steady output per steady input of each input, in units of the output, m numbers.
      scale: unit of the problem's output.
    """
    size, driving = (
        np.sqrt(sum(float(np.sum(np.abs(signal) ** 2)) for signal in signals))
        for signals in ([each.outputs for each in problem.experiments], [each.inputs for each in problem.experiments])
    )
    # A gain of zero is as legitimate as any: then the gain in the band is the measure.
    weight = _FIRMNESS * size / max(float(np.max(np.abs(gains))) / scale, float(size / driving))
    point, rows = np.ones(1, np.complex128), np.array([[weight, 0.0]])
    wished = [weight * np.full((1, 1), gain / scale) for gain in gains]
    old = problem.penalty
    if old is None:
        return problem._replace(penalty=Penalty(point, tuple(rows for _ in gains), tuple(wished)))
    joined = tuple(_beside(each, rows) for each in old.rows)
    targets = tuple(np.concatenate(pair) for pair in zip(old.targets, wished, strict=True))
    return problem._replace(penalty=Penalty(np.append(old.lag, point), joined, targets, old.pull))


def _beside(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Join weights over different points, shape (rows, 2 points) each, real parts over all before imaginary parts."""
    halves = [np.hsplit(each, 2) for each in (one, other)]
    return np.hstack([block_diag(*parts) for parts in zip(*halves, strict=True)])

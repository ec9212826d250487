"""Steady gain by the plateaus of steps, which friction moves to both sides alike.

Where friction holds an axis short of its aim, a fit of the whole log explains that by a slow pole; the levels at which
the axis comes to rest, reached from both sides, don't depend on how they were reached.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from archerfish2.identification.simulation import Array
from archerfish2.logs.recording import Recording
from archerfish2.reports.table import Estimate

_FEWEST = 3  # plateaus
_STILL = 2e-3  # of the output's range, by which the means of both halves of a plateau may differ, beside their noise
_HELD = 1e-6  # of an input's range, within which it counts as held


def plateau_gain(recordings: Sequence[Recording], hold_s: float = 1.0) -> Estimate | None:
    """Return the slope of the resting output over the held input, with Student's interval; None without such steps.

    Args:
      recordings: of one input and one output, each with a zero of its own.
      hold_s: how long an input must be held to count; the last fifth of that time is averaged [s].
    """
    found = [each for each in (_plateaus(each, hold_s) for each in recordings) if len(each[0])]
    levels, reached = (np.concatenate([np.zeros(0), *each]) for each in ([x for x, _ in found], [y for _, y in found]))
    squares, freedom = float(levels @ levels), len(levels) - len(found) - 1
    if len(levels) < _FEWEST or squares == 0 or freedom < 1:
        return None
    gain = float(levels @ reached) / squares
    scatter = reached - gain * levels
    half = float(stdtrit(freedom, 0.975)) * float(np.sqrt(scatter @ scatter / freedom / squares))
    return Estimate(gain, gain - half, gain + half)


def _plateaus(recording: Recording, hold_s: float) -> tuple[Array, Array]:
    """Levels of the input and of the output at rest, each less their mean."""
    u, y = recording.inputs[:, 0], recording.outputs[:, 0]
    ends = np.append(np.flatnonzero(np.abs(np.diff(u)) > _HELD * np.ptp(u)), len(u) - 1)
    begins = np.append(0, ends[:-1] + 1)
    long = ends - begins + 1 >= hold_s / recording.period_s - 1e-6
    held = [(b + (e - b) * 4 // 5, e) for b, e in zip(begins[long], ends[long], strict=True)]
    held = [(b, e) for b, e in held if _rests(y[b : e + 1], float(_STILL * np.ptp(y)))]
    levels, reached = np.array([u[e] for _, e in held]), np.array([y[b : e + 1].mean() for b, e in held])
    return (levels - levels.mean(), reached - reached.mean()) if held else (levels, reached)


def _rests(y: Array, tolerance: float) -> bool:
    """Return whether the means of both halves agree, to their noise or a tolerance."""
    first, second = y[: len(y) // 2], y[len(y) // 2 :]
    noise = np.std(np.diff(y)) / np.sqrt(2) * np.sqrt(4 / len(y))
    return bool(abs(second.mean() - first.mean()) <= max(tolerance, 3 * noise))

"""Steady gain by the levels at which steps come to rest.

Where friction holds an axis short of its aim, a fit of the whole log explains that by a slow pole. At rest

    y = gain · u + friction · direction + constant of the log,

the direction being that of the step into the level. Least squares over the plateaus of all logs give the gain. Its
interval is Student's, with the rounding of the outputs and with what the steps may still move.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import stdtrit

from archerfish.identification.simulation import Array
from archerfish.identification.statistics import Z95
from archerfish.logs.recording import Recording
from archerfish.reports.table import Estimate

_AVERAGED = 5  # the last fifth of a plateau
_FEW_VALUES = 10
_HELD = 1e-6  # of an input's range, within which it counts as held
_RATES = np.linspace(1.2, 60.0, 1000)
"""Hold over the time constant of a lag: its step moves e^(-0.85 r) - e^(-0.95 r) of itself from the first half of the
last fifth to the second, and e^(-0.9 r) is left to move there."""


class Plateaus(NamedTuple):
    """The times of one log in which the input is held for long."""

    level: Array  # of the input, (K,)
    step: Array  # of the input into that level, 0 where the log begins, (K,)
    reached: Array  # mean output of the last fifth, (K,)
    moved: Array  # mean of that fifth's second half less the first's, (K,)
    moved_error: Array  # standard error of it, (K,)
    resolution: Array  # smallest difference of outputs, to which they are rounded, (K,)


def plateau_gain(recordings: Sequence[Recording], hold_s: float = 0.4) -> Estimate | None:
    """Return the steady gain with its interval; None without enough steps that come to rest.

    Args:
      recordings: of one input and one output, each with a zero of its own.
      hold_s: how long an input must be held to count; the last fifth of that time is averaged [s].
    """
    logs = [log for log in (_plateaus(recording, hold_s) for recording in recordings) if log.level.size]
    if not logs:
        return None
    level, direction, reached = (np.concatenate(columns) for columns in zip(*map(_centred, logs), strict=True))
    rounding = _rounding(logs)
    # Levels that are entered from one side alone don't tell gain from friction.
    with_friction = _slope(np.column_stack([level, direction]), reached, rounding, len(logs))
    without_friction = _slope(level[:, None], reached, rounding, len(logs))
    if with_friction is None or without_friction is None:
        return None
    gain, friction = with_friction
    half = gain.high - gain.value
    if friction.low <= 0 <= friction.high:  # friction that is not significant may be there all the same
        half = max(half, without_friction[0].high - without_friction[0].value)
        gain = without_friction[0]
    half += abs(gain.value) * max(map(_left_to_move, logs))
    return Estimate(gain.value, gain.value - half, gain.value + half) if np.isfinite(half) else None


def _plateaus(recording: Recording, hold_s: float) -> Plateaus:
    u, y = recording.inputs[:, 0], recording.outputs[:, 0]
    ends = np.append(np.flatnonzero(np.abs(np.diff(u)) > _HELD * np.ptp(u)), len(u) - 1)
    begins = np.append(0, ends[:-1] + 1)
    # A hold of exactly `hold_s` counts, also where the period is not a binary fraction.
    long = ends - begins + 1 >= hold_s / recording.period_s - 1e-6
    values = np.unique(y)
    # Of few values the smallest difference is none of rounding.
    resolution = float(np.diff(values).min()) if len(values) > _FEW_VALUES else 0.0
    rows = [(*_plateau(u, y, begin, end), resolution) for begin, end in zip(begins[long], ends[long], strict=True)]
    return Plateaus(*np.array(rows).reshape(-1, len(Plateaus._fields)).T)


def _plateau(u: Array, y: Array, begin: int, end: int) -> tuple[float, float, float, float, float]:
    """Return level, step, mean output, its movement and the error of that, as in `Plateaus`."""
    last = y[end - max((end - begin) // _AVERAGED, 1) : end + 1]
    half = len(last) // 2
    moved = last[half:].mean() - last[:half].mean()
    noise = np.std(np.diff(last)) / np.sqrt(2)
    step = u[begin] - u[begin - 1] if begin else 0.0
    return float(u[end]), float(step), float(last.mean()), float(moved), float(noise * np.sqrt(4 / len(last)))


def _left_to_move(log: Plateaus) -> float:
    """Return the share of a step that may be left to move where outputs are averaged; infinite if it is large."""
    squares = float(log.step @ log.step)
    if squares == 0:
        return 0.0
    moved = abs(float(log.step @ log.moved)) / squares
    most = moved + Z95 * float(np.linalg.norm(log.step * log.moved_error)) / squares
    moves = np.exp(-0.85 * _RATES) - np.exp(-0.95 * _RATES)
    return float(np.interp(most, moves[::-1], np.exp(-0.9 * _RATES)[::-1], left=0.0, right=np.inf))


def _centred(log: Plateaus) -> tuple[Array, Array, Array]:
    """Return level, direction and mean output, each less its mean over the log."""
    direction = np.sign(log.step)
    return log.level - log.level.mean(), direction - direction.mean(), log.reached - log.reached.mean()


def _rounding(logs: Sequence[Plateaus]) -> Array:
    """Return the standard deviation of each plateau's output by the rounding at each level, shape (K, levels).

    A level is rounded alike each time, so that its plateaus have one error.
    """
    blocks = [(log.level[:, None] == np.unique(log.level)) * log.resolution[0] / np.sqrt(12) for log in logs]
    return np.asarray(block_diag(*blocks))


def _slope(columns: Array, reached: Array, rounding: Array, constants: int) -> list[Estimate] | None:
    """Return the coefficients of a regression with Student's intervals; None if there are too few plateaus.

    Args:
      columns: regressors without constants, shape (K, c).
      reached: what they explain, shape (K,).
      rounding: standard deviations of its rounding, shape (K, levels).
      constants: how many were removed from both.
    """
    count, coefficients = columns.shape
    freedom = count - constants - coefficients
    if freedom < 1 or np.linalg.matrix_rank(columns) < coefficients:
        return None
    inverse = np.linalg.pinv(columns)
    found = inverse @ reached
    variance = float(np.sum((reached - columns @ found) ** 2)) / freedom
    scatter = stdtrit(freedom, 0.975) * np.sqrt(variance * np.sum(inverse**2, axis=1))
    half = np.hypot(scatter, Z95 * np.linalg.norm(inverse @ rounding, axis=1))
    return [Estimate(float(b), float(b - h), float(b + h)) for b, h in zip(found, half, strict=True)]

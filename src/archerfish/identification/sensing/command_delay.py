"""Delay from a commanded step to the first motion that the log shows: the sum of command and feedback delay.

A fitted plant also has a delay, but trades it against fast poles, in whole samples. What is certain about an axis is
that it has inertia: its torque may jump, its angle then starts as a parabola, whatever the firmware does, saturated or
not. So each response's onset is fitted as a τ² + b τ³ in the time τ since it began. Each step has a delay of its own,
because links hold commands back by a different time each; the mean's interval comes from their scatter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t, trim_mean

from archerfish.identification.sensing.stamp_timing import Z95, Interval
from archerfish.records.sensing_logs import GimbalLog

Array = NDArray[np.float64]

FEWEST = 4
"""Fewest steps from which a mean delay is told."""
LONGEST = 0.2
"""Longest delay that is looked for [s]."""
_REST = 0.15
"""A step counts if the command is still this long [s] on both sides of it."""
_RISE = 0.3
"""Share of the travel up to which the onset is fitted; beyond it the higher powers of time count."""
_LEAST_SAMPLES = 5


class CommandDelay(NamedTuple):
    """Time from commands to motion, over a number of steps."""

    mean: float
    """Mean delay [s]."""
    interval: Interval
    """Its 95 % interval [s]."""
    jitter: float
    """Standard deviation from step to step [s]."""
    jitter_interval: Interval
    """Its 95 % interval [s]."""
    steps: int
    """Steps that were used."""
    each: tuple[float, ...] = ()
    """Delay of each of them [s]."""


def command_delay(logs: list[GimbalLog]) -> CommandDelay | None:
    """Estimate the delay from all usable command steps of some logs; None if there are fewer than `FEWEST`."""
    delays = np.array([delay for log in logs for delay in step_delays(log)])
    if delays.size:
        middle = np.median(delays)
        scatter = 1.4826 * np.median(np.abs(delays - middle))
        # A step during which something else moved the axis.
        delays = delays[np.abs(delays - middle) <= 5 * scatter + 1e-3]
    if delays.size < FEWEST:
        return None
    count, mean, sd = delays.size, float(delays.mean()), float(delays.std(ddof=1))
    half = float(t.ppf(0.975, count - 1)) * sd / float(np.sqrt(count))
    interval = mean - half, mean + half
    return CommandDelay(mean, interval, sd, scatter_interval(delays), int(count), tuple(delays.tolist()))


def scatter_interval(delays: Array) -> Interval:
    """Return the 95 % interval of a standard deviation without assuming normality (Bonett 2006), of shape (n,)."""
    count = delays.size
    deviation = delays - delays.mean()
    variance = float(deviation @ deviation) / (count - 1)
    if variance == 0:
        return 0.0, 0.0
    trimmed = trim_mean(delays, 1 / (2 * np.sqrt(count - 4))) if count > 4 else delays.mean()
    kurtosis = count * float(np.sum((delays - trimmed) ** 4)) / float(deviation @ deviation) ** 2
    correction = count / (count - Z95)
    error = correction * np.sqrt(max(kurtosis - (count - 3) / count, 0.0) / (count - 1))
    low, high = (np.sqrt(correction * variance * np.exp(sign * Z95 * error)) for sign in (-1, 1))
    return float(low), float(high)


def step_delays(log: GimbalLog) -> list[float]:
    """Return the delay of each usable command step of a log [s]."""
    delays = (_onset(log, change, end) for change, end in _held_changes(log))
    return [delay for delay in delays if delay is not None]


def held_steps(log: GimbalLog) -> int:
    """Return how many command steps a log holds, the command still before and after each."""
    return len(_held_changes(log))


def _held_changes(log: GimbalLog) -> list[tuple[int, float]]:
    """Return the sample of each change of the command between two rests, and when the second rest ends [s]."""
    if log.command is None:
        return []
    changes = np.flatnonzero(np.diff(log.command) != 0) + 1
    edges = np.concatenate([[log.time[0]], log.time[changes], [log.time[-1]]])
    still = np.diff(edges) >= _REST
    return [(int(changes[index]), float(edges[index + 2])) for index in np.flatnonzero(still[:-1] & still[1:])]


def _onset(log: GimbalLog, change: int, end: float) -> float | None:
    """Return the time from a change of the command to the onset of the motion [s]; None if it can't be seen."""
    since = log.time - log.time[change]
    rest = (since > -0.1) & (since <= 0)
    later = (since > min(_REST, 0.5 * (end - log.time[change]))) & (log.time < end)
    if rest.sum() < _LEAST_SAMPLES or not later.any():
        return None
    start = float(log.yaw[rest].mean())
    travel = float(np.median(log.yaw[later])) - start
    noise = max(float(log.yaw[rest].std()), 1e-9)
    if abs(travel) < 20 * noise:
        return None
    risen = np.flatnonzero((since > 0) & ((log.yaw - start) / travel > _RISE))
    if not risen.size or since[risen[0]] > LONGEST + _REST:
        return None
    window = slice(int(np.flatnonzero(rest)[0]), int(risen[0]) + 1)
    if risen[0] - change < _LEAST_SAMPLES:
        return None
    return _best_onset(since[window], (log.yaw[window] - start) / travel)


def _best_onset(since: Array, travelled: Array) -> float:
    """Fit baseline, a τ² and b τ³ at each onset tried and return the onset with the least misfit."""
    rise = since[-1]
    step = rise / 200
    tried = np.arange(-0.1 * rise, 0.9 * rise, step)
    misfit = np.array([_onset_misfit(since, travelled, onset) for onset in tried])
    best = int(np.argmin(misfit))
    if 0 < best < tried.size - 1:
        left, middle, right = misfit[best - 1 : best + 2]
        bend = left - 2 * middle + right
        return float(tried[best] + (0.5 * step * (left - right) / bend if bend > 0 else 0.0))
    return float(tried[best])


def _onset_misfit(since: Array, travelled: Array, onset: float) -> float:
    moved = np.maximum(since - onset, 0.0) / since[-1]
    design = np.column_stack([np.ones_like(moved), moved**2, moved**3])
    solution, _, _, _ = np.linalg.lstsq(design, travelled, rcond=None)
    return float(np.sum((travelled - design @ solution) ** 2))

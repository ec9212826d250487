"""Findings about logs that no causal plant with one delay gives, however well one fits them."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from archerfish.identification.axis.checks import GOOD
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.result import LogFit
from archerfish.identification.frequency import frequency_response
from archerfish.identification.residuals import lead
from archerfish.identification.simulation import TINY, Array, free_run
from archerfish.logs.recording import Finding, Recording
from archerfish.records.plant import PlantRecord

_LEAD_SHARE = 0.5  # share of a residual that later inputs explain, from which an output comes early: of feedback 0.3
_NO_GAIN, _FREQUENCIES = 0.02, 50  # steady gain over the largest of the band, below which it is that of a rate
_LAG_SHARE = 0.15  # of a residual, that changes of its lag explain, from which other delays are tried
_BLOCKS = 12  # of a log, each with a lag of its own
_PARTS, _FEWEST = (3, 8), 100  # into which a log is cut, each fitted alone; least samples of one
_LEFT = 1 / 3  # share of the residual that other delays may leave
_OTHER_DELAY, _LONGEST_LAG = 2, 60  # least and largest change [samples]
_TIMES, _A_CHANGE, _MOST_CHANGES = (
    2000,
    0.03,
    20,
)  # at which a delay may change; share of a residual that a change costs
_NAMED = 4  # changes that are named one by one
_DEGREE = float(np.deg2rad(1))
_NEAR_ONE, _NEAR_HALF = 0.05, 0.01  # by which a steady gain may differ from those
_LARGEST_SINE = 1.02  # with noise
_FLATTEST, _STEEPEST = 0.05, 0.52  # gains of such components, less than half one about another heading
_POOR = 40.0  # fit below which a plant shows nothing of a transform [%]
_CURVED, _MUCH_CURVED, _STRAIGHT = 0.8, 0.3, 1.25
"""Power of a residual over another, below which a transform is right, below which it is right of a plant that fits
badly, and above which it is wrong."""


def early_outputs(fits: Sequence[LogFit]) -> list[Finding]:
    """Find outputs that respond before their input, as those of a filter that runs both ways.

    Args:
      fits: of logs of one input and one output; of others none is found.
    """
    found = list[Finding]()
    for log, residual in ((fit.recording, fit.residual) for fit in fits if fit.recording.inputs.shape[1] == 1):
        samples, share = lead(residual, log.inputs[:, 0])
        if share > _LEAD_SHARE:
            early = f'"{log.output_names[0]}" responds {1e3 * samples * log.period_s:.3g} ms or more before its input'
            message = f"{early}, as if it were smoothed forwards and backwards, or stamped too early"
            remedy = "log the angle as measured, with the stamps of its measurement; check which column is the command"
            found.append(Finding("early-output", "warning", log.source, message, remedy))
    return found


def rate_output(plant: PlantRecord, band: tuple[float, float], fit: LogFit) -> list[Finding]:
    """Find an output that is the rate of what the input commands: its steady gain is known, and nearly zero.

    Args:
      plant: with draws.
      band: that the inputs excite [Hz].
      fit: by which the plant is judged; a plant that does not explain its log shows nothing.
    """
    if plant.D.shape != (1, 1) or fit.fit_percent < GOOD or not 0 < band[0] < band[1]:
        return []
    largest = np.abs(frequency_response(plant, np.geomspace(*band, _FREQUENCIES))).max()
    steady = np.abs(frequency_response(plant, np.zeros(1), draws=True))
    if np.quantile(steady, 0.95) > _NO_GAIN * largest:
        return []
    log = fit.recording
    message = f'"{log.output_names[0]}" rests wherever "{log.input_names[0]}" does, as the rate of an angle would'
    return [Finding("rate-output", "warning", log.source, message, "log the angle, or integrate the rate")]


def half_angle(fit: LogFit, plant: PlantRecord, gain_is_given: bool) -> list[Finding]:
    """Find an output that is a component of a quaternion: the sine or cosine of half an angle that the input commands.

    Twice its arc sine then has a steady gain of one, in radians or degrees of the input, and follows the
    plant's output more closely. Of small angles both do so alike, and half of an angle may also come from a gear.

    Args:
      fit: by which the plant is judged.
      plant: of one input and one output; of others none is found.
      gain_is_given: so that half a gain is meant.
    """
    log, y = fit.recording, fit.recording.outputs[:, 0]
    if plant.D.shape != (1, 1) or fit.fit_percent < _POOR or np.abs(y).max() > _LARGEST_SINE:
        return []
    gain, name = plant.dc_gain.item(), log.output_names[0]
    if not any(_FLATTEST < abs(gain) / unit < _STEEPEST for unit in (1, _DEGREE)):
        return []
    # Many poles imitate the sine. An arc cosine is a constant less an arc sine.
    simple = free_run(fit_axis([log], 2).plant, log.inputs, log.outputs).outputs[:, 0]
    _, own_rest = _line(simple, y)
    slope, rest = _line(simple, 2 * np.arcsin(np.clip(y, -1, 1)))
    share = rest / max(own_rest * slope**2, TINY)
    curved = share < (_CURVED if fit.fit_percent >= GOOD else _MUCH_CURVED) and _near(gain * slope, 1, _NEAR_ONE)
    gear = share < _STRAIGHT and _near(gain, 0.5, _NEAR_HALF) and not gain_is_given
    if not (curved or gear):
        return []
    message = f'the steady gain of "{name}" is {gain:.3g}, and it stays within 1, as the component of a quaternion'
    message += " does, which is the sine or cosine of half an angle"
    remedy = "log the angle itself, 2 asin of that component, of w 2 acos, for a turn about its axis"
    if not curved:
        remedy += "; if a gear halves it, give the gain (archerfish identify axis --dc-gain)"
    return [Finding("half-angle", "warning", log.source, message, remedy)]


def _near(gain: float, expected: float, tolerance: float) -> bool:
    """Return whether a gain of either sign is as expected, of an input in radians or degrees."""
    return any(abs(abs(gain) / (unit * expected) - 1) < tolerance for unit in (1, _DEGREE))


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Return the slope of a line through points, and the power that it leaves."""
    slope, constant = np.polyfit(x, y, 1)
    return float(slope), float(np.sum((y - slope * x - constant) ** 2))


def changed_delay(fit: LogFit, nonlinear_share: float) -> list[Finding]:
    """Find a delay that changes within a log: the plant of one part explains the rest with other delays alone.

    Args:
      fit: of a log of one input and one output.
      nonlinear_share: what a nonlinearity leaves of the residual, which changed delays are to halve.
    """
    log, power = fit.recording, float(fit.residual @ fit.residual)
    if len(log) < _FEWEST * _PARTS[0] or _change_of_lag(fit.residual, np.gradient(fit.run.outputs[:, 0])) < _LAG_SHARE:
        return []
    best, least, of_one_delay = None, min(_LEFT, nonlinear_share / 2) * power, power
    ends = [np.linspace(0, len(log), count + 1).astype(int) for count in _PARTS if len(log) >= _FEWEST * count]
    for begin, end in (span for cuts in ends for span in itertools.pairwise(cuts.tolist())):
        part = slice(begin, end)
        piece = replace(log, inputs=log.inputs[part], outputs=log.outputs[part])
        if not (np.ptp(piece.inputs) and np.ptp(piece.outputs)):
            continue
        plant = fit_axis([piece], 2).plant
        delays, left, of_one = _delays(plant, log, _A_CHANGE * power)
        of_one_delay = min(of_one_delay, of_one)
        changes = np.flatnonzero(np.diff(delays))
        if left < least and 0 < len(changes) <= _MOST_CHANGES and np.ptp(delays) >= _OTHER_DELAY:
            dead_times = delays + plant.dead_time_samples - plant.delay_samples
            best, least = (dead_times, changes), left
    if best is None or least > _LEFT * of_one_delay:
        return []
    dead_times, changes = best
    parts = [f"{1e3 * log.period_s * dead_times[at]:.3g} ms until {log.time[at + 1]:.3g} s" for at in changes.tolist()]
    message = f"the delay is {', '.join(parts)}, and {1e3 * log.period_s * dead_times[-1]:.3g} ms from then on"
    if len(parts) > _NAMED:
        low, high = (1e3 * log.period_s * delay for delay in (dead_times.min(), dead_times.max()))
        message = f"the delay changes {len(parts)} times between {low:.3g} and {high:.3g} ms"
    remedy = "log at a steady load of the link, or cut the log there and identify one part"
    return [Finding("changed-delay", "warning", log.source, message, remedy)]


def _delays(plant: PlantRecord, log: Recording, cost: float) -> tuple[Array, float, float]:
    """Return the delay at each sample that explains a log best, and the power that these and the best single one leave.

    The sequence of delays with the least sum of errors and costs of its changes is found by dynamic programming.

    Args:
      plant: its delay is one of those tried.
      log: of one input and one output.
      cost: of each change.
    """
    starts = np.arange(0, len(log), -(-len(log) // _TIMES))
    tried = [plant.replace(delay_samples=delay) for delay in range(plant.delay_samples + _LONGEST_LAG)]
    residuals = ((log.outputs - free_run(each, log.inputs, log.outputs).outputs)[:, 0] for each in tried)
    errors = np.stack([np.add.reduceat(residual**2, starts) for residual in residuals], axis=1)
    total, previous = errors[0], list[Array]()
    for error in errors[1:]:
        best = int(np.argmin(total))
        changes = total[best] + cost < total
        previous.append(np.where(changes, best, np.arange(len(total))))
        total = np.where(changes, total[best] + cost, total) + error
    path = [int(np.argmin(total))]
    for came_from in reversed(previous):
        path.append(int(came_from[path[-1]]))
    delays = np.array(path[::-1])
    left = float(errors[np.arange(len(starts)), delays].sum())
    return np.repeat(delays, np.diff(np.append(starts, len(log)))), left, float(errors.sum(axis=0).min())


def _change_of_lag(residual: Array, rate: Array) -> float:
    """Return which share of a residual's power a lag of each block of a log explains, beyond one lag."""
    starts = np.linspace(0, len(rate), _BLOCKS, endpoint=False).astype(int)
    cross, power = (np.add.reduceat(product, starts) for product in (residual * rate, rate**2))
    of_blocks = np.sum(cross**2 / (power + TINY))
    together = cross.sum() ** 2 / (power.sum() + TINY)
    return float((of_blocks - together) / max(residual @ residual, TINY))

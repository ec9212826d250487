"""Findings about logs that no causal plant with one delay gives, however well one fits them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from archerfish.identification.axis.checks import GOOD
from archerfish.identification.axis.fit import fit_axis
from archerfish.identification.axis.result import LogFit
from archerfish.identification.frequency import frequency_response
from archerfish.identification.residuals import lead
from archerfish.identification.simulation import TINY, Array, free_run
from archerfish.logs.recording import Finding
from archerfish.records.plant import PlantRecord

_LEAD_SHARE = 0.5  # share of a residual that later inputs explain, from which an output comes early: of feedback 0.3
_NO_GAIN, _FREQUENCIES = 0.02, 50  # steady gain over the largest of the band, below which it is that of a rate
_LAG_SHARE, _MOVING = 0.3, 0.02  # share of a residual that a change of its lag explains; of all motion, on either side
_PART, _FEWEST, _LEFT = (
    0.4,
    100,
    1 / 3,
)  # of a log that is fitted alone; its samples; share of the residual that may be left
_OTHER_DELAY, _LONGEST_LAG = 2, 60  # least and largest change [samples]


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


def changed_delay(fit: LogFit, nonlinear_share: float) -> list[Finding]:
    """Find a delay that changes within a log: the plant of one part explains the rest with another delay alone.

    Args:
      fit: of a log of one input and one output.
      nonlinear_share: what a nonlinearity leaves of the residual, which a changed delay is to halve.
    """
    log, most = fit.recording, min(_LEFT, nonlinear_share / 2) * float(fit.residual @ fit.residual)
    count, found = int(_PART * len(log)), list[tuple[float, int, float, float]]()
    if count < _FEWEST or _change_of_lag(fit.residual, np.gradient(fit.run.outputs[:, 0])) < _LAG_SHARE:
        return []
    for backward in (False, True):
        part = slice(-count, None) if backward else slice(count)
        piece = replace(log, inputs=log.inputs[part], outputs=log.outputs[part])
        if not (np.ptp(piece.inputs) and np.ptp(piece.outputs)):
            continue
        plant = fit_axis([piece], 2).plant
        own = plant.delay_samples
        tried = [plant.replace(delay_samples=delay) for delay in range(own + _LONGEST_LAG)]
        errors = [(log.outputs - free_run(each, log.inputs, log.outputs).outputs)[:, 0] ** 2 for each in tried]
        sums = np.cumsum(np.array(errors)[:, :: -1 if backward else 1], axis=1)
        totals = sums[own] + sums[:, -1:] - sums
        delay, at = divmod(int(np.argmin(totals)), len(log))
        first = 1e3 * log.period_s * plant.dead_time_samples
        second = first + 1e3 * log.period_s * (delay - own)
        if abs(delay - own) < _OTHER_DELAY or totals[delay, at] > most:
            continue
        change = (len(log) - 1 - at, second, first) if backward else (at + 1, first, second)
        found.append((totals[delay, at], *change))
    if not found:
        return []
    _, at, before, after = min(found)
    time_s = log.start_s + at * log.period_s
    message = f"the delay is {before:.3g} ms until {time_s:.3g} s, and {after:.3g} ms from then on"
    remedy = "log at a steady load of the link, or cut the log there and identify one part"
    return [Finding("changed-delay", "warning", log.source, message, remedy)]


def _change_of_lag(residual: Array, rate: Array) -> float:
    """Return which share of a residual's power another lag from some sample on explains, beyond one lag."""
    cross, power = np.cumsum(residual * rate), np.cumsum(rate**2) + TINY
    moving = (power > _MOVING * power[-1]) & (power < (1 - _MOVING) * power[-1])
    before, both = cross[moving] ** 2 / power[moving], cross[-1] ** 2 / power[-1]
    after = (cross[-1] - cross[moving]) ** 2 / (power[-1] - power[moving])
    return float(np.max(before + after - both, initial=0.0) / max(residual @ residual, TINY))

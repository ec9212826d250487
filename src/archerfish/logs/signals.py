"""What the signals of a log show by themselves: wrapped angles and counters, repeated feedback, faults of a sensor."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from archerfish.logs.recording import GAP, Finding, Recording, Rows, Values, held_mean, log_fault

_ANGLES = (2 * np.pi, 360.0, 400.0)
_COUNTERS = (*_ANGLES, 1.0, 3600.0, 36_000.0, *(2.0**bits for bits in range(8, 33)))
"""What encoders wrap at: turns, parts of a degree, powers of 2."""
_STEPS = 20  # values or changes of a signal up to which it is a sequence of steps
_SATURATED, _QUANTISED, _FROZEN, _SPIKE = 0.05, 0.02, 0.1, 30.0
"""Shares of samples at an extreme, of noise in an output, and of samples at rest; step of a spike over the usual."""


def undo_wraps(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Undo, in place, the jumps of angles that were logged within a turn, and of outputs that are counters."""
    findings, turns = [], dict[str, float]()
    inputs, outputs, _ = rows.signals
    for name, column in [*zip(inputs, rows.inputs.T, strict=True), *zip(outputs, rows.outputs.T, strict=True)]:
        known = ~np.isnan(column)
        signal, time = column[known], rows.time[known]
        if signal.size < 2:
            continue
        steps = np.diff(signal)
        most, least = np.ptp(steps) / 0.75, np.ptp(signal) / 1.02
        for turn in _COUNTERS if name in outputs else _ANGLES:
            if least <= turn < most and _wraps_at(signal, time, turn):
                jumps = np.count_nonzero(np.abs(steps) > 0.75 * turn)
                column[known] = np.unwrap(signal, period=turn)
                message = f'"{name}" jumps by a whole turn of {turn:.6g} {jumps} times and was unwrapped'
                findings.append(Finding("angle-wrap", "repaired", rows.table.source, message, "log it over many turns"))
                turns[name] = turn
                break
    for name, command in zip(inputs, rows.inputs.T, strict=True):
        for turn in {turns[output] for output in outputs if output in turns and name not in turns}:
            if np.nanmax(np.abs(np.diff(command)), initial=0.0) > turn / 2 and np.ptp(command) <= 1.02 * turn:
                # A step of a command is no jump of a turn by itself, but its axis has followed it without one.
                followed = np.unwrap(command, period=turn)
                if np.std(followed - rows.outputs[:, 0]) < np.std(command - rows.outputs[:, 0]):
                    command[:] = followed
                    message = f'"{name}" jumps by a turn of {turn:.6g} where the output does not, and was unwrapped'
                    remedy = "log it over many turns"
                    findings.append(Finding("angle-wrap", "repaired", rows.table.source, message, remedy))
    return rows, findings


def _wraps_at(signal: Values, time: Values, turn: float) -> bool:
    """Return whether a signal moves smoothly but for jumps by a whole turn; it may be a counter of whole numbers.

    Its values may be repeated, and it may have any step across a gap.
    """
    moved = np.append(0, np.flatnonzero(np.diff(signal)) + 1)
    values, intervals = signal[moved], np.diff(time)
    usual = np.median(intervals[intervals > 0])  # rows may be there twice
    part = np.append(0, np.cumsum(intervals > GAP * usual))[moved]
    steps, within = np.abs(np.diff(values)), part[1:] == part[:-1]
    jump, smooth = within & (steps > 0.75 * turn), within & (steps <= 0.75 * turn)
    if steps.size <= _STEPS or not jump.any() or steps[smooth].max(initial=0.0) > turn / 4:
        return False
    from_zero = values.min() > -0.02 * turn or values.max() < 0.52 * turn  # or from minus half a turn
    counter = turn in _ANGLES or (from_zero and (turn == 1 or not np.any(values % 1)))
    bends = np.abs(np.diff(np.unwrap(values, period=turn), 2))
    near, far = jump[1:] & within[:-1] | jump[:-1] & within[1:], smooth[1:] & smooth[:-1]
    often = np.count_nonzero(smooth) >= 0.2 * np.count_nonzero(within)
    return bool(counter and often and bends[near].max(initial=0.0) <= 2 * bends[far].max(initial=0.0))


def non_repeated_samples(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Leave out rows that repeat the outputs of the one before, where a link refreshes them only in every k-th row.

    A held input is one that acts so, a held output would be fitted by a delay of up to k rows. Inputs are averaged from
    one sample that is kept to the next.
    """
    changes = np.flatnonzero((rows.outputs[1:] != rows.outputs[:-1]).any(axis=1)) + 1
    gaps = np.diff(changes)
    every = int(np.median(gaps)) if gaps.size > _STEPS else 0
    regular = every > 1 and (np.mean(gaps % every == 0) > 0.9 or np.quantile(gaps, 0.9) <= 2 * every)
    if not (regular and any(map(_is_smooth, rows.outputs.T))):
        return rows, []
    bounds = [changes[0] % every, *changes, len(rows)]
    runs = [np.arange(start, max(stop - every // 2, start + 1), every) for start, stop in pairwise(bounds)]
    kept = rows.select(np.unique(np.concatenate(runs)))
    edges = np.append(kept.time, rows.time[-1] + np.median(np.diff(rows.time)))
    rate_hz, lost = 1 / np.median(np.diff(kept.time)), len(rows) - len(kept)
    message = f"outputs change in one row of {every} only ({rate_hz:.4g} Hz), the others were left out"
    finding = Finding("held-output", "repaired", rows.table.source, message, "log each measurement once", lost)
    return replace(kept, inputs=held_mean(rows.time, rows.inputs, edges)), [finding]


def _is_smooth(signal: Values) -> bool:
    """Return whether changes are larger than the last digit, of which few repeat as well, and smaller than of steps."""
    changes = np.abs(np.diff(signal)[np.diff(signal) != 0])
    return bool(changes.size and np.median(changes) > 1.5 * changes.min() and np.mean(changes**2) < signal.var())


def checked(recordings: Sequence[Recording], source: str) -> tuple[list[Recording], list[Finding]]:
    """Leave out recordings in which all inputs or an output rest, and return warnings of what may spoil an estimate.

    Args:
      recordings: of one log.
      source: its file, for messages.

    Raises:
      InputError: if none is left.
    """
    kept, findings, remedy = [], list[Finding](), "record a log in which it changes, or name another column"
    for recording in recordings:
        inputs = dict(zip(recording.input_names, recording.inputs.T, strict=True))
        outputs = dict(zip(recording.output_names, recording.outputs.T, strict=True))
        signals, code = inputs | outputs, "constant-input"
        resting = [name for name, signal in signals.items() if not np.ptp(signal)]
        if not inputs.keys() <= set(resting):  # another input moves the axis
            resting, code = [name for name in resting if name in outputs], "constant-output"
        if resting:
            message = f'"{resting[0]}" is {signals[resting[0]][0]:g} throughout {len(recording)} samples'
            findings.append(Finding(code, "repaired", recording.source, f"{message}, left out", remedy, len(recording)))
            continue
        kept.append(recording)
        for name, signal in signals.items():
            for fault, check, advice in _CHECKS[: None if name in outputs else 1]:
                if found := check(signal, recording):
                    findings.append(Finding(fault, "warning", recording.source, f'"{name}" {found}', advice))
    if not kept:
        raise log_fault(source, message, remedy, code)
    return kept, findings


def _saturation(signal: Values, _: Recording) -> str:
    moves = signal[1:] != signal[:-1]
    motion = signal[moves.argmax() : signal.size - moves[::-1].argmax()]  # without the rest before and after it
    lowest, highest = motion == motion.min(), motion == motion.max()
    share = max(map(np.count_nonzero, (lowest, highest))) / motion.size
    between = np.diff(motion[~(lowest | highest)])
    stepwise = np.count_nonzero(between) < between.size / 2 or np.unique(motion).size <= _STEPS
    return "" if stepwise or share <= _SATURATED else f"is at its extreme in {share:.0%} of the samples"


def _quantisation(signal: Values, _: Recording) -> str:
    steps = np.diff(np.unique(signal))
    quantum = steps[steps > 1e-9 * np.ptp(signal)].min()
    noise = quantum / np.sqrt(12) / signal.std()
    message = f"moves in steps of {quantum:.4g}, which is a noise of {noise:.1%} of its standard deviation"
    return message if steps.size < signal.size / 4 and noise >= _QUANTISED else ""


def _spikes(signal: Values, recording: Recording) -> str:
    """Find single samples that leave and return: a lost bit, not a motion."""
    steps = np.diff(signal)
    limit = _SPIKE * np.quantile(np.abs(steps), 0.9)
    large = np.abs(steps) > limit
    first = np.flatnonzero(large[:-1] & large[1:])
    out, back = steps[first], steps[first + 1]
    found = first[np.abs(out + back) < 0.2 * np.abs(out - back)]
    if not limit or not found.size:
        return ""
    return f"leaves and returns within a sample {found.size} times, first at {recording.time[found[0] + 1]:.4g} s"


def _frozen(signal: Values, recording: Recording) -> str:
    ends = np.concatenate([[0], np.flatnonzero(signal[1:] != signal[:-1]) + 1, [signal.size]])
    longest = int(np.argmax(np.diff(ends)))
    start, stop = ends[longest], ends[longest + 1]
    # An output may rest while an input is held, and for its delay after the step that ends the rest.
    meanwhile = recording.inputs[(3 * start + stop) // 4 : (start + 3 * stop) // 4 + 1]
    moves = np.ptp(meanwhile, axis=0) > 0.1 * np.ptp(recording.inputs, axis=0)
    rests = ends.size > _STEPS and stop - start >= max(20, _FROZEN * signal.size) and moves.any()
    return f"rests from {recording.time[start]:.4g} s for {stop - start} samples while the input moves" if rests else ""


_CHECKS: tuple[tuple[str, Callable[[Values, Recording], str], str], ...] = (
    ("saturation", _saturation, "if it was cut off there, record with a smaller command"),
    ("quantisation", _quantisation, "log more digits, or record larger motions"),
    ("spike", _spikes, "remove those lines, the log is then cut there"),
    ("frozen", _frozen, "check the sensor's link; cut that part out"),
)
"""Codes, what finds the fault in an output, the first in inputs too, and what to do about it."""

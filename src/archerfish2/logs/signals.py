"""What the signals of a log show by themselves: wrapped angles and counters, repeated feedback, faults of a sensor."""

from collections.abc import Callable, Sequence

import numpy as np

from archerfish2.logs.recording import Finding, Recording, Values
from archerfish2.logs.stamps import Rows, Signals, held_mean
from archerfish2.logs.table import log_fault

_ANGLES = (2 * np.pi, 360.0)
_COUNTERS = (1.0, 400.0, 3600.0, 36_000.0, *(2.0**bits for bits in range(8, 33)))
"""What else encoders wrap at: turns, gradians, parts of a degree, powers of 2."""
_STEPS = 20  # values of a signal up to which it is a sequence of steps
_SATURATED, _QUANTISED, _FROZEN, _SPIKE = 0.05, 0.02, 0.1, 30.0
"""Shares of samples at an extreme, of noise in an output, and of samples at rest; step of a spike over the usual."""


def fresh_rows(rows: Rows, source: str) -> tuple[Rows, list[Finding]]:
    """Leave out rows that repeat the outputs of the one before, where a link refreshes them only in every k-th row.

    A held input is lawful, a held output would be fitted by a delay of up to k rows. Inputs are averaged from one
    fresh row to the next.

    Args:
      rows: samples of a log.
      source: the file, for messages.
    """
    count, steps = len(rows.time), np.abs(np.diff(rows.outputs, axis=0))
    changes, moves = (
        np.flatnonzero(np.diff(each, axis=0).any(axis=1)) + 1 for each in (rows.outputs, rows.inputs)
    )
    if changes.size <= _STEPS:
        return rows, []
    every, gaps = int(np.median(np.diff(changes))), np.diff(changes)
    # Slow outputs of few digits repeat as well, then change by their last digit; those that follow steps of an input
    # at once change as often as it does.
    varied = any(np.median(each[each > 0]) > 1.5 * each[each > 0].min() for each in steps.T if each.any())
    regular, own = np.mean(gaps % every == 0) > 0.9, changes.size > 2 * moves.size or moves.size > count / 2
    if every < 2 or np.mean(gaps == 1) > 0.02 or not varied or not (regular or own):
        return rows, []
    bounds = [changes[0] % every, *changes, count]
    spans = zip(bounds[:-1], bounds[1:], strict=True)
    fresh = np.unique(np.concatenate([np.arange(a, max(b - every // 2, a + 1), every) for a, b in spans]))
    edges = np.append(rows.time[fresh], rows.time[-1] + np.median(np.diff(rows.time)))
    message = f"outputs are fresh in one row of {every} only and repeated in the others, which were left out"
    finding = Finding("held-output", "repaired", source, message, "log each measurement once", count - fresh.size)
    return Rows(rows.time[fresh], held_mean(rows.time, rows.inputs, edges), rows.outputs[fresh]), [finding]


def unwrapped(rows: Rows, names: Signals, source: str) -> tuple[Rows, list[Finding]]:
    """Undo the jumps of angles that were logged within a turn, and of outputs that are counters.

    Args:
      rows: samples without gaps.
      names: of inputs and outputs.
      source: the file, for messages.
    """
    findings, signals = [], []
    for group, values, turns in zip(names, rows[1:], (_ANGLES, (*_ANGLES, *_COUNTERS)), strict=True):
        signals.append(values.copy())
        for name, signal in zip(group, signals[-1].T, strict=True):
            if turn := next((each for each in turns if _wraps_at(signal, each)), 0.0):
                jumps = np.count_nonzero(np.abs(np.diff(signal)) > 0.75 * turn)
                signal[:] = np.unwrap(signal, period=turn)
                message = f'"{name}" jumps by a whole turn of {turn:.6g} {jumps} times and was unwrapped'
                remedy = "log the angle over many turns"
                findings.append(Finding("angle-wrap", "repaired", source, message, remedy))
    return Rows(rows.time, *signals), findings


def _wraps_at(signal: Values, turn: float) -> bool:
    """Return whether a signal moves smoothly within a turn but for jumps by a whole one."""
    steps = np.abs(np.diff(signal))
    jump = steps > 0.75 * turn
    smooth, (low, high) = steps[~jump].max(initial=0.0), (signal.min() / turn, signal.max() / turn)
    if not jump.any() or smooth > 0.25 * turn or np.mean(~jump & (steps > 0)) < 0.2 or high - low > 1.02:
        return False
    counter = turn in _ANGLES or ((low > -0.02 or high < 0.52) and (turn == 1 or not np.any(signal % 1)))
    return bool(counter and np.all(np.abs(steps[jump] - turn) <= max(2 * smooth, 0.02 * turn)))


def examined(recordings: Sequence[Recording], source: str) -> tuple[tuple[Recording, ...], list[Finding]]:
    """Leave out recordings in which a signal does not move, and return warnings of what may spoil an estimate.

    Args:
      recordings: of one log.
      source: its file, for messages.

    Raises:
      InputError: if none is left.
    """
    kept, findings, remedy = [], [], "record a log in which it changes, or name another column"
    for each in recordings:
        signals = [("input", *pair) for pair in zip(each.input_names, each.inputs.T, strict=True)]
        signals += [("output", *pair) for pair in zip(each.output_names, each.outputs.T, strict=True)]
        if still := next((signal for signal in signals if not np.ptp(signal[2])), None):
            code, message = f"constant-{still[0]}", f'{still[0]} "{still[1]}" is {still[2][0]:g} throughout'
            if len(recordings) == 1:
                raise log_fault(source, message, remedy, code)
            message += f"; this part of {len(each)} samples was left out"
            findings.append(Finding(code, "repaired", each.source, message, remedy, len(each)))
            continue
        kept.append(each)
        for kind, name, signal in signals:
            for code, kinds, check, advice in _CHECKS:
                if kind in kinds and (found := check(signal, each)):
                    findings.append(Finding(code, "warning", each.source, f'"{name}" {found}', advice))
    if not kept:
        raise log_fault(source, findings[0].message, remedy, findings[0].code)
    return tuple(kept), findings


def _saturation(signal: Values, _: Recording) -> str:
    share = max(_share_at(signal, signal.max()), _share_at(signal, signal.min()))
    many = np.unique(signal).size > _STEPS
    return f"is at its extreme in {share:.0%} of the samples" if many and share > _SATURATED else ""


def _share_at(signal: Values, value: float) -> float:
    """Return the share of samples at a value, the rest before and after the motion left out; 0 for steps."""
    other = np.flatnonzero(signal != value)
    motion = signal[other[0] : other[-1] + 1]
    elsewhere = np.diff(motion[motion != value])
    return float(np.mean(motion == value)) if elsewhere.size and np.mean(elsewhere == 0) <= 0.5 else 0.0


def _quantisation(signal: Values, _: Recording) -> str:
    values = np.unique(signal)
    steps = np.diff(values)
    quantum = steps[steps > 1e-9 * np.ptp(signal)].min()
    noise = quantum / np.sqrt(12) / signal.std()
    if values.size > signal.size / 4 or noise < _QUANTISED:
        return ""
    return f"moves in steps of {quantum:.4g}, which is a noise of {noise:.1%} of its standard deviation"


def _spikes(signal: Values, recording: Recording) -> str:
    """Find single samples that leave and return: a lost bit, not a motion."""
    steps = np.diff(signal)
    out, back, typical = steps[:-1], steps[1:], np.quantile(np.abs(steps), 0.9)
    leaps = np.minimum(np.abs(out), np.abs(back)) > _SPIKE * typical
    leaps &= np.abs(out + back) < 0.2 * np.abs(out - back)
    if not typical or not leaps.any():
        return ""
    at = recording.time[int(np.argmax(leaps)) + 1]
    return f"leaves and returns within a sample {np.count_nonzero(leaps)} times, first at {at:.4g} s"


def _frozen(signal: Values, recording: Recording) -> str:
    ends = np.concatenate([[-1], np.flatnonzero(np.diff(signal)), [signal.size - 1]])
    longest = int(np.argmax(np.diff(ends)))
    start, stop = int(ends[longest]) + 1, int(ends[longest + 1]) + 1
    # An output may rest while an input is held, and for its delay after the step that ends the rest.
    margin = (stop - start) // 4
    meanwhile = np.ptp(recording.inputs[start + margin : stop - margin], axis=0)
    moves = np.any(meanwhile > 0.1 * np.ptp(recording.inputs, axis=0))
    if stop - start < max(20, _FROZEN * signal.size) or not moves or np.unique(signal).size <= _STEPS:
        return ""
    return f"rests from {recording.time[start]:.4g} s for {stop - start} samples while the input moves"


def _alternation(signal: Values, _: Recording) -> str:
    next_one, second = (np.median(np.abs(signal[k:] - signal[:-k])) for k in (1, 2))
    return "alternates between two values" if second < 0.1 * next_one and np.unique(signal).size > _STEPS else ""


_CHECKS: tuple[tuple[str, tuple[str, ...], Callable[[Values, Recording], str], str], ...] = (
    ("saturation", ("input", "output"), _saturation, "if it was cut off there, record with a smaller command"),
    ("quantisation", ("output",), _quantisation, "log more digits, or record larger motions"),
    ("spike", ("output",), _spikes, "remove those lines, the log is then cut there"),
    ("frozen", ("output",), _frozen, "check the sensor's link; cut that part out"),
    ("two-sources", ("output",), _alternation, "log each source under a name of its own"),
)
"""Codes, the signals that are checked, what finds the fault, and what to do about it."""

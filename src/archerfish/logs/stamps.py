"""Time stamps → equal intervals: a log is cut at gaps, and resampled where samples were not taken evenly.

An input is in force from its sample on, an output is measured at its sample. So a missing input is held, a row without
outputs is no sample, and over other intervals than those of the log inputs are averaged and outputs interpolated.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archerfish.errors import InputError
from archerfish.logs.recording import GAP, Finding, Recording, Rows, Values, by_lines, held_mean, log_fault

Mask = NDArray[np.bool_]
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of stamps."""
_TURNS: tuple[float, ...] = (86_400.0, 43_200.0, 3600.0, 604_800.0)  # a day, half of it, an hour, a week [s]
_TURNS += tuple(scale * 2.0**bits for scale in SECONDS.values() for bits in (16, 24, 32))
"""What stamps fall by at midnight, and where a counter rolls over [s]."""
_LOST = 0.01  # of that, within which a stamp follows where samples are lost
_APART = 100  # periods between recordings of one file
_WORD = r"(?:(?<![^\W\d_])|(?<=[a-z])(?=[A-Z]))"  # where a unit begins in a name: not within a word
_UNIT = re.compile(rf"{_WORD}(?i:([muµμn]|milli|micro|nano)s(ecs?|econds?)?)[\])}}\s]*$")
_LONG_UNIT = re.compile(rf"{_WORD}(?i:min(ute)?s?|h(ou)?rs?|h)[\])}}\s]*$")
_PLAUSIBLE_S, _USUAL_S = (1e-5, 0.5), (1e-4, 0.1)
"""Periods that a gimbal is logged at, and those that are usual [s]."""
_WINDOW = 20  # samples within which late stamps are on time again, and over which an interval is measured
_FEWEST = 25  # samples of a part that is kept: what its starting state and the least order of an axis need
_EVEN = 0.1  # of a period: departures from equal spacing that matter less than the rounding of common stamps
_DRIFT = 3.0  # periods by which such departures may add up
_SMOOTHER = 0.7  # share of the outputs' roughness over their stamps, below which samples were taken evenly
_COSTLY, _OSCILLATING = 0.02, 0.1
"""Differences of lines and curves through the samples, in standard deviations: one costs a fit up to 2 points."""
_EARLY = 0.3  # of a period that a stamp may come before its place; it may come late by the rest


def in_seconds(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Turn stamps into seconds from the unit that their name ends with, or that their intervals suggest.

    Raises:
      InputError: if the unit is minutes or hours.
    """
    time, source = rows.signals.time, rows.table.source
    if time is None:
        return rows, []
    if _LONG_UNIT.search(time):
        problem = f'stamps "{time}" are in minutes or hours, as the name says, expected s, ms, us or ns'
        raise log_fault(source, problem, 'turn them into seconds, and name the column "time_s"', "time-unit")
    unit = time_unit(time)
    message = f'stamps "{time}" are in {unit}, as the name says, and were turned into seconds'
    finding = Finding("time-unit", "repaired", source, message, "nothing to do")
    if unit == "s":
        steps = np.diff(rows.time)
        period = float(np.nanmedian(steps)) if np.any(steps > 0) else 0.0
        if period <= 0 or _PLAUSIBLE_S[0] <= period <= _PLAUSIBLE_S[1]:
            return rows, []
        usual = [unit for unit, scale in SECONDS.items() if _USUAL_S[0] <= scale * period < _USUAL_S[1]]
        unit = usual[0] if usual else "s"
        message = f'stamps "{time}" are {period:.4g} s apart, as no gimbal is logged, and were read as {unit}'
        remedy = f'if they are in {unit}, name the column "time_{unit}", else in their unit'
        remedy = "check the stamps" if unit == "s" else remedy
        finding = Finding("time-unit", "warning", source, message, remedy)
    return replace(rows, time=rows.time * SECONDS[unit]), [finding]


def time_unit(name: str) -> str:
    """Return the unit that the name of stamps ends with ("TimeUS", "time [ms]", "t_nsec"), s where with no other."""
    prefix = found[1].lower() if (found := _UNIT.search(name)) else ""
    return {"milli": "m", "micro": "u", "µ": "u", "μ": "u", "nano": "n"}.get(prefix, prefix) + "s"


def in_order(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Leave out rows without a stamp; let time go on where a counter rolls over, or another recording begins.

    Another one begins where the names are repeated, or where time falls to its first value for long.

    Raises:
      InputError: if time goes back elsewhere.
    """
    rows, findings = _without(rows, np.isnan(rows.time), "missing-values", "without a stamp", "log values in every row")
    steps, shift, starts, rolled = np.diff(rows.time), np.zeros(len(rows)), [0], list[float]()
    named = {*np.searchsorted(rows.numbers, rows.table.starts).tolist()} - {0, len(rows)}
    falls = {*(np.flatnonzero(steps < 0) + 1).tolist(), *(named if rows.signals.time is None else ())}
    period = float(np.median(steps[steps > 0])) if falls and (steps > 0).any() else 0.0
    often = 0.5 * float(np.sum(steps, where=steps > 0)) / max(len(falls), 1)  # a counter falls once in its range
    for index, after in pairwise([*sorted(falls), len(rows)]):
        again = rows.time[index] <= rows.time[starts[-1]] + GAP * period  # where the recording began
        again = again and min(index - starts[-1], after - index) >= _FEWEST
        # A run may be nearly as long as the range of a counter.
        turn = _counter_range(steps[index - 1], often, period, 0.0 if again else _LOST)
        if index in named or (again and not turn):
            starts.append(index)
            shift[index:] += _APART * period - steps[index - 1]
        elif turn:
            rolled.append(turn)
            shift[index:] += turn
        else:
            raise _order_fault(rows, index - 1, index, "time-backward", "cut the log there into two")
    if rolled:
        message = f"stamps fall {len(rolled)} times by {rolled[0]:.6g} s, the range of a counter, a day or an hour"
        findings.append(
            Finding("clock-wrap", "repaired", rows.table.source, f"{message}, and were continued", "nothing to do")
        )
    if starts[1:]:
        message = f"time starts again, at first here: {len(starts)} recordings in one file"
        remedy = "write each recording into a file of its own"
        findings.append(Finding("new-recording", "repaired", rows.place(starts[1]), message, remedy))
    return replace(rows, time=rows.time + shift, starts=tuple(rows.numbers[starts[1:]].tolist())), findings


def _counter_range(step: float, least: float, period: float, lost: float) -> float:
    """Return the range of the counter that rolls over by a step [s], 0 if there is none.

    Args:
      step: below 0 [s].
      least: range that a counter has at least [s].
      period: between rows [s].
      lost: share of the range that may have been lost there.
    """
    for turn in _TURNS:
        if turn >= least and 0 < step + turn <= max(lost * turn, GAP * period):
            return turn
    return 0.0


def hold_inputs(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Hold each input until its next value, and leave out samples before its first one."""
    lacking = np.isnan(rows.inputs)
    if not lacking.any():
        return rows, []
    last = np.maximum.accumulate(np.where(lacking, 0, np.arange(len(rows))[:, None]), axis=0)
    held = replace(rows, inputs=np.take_along_axis(rows.inputs, last, axis=0))
    measured = np.asarray(~np.isnan(rows.outputs).any(axis=1))
    early = np.asarray(np.isnan(held.inputs).any(axis=1))
    message, remedy = "before the first value of an input", "start the log before the axis"
    kept, findings = _without(held, early & measured, "late-input", message, remedy)
    filled = lacking.any(axis=1) & measured & ~early
    if filled.any() and not _inputs_apart(rows):
        message = f"rows without an input, whose last value was held: {np.count_nonzero(filled)}"
        place = rows.place(int(filled.argmax()))
        findings.append(Finding("held-input", "repaired", place, message, "log inputs in every row"))
    return kept, findings


def without_repeats(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Leave out samples that repeat the one before, stamp included.

    Raises:
      InputError: if other samples have equal stamps.
    """
    measured = np.flatnonzero(~np.isnan(rows.outputs).any(axis=1))  # rows of two topics of a bag may have equal stamps
    equal_stamps = np.diff(rows.time[measured]) <= 0
    values = np.column_stack([rows.inputs, rows.outputs])[measured]
    alike = (values[1:] == values[:-1]).all(axis=1)
    for index in np.flatnonzero(equal_stamps & ~alike)[:1]:
        remedy = "log finer stamps, or pass sample_period_s instead"
        raise _order_fault(rows, measured[index], measured[index + 1], "time-duplicate", remedy)
    repeated = np.zeros(len(rows), dtype=np.bool_)
    repeated[measured[1:]] = equal_stamps & alike
    message = "that repeat the one before, stamp included,"
    return _without(rows, repeated, "time-duplicate", message, "log each sample once")


def at_outputs(rows: Rows) -> tuple[Rows, list[Finding]]:
    """Leave out rows without an output; the sample before has the mean of its input and of theirs.

    Time is counted from the first sample.

    Raises:
      InputError: if fewer than two samples are left.
    """
    measured = np.asarray(~np.isnan(rows.outputs).any(axis=1))
    kept, findings = _without(rows, ~measured, "missing-values", "without an output", "log values in every row")
    if len(kept) < 2:
        problem, code = f"rows with all signals: {len(kept)}, expected 2 or more", "too-short"
        complete = len(kept) == len(rows.table.places)
        raise log_fault(rows.table.source, problem, "log all signals together", code if complete else "missing-values")
    if findings:
        known = np.flatnonzero(~np.isnan(rows.inputs).any(axis=1))
        means = held_mean(rows.time[known], rows.inputs[known], kept.time)
        values = np.diff(np.searchsorted(known, np.flatnonzero(measured)))  # of the inputs, from a sample to the next
        steps = np.diff(kept.time)
        between = np.append((values > 1) & (steps <= GAP * np.median(steps)), False)
        kept.inputs[between] = means[between[:-1]]
    return replace(kept, time=kept.time - kept.time[0]), [] if findings and _inputs_apart(rows) else findings


def _inputs_apart(rows: Rows) -> bool:
    """Return whether an input is on a clock of its own: no row of the log with an output has it."""
    columns, (inputs, outputs, _) = rows.table.columns, rows.signals
    measured = ~np.all([np.isnan(columns[name]) for name in outputs], axis=0)
    return any(np.isnan(columns[name][measured]).all() for name in inputs)


def _without(rows: Rows, lost: Mask, code: str, message: str, remedy: str) -> tuple[Rows, list[Finding]]:
    """Leave out the rows of a mask, shape (N,), with a finding that counts them."""
    count = int(lost.sum())
    if not count:
        return rows, []
    message = f"rows {message} left out: {count}"
    return rows.select(~lost), [Finding(code, "repaired", rows.place(int(lost.argmax())), message, remedy, count)]


def _order_fault(rows: Rows, before: int, after: int, code: str, remedy: str) -> InputError:
    problem = f"time {rows.time[after]:.12g} s does not come after {rows.time[before]:.12g} s"
    return log_fault(rows.place(after), problem, remedy, code)


def uninterrupted(rows: Rows) -> tuple[list[Rows], list[Finding]]:
    """Cut a log at its gaps.

    Raises:
      InputError: if no part is long enough.
    """
    source, findings, remedy = rows.table.source, list[Finding](), "log without interruptions"
    steps = np.diff(rows.time)
    gaps = _gaps(rows.time, steps)
    recording = np.searchsorted(rows.starts, rows.numbers, "right")
    within = gaps[recording[gaps] == recording[gaps - 1]]
    if within.size:
        at, longest = rows.time[within[0] - 1], steps[within - 1].max()
        message = f"gaps: {within.size}, the first at {at:.4g} s, of up to {longest:.4g} s; the log was cut there"
        findings.append(Finding("gap", "repaired", source, message, remedy))
    parts = [rows.select(slice(start, stop)) for start, stop in pairwise([0, *gaps.tolist(), len(rows)])]
    long = [part for part in parts if len(part) >= _FEWEST]
    if not long:
        problem = f"has at most {max(map(len, parts))} samples without a gap, expected {_FEWEST}"
        raise log_fault(source, problem, "record a longer log", "too-short")
    if lost := len(rows) - sum(map(len, long)):
        message = f"{lost} samples in parts of fewer than {_FEWEST} left out"
        findings.append(Finding("short-piece", "repaired", source, message, remedy, lost))
    return long, findings


def _gaps(time: Values, steps: Values) -> NDArray[np.int64]:
    """Return the first sample after each gap; after one that was only stamped late, the next ones follow at once."""
    period, gaps = float(np.median(steps)), list[int]()
    for last in np.flatnonzero(steps > GAP * period).tolist():
        nearby = time[last : last + _WINDOW + 2]
        late = nearby - period * np.arange(last, last + nearby.size)
        if late[1:].min() - late[: _WINDOW + 1].min() > (GAP - 1) * period:
            gaps.append(last + 1)
    return np.array(gaps, np.int64)


def at_equal_intervals(parts: Sequence[Rows], period_s: float | None) -> tuple[list[Recording], list[Finding]]:
    """Bring the parts of a log to one sampling period.

    Samples were taken evenly where the stamps lie within a tenth of a period of a line, or where the outputs are
    smoother over equal intervals than over their stamps, as those of a host are that stamps what it receives. Only
    samples that were lost are interpolated then.

    Args:
      parts: rows without gaps.
      period_s: sampling period of a log without stamps; otherwise None [s].

    Returns:
      The recordings, and a finding if they were resampled.
    """
    counted: list[Values] = [np.arange(len(part), dtype=np.float64) for part in parts]
    period, even = _line([part.time for part in parts], counted)
    if even:
        return _recordings(parts, [(part.inputs, part.outputs) for part in parts], period_s or period), []
    places, reason = _places(parts, counted)
    period, _ = _line([part.time for part in parts], places)
    edges = [np.arange(int(place[-1] + 1e-9) + 2, dtype=np.float64) for place in places]
    pieces = list(zip(parts, places, edges, strict=True))
    outputs, cost = _resampled_outputs(pieces)
    inputs = [held_mean(place, part.inputs, edge) for part, place, edge in pieces]
    steps = np.concatenate([np.diff(part.time) for part in parts])
    message = f"intervals are {steps.min():.4g} to {steps.max():.4g} s ({reason}), brought to {period:.4g} s; lines "
    message += f"and curves through the samples differ by {cost:.2%} of an output's standard deviation"
    remedy = "log at equal intervals"
    finding = Finding("jitter", "warning" if cost > _COSTLY else "repaired", parts[0].table.source, message, remedy)
    return _recordings(parts, zip(inputs, outputs, strict=True), period_s or period), [finding]


def _recordings(parts: Sequence[Rows], signals: Iterable[tuple[Values, Values]], period: float) -> list[Recording]:
    """Return recordings of inputs and outputs, which begin with the parts of the log."""
    recordings, source = [], Path(parts[0].table.source).name
    for part, (inputs, outputs) in zip(parts, signals, strict=True):
        start = float(part.time[0])
        name = f"{source}[{start:.3f} s…]" if len(parts) > 1 else source
        recordings.append(Recording(inputs, outputs, period, start, *part.signals[:2], name))
    return recordings


def _places(parts: Sequence[Rows], counted: Sequence[Values]) -> tuple[Sequence[Values], str]:
    """Return when the samples of each part were taken, in periods, shape (N,), and the reason."""
    times = [part.time for part in parts]
    longest = max(times, key=len)
    width = min(_WINDOW, longest.size // 4)
    interval = np.median(longest[width:] - longest[:-width]) / width  # few windows have a lost sample
    exact = [(time - time[0]) / interval for time in times]
    numbered = [_numbers(place) for place in exact]
    if _line(times, numbered)[1]:
        return numbered, "some samples are lost"
    if sum(map(_roughness, counted, parts)) < _SMOOTHER * sum(map(_roughness, times, parts)):
        return counted, "outputs are smooth at equal ones"
    return exact, "resampled"


def _resampled_outputs(pieces: Sequence[tuple[Rows, Values, Values]]) -> tuple[list[Values], float]:
    """Return the outputs of each part at whole periods, shape (K, p), and by how much lines and curves differ there.

    Args:
      pieces: rows, when they were taken in periods, shape (N,), and the edges of the intervals, shape (K + 1,).
    """
    from scipy.interpolate import CubicSpline

    curves = [CubicSpline(place, part.outputs)(edge[:-1]) for part, place, edge in pieces]
    lines = [by_lines(place, part.outputs, edge[:-1]) for part, place, edge in pieces]
    spread, change = np.concatenate(lines).std(axis=0), np.concatenate(curves) - np.concatenate(lines)
    cost = float((np.sqrt(np.mean(change**2, axis=0)) / np.where(spread > 0, spread, 1)).max())
    # A line moves the response by part of a period; a curve through noisy samples that are close together oscillates.
    return curves if cost <= _OSCILLATING else lines, cost


def _line(times: Sequence[Values], numbers: Sequence[Values]) -> tuple[float, bool]:
    """Return the period of numbered samples, and whether their stamps are even.

    It is the slope of lines through the stamps of each part, by least squares; stamps are even where all of a part lie
    within a tenth of a period of equal ones, or all intervals do, and their errors do not add up to a drift.
    """
    centred = [number - number.mean() for number in numbers]
    covariance = sum(float(np.sum(number * time)) for number, time in zip(centred, times, strict=True))
    period = float(f"{covariance / sum(float(np.sum(number**2)) for number in centred):.12g}")
    even = True
    for time, number in zip(times, numbers, strict=True):
        late = time - period * number
        spread, jitter = np.ptp(late) / 2 / period, np.abs(np.diff(late)).max() / period
        even = even and bool(spread <= _EVEN or (jitter <= _EVEN and spread <= _DRIFT))
    return period, even


def _numbers(place: Values) -> Values:
    """Return the numbers of samples, from 0 on, whose stamps are at these periods, shape (N,)."""
    number, count = np.floor(place + _EARLY), np.arange(place.size)
    # In order, and no two at one place: one that was stamped late shares the place of the next.
    return np.asarray(np.maximum.accumulate(number - count) + count)


def _roughness(time: Values, rows: Rows) -> float:
    """Return the sum of squares of what a line between its neighbours misses each output by."""
    left, right = np.diff(time[:-1]), np.diff(time[1:])
    share = (left / (left + right))[:, None]
    missed = rows.outputs[1:-1] - (1 - share) * rows.outputs[:-2] - share * rows.outputs[2:]
    return float(np.sum(missed**2 / (1 + share**2 + (1 - share) ** 2)))  # white noise gives each the same


def resampled(recording: Recording, period_s: float) -> Recording:
    """Return a recording at another sampling period [s]: inputs averaged, outputs interpolated by a cubic spline."""
    if abs(recording.period_s / period_s - 1) < 1e-6:
        return replace(recording, period_s=period_s)
    from scipy.interpolate import CubicSpline

    time = recording.period_s * np.arange(len(recording))
    edges = period_s * np.arange(int(time[-1] / period_s + 1e-9) + 2)
    inputs, outputs = held_mean(time, recording.inputs, edges), CubicSpline(time, recording.outputs)(edges[:-1])
    return replace(recording, inputs=inputs, outputs=outputs, period_s=period_s)


def period_findings(recording: Recording) -> tuple[Finding, ...]:
    """Return a warning if no gimbal is logged at the sampling period: it may be in milliseconds."""
    if _PLAUSIBLE_S[0] <= recording.period_s <= _PLAUSIBLE_S[1]:
        return ()
    message = f"has a sample every {recording.period_s:g} s, as no gimbal is logged"
    remedy = "give the period in seconds, 0.005 for 5 ms"
    return (Finding("time-unit", "warning", recording.source, message, remedy),)

"""Time stamps → equal intervals: a log is cut at gaps, and resampled where samples were not taken evenly.

An input is in force from its sample on, an output is measured at its sample. So a missing input is held, a row without
outputs is no sample, and over other intervals than those of the log inputs are averaged and outputs interpolated.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.logs.recording import Finding, LogTable, Recording, Values, log_fault

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNIT = re.compile(r"(?:(?<![^\W\d_])|(?<=[a-z])(?=[A-Z]))(?i:([muµμn]|milli|micro|nano)s(ecs?|econds?)?)[\])}\s]*$")
_PLAUSIBLE_S, _USUAL_S = (1e-5, 0.5), (1e-4, 0.1)
"""Periods that a gimbal is logged at, and those that are usual [s]."""
_GAP = 3.0
"""Interval in periods from which a log is cut: what happened within can't be known from its ends."""
_WINDOW = 20  # samples within which late stamps are on time again, and over which an interval is measured
_FEWEST = 25  # samples of a part that is kept: what its starting state and the least order of an axis need
_EVEN = 0.1  # of a period: departures from equal spacing that matter less than the rounding of common stamps
_SMOOTHER = 0.7  # share of the outputs' roughness over their stamps, below which samples were taken evenly
_COSTLY, _OSCILLATING = 0.02, 0.1
"""Differences of lines and curves through the samples, in standard deviations: one costs a fit up to 2 points."""
_EARLY = 0.3  # of a period that a stamp may come before its place; it may come late by the rest
Signals = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of inputs and of outputs."""


class Rows(NamedTuple):
    """Samples in order of time that have all signals."""

    time: Values  # since the first one of the log [s], (N,)
    inputs: Values  # (N, m)
    outputs: Values  # (N, p)


@np.errstate(invalid="ignore")  # a damaged file may have signalling NaN
def usable_rows(table: LogTable, signals: Signals, time: str | None, period_s: float) -> tuple[Rows, list[Finding]]:
    """Return the samples of a log, some rows of which may be without a stamp or some signals.

    Args:
      table: the log.
      signals: names of inputs and of outputs.
      time: name of the stamps, which may end with their unit; None where rows are `period_s` apart.
      period_s: sampling period of a log without stamps [s].

    Returns:
      Its samples, and findings on what was held, left out or turned into seconds.

    Raises:
      InputError: if time runs backward or stands still, or fewer than two rows have all signals.
    """
    u, y = (np.column_stack([table.columns[name] for name in names]) for names in signals)
    stamps, findings = (period_s * np.arange(len(u)), []) if time is None else _seconds(table, time)
    if len(u) > 1 and (stamps[1:] > stamps[:-1]).all() and not (np.isnan(u).any() or np.isnan(y).any()):
        return Rows(stamps - stamps[0], u, y), findings
    _check_order(table, stamps, ~np.isnan(stamps), "time-backward", "cut the log there into two")
    last = np.maximum.accumulate(np.where(np.isnan(u), 0, np.arange(len(u))[:, None]), axis=0)
    held = np.column_stack([stamps, np.take_along_axis(u, last, axis=0)])
    every = np.column_stack([held, y])
    whole, repeated = ~np.isnan(every).any(axis=1), np.zeros(len(u), dtype=np.bool_)
    rows = np.flatnonzero(whole)
    repeated[rows[1:]] = (every[rows[1:]] == every[rows[:-1]]).all(axis=1)
    kept = whole & ~repeated
    lacking, no_output = np.isnan(u), np.asarray(np.isnan(y).all(axis=1))
    # Inputs that no row with an output has are on a clock of their own, and what holds them alone is no sample.
    apart = no_output & ~lacking[:, (lacking | no_output[:, None]).all(axis=0)].all(axis=1)
    held_at, late = kept & lacking.any(axis=1), np.isnan(held).any(axis=1) & ~np.isnan(y).any(axis=1)
    for code, found, message, remedy in (
        ("missing-values", ~(whole | late | apart), "without a stamp or an output left out", "log values in every row"),
        ("late-input", late, "before the first value of an input left out", "start the log before the axis"),
        ("time-duplicate", repeated, "that repeat the one before, stamp included, left out", "log each sample once"),
        ("held-input", held_at, "without an input, whose last value was held", "log inputs in every row"),
    ):
        if count := int(found.sum()):
            place, samples = table.place(int(np.argmax(found))), 0 if found is held_at else count
            findings.append(Finding(code, "repaired", place, f"rows {message}: {count}", remedy, samples))
    rows = np.flatnonzero(kept)
    if rows.size < 2:
        problem, code = f"rows with all signals: {rows.size}, expected 2 or more", "too-short"
        raise log_fault(table.source, problem, "log all signals together", code if whole.all() else "missing-values")
    _check_order(table, stamps, kept, "time-duplicate", "log finer stamps, or pass sample_period_s instead")
    inputs, known, steps = held[rows, 1:], np.flatnonzero(~np.isnan(held).any(axis=1)), np.diff(stamps[rows])
    # Between some rows an input may have values of its own.
    between = (np.diff(np.searchsorted(known, rows)) > 1) & (steps <= _GAP * np.median(steps))
    inputs[:-1][between] = held_mean(stamps[known], held[known, 1:], stamps[rows])[between]
    return Rows(stamps[rows] - stamps[rows[0]], inputs, y[rows]), findings


def _seconds(table: LogTable, time: str) -> tuple[Values, list[Finding]]:
    """Return the stamps in seconds, shape (N,), and what their unit was or may be."""
    unit, stamps = time_unit(time), table.columns[time]
    if unit != "s":
        message = f'stamps "{time}" are in {unit}, as the name says, and were turned into seconds'
        return stamps * _SECONDS[unit], [Finding("time-unit", "repaired", table.source, message, "nothing to do")]
    steps = subsampled(stamps[1:]) - subsampled(stamps[:-1])
    period = float(np.nanmedian(steps)) if np.any(steps > 0) else 0.0
    if period <= 0 or _PLAUSIBLE_S[0] <= period <= _PLAUSIBLE_S[1]:
        return stamps, []
    unit = next((each for each, scale in _SECONDS.items() if _USUAL_S[0] <= scale * period < _USUAL_S[1]), "s")
    message = f'stamps "{time}" are {period:.4g} s apart, as no gimbal is logged, and were read as {unit}'
    remedy = f'if they are in {unit}, name the column "time_{unit}", else in their unit'
    return stamps * _SECONDS[unit], [Finding("time-unit", "warning", table.source, message, remedy)]


def time_unit(name: str) -> str:
    """Return the unit that the name of stamps ends with ("TimeUS", "time [ms]", "t_nsec"), s where with no other."""
    prefix = found[1].lower() if (found := _UNIT.search(name)) else ""
    return {"milli": "m", "micro": "u", "µ": "u", "μ": "u", "nano": "n"}.get(prefix, prefix) + "s"


def subsampled(values: Values) -> Values:
    """Return some of many values, equally spaced: enough for their median or last digit."""
    return values[:: len(values) // 100_000 + 1]


def _check_order(table: LogTable, stamps: Values, among: NDArray[np.bool_], code: str, remedy: str) -> None:
    """Refuse stamps of some rows that go back or, with another code, do not go on: those of two topics may be equal."""
    rows = np.flatnonzero(among)
    steps = np.diff(stamps[rows])
    for index in np.flatnonzero(steps < 0 if code == "time-backward" else steps <= 0)[:1]:
        problem = f"time {stamps[rows[index + 1]]:.12g} s does not come after {stamps[rows[index]]:.12g} s"
        raise log_fault(table.place(rows[index + 1]), problem, remedy, code)


def uninterrupted(rows: Rows, source: str) -> tuple[list[Rows], list[Finding]]:
    """Cut a log at its gaps.

    Args:
      rows: its samples.
      source: the file, for messages.

    Raises:
      InputError: if no part is long enough.
    """
    steps, findings, remedy = np.diff(rows.time), [], "log without interruptions"
    gaps = _gaps(rows.time, steps)
    if gaps.size:
        at, longest = rows.time[gaps[0] - 1], steps[gaps - 1].max()
        message = f"gaps: {gaps.size}, the first at {at:.4g} s, of up to {longest:.4g} s; the log was cut there"
        findings.append(Finding("gap", "repaired", source, message, remedy))
    parts = [Rows(*each) for each in zip(*(np.split(signal, gaps) for signal in rows), strict=True)]
    long = [each for each in parts if len(each.time) >= _FEWEST]
    if not long:
        problem = f"has at most {max(len(each.time) for each in parts)} samples without a gap, expected {_FEWEST}"
        raise log_fault(source, problem, "record a longer log", "too-short")
    if lost := len(rows.time) - sum(len(each.time) for each in long):
        message = f"{lost} samples in parts of fewer than {_FEWEST} left out"
        findings.append(Finding("short-piece", "repaired", source, message, remedy, lost))
    return long, findings


def _gaps(time: Values, steps: Values) -> NDArray[np.int64]:
    """Return the first sample after each gap; after one that was only stamped late, the next ones follow at once."""
    period = float(np.median(subsampled(steps)))
    longer = np.flatnonzero(steps > _GAP * period).tolist()
    nearby = [time[at : at + _WINDOW + 2] - period * np.arange(at, min(at + _WINDOW + 2, time.size)) for at in longer]
    delays = [late[1:].min() - late[: _WINDOW + 1].min() for late in nearby]
    return np.array([at + 1 for at, each in zip(longer, delays, strict=True) if each > (_GAP - 1) * period], np.int64)


def at_equal_intervals(parts: Sequence[Rows], source: str) -> tuple[list[Rows], float, list[Finding]]:
    """Bring the parts of a log to one sampling period; of their times the first alone counts then.

    Samples were taken evenly where the stamps lie within a tenth of a period of a line, or where the outputs are
    smoother over equal intervals than over their stamps, as those of a host are that stamps what it receives. Only
    samples that were lost are interpolated then.

    Args:
      parts: its samples, without gaps.
      source: the file, for messages.

    Returns:
      The parts, the period [s], and findings on what was resampled.
    """
    times = [each.time for each in parts]
    counted: list[Values] = [np.arange(each.size, dtype=np.float64) for each in times]
    period, even = _line(times, counted)
    if even:
        return list(parts), period, []
    from scipy.interpolate import CubicSpline

    longest = max(times, key=len)
    width = min(_WINDOW, longest.size // 4)
    interval = np.median(longest[width:] - longest[:-width]) / width  # few windows have a lost sample
    exact = [(each - each[0]) / interval for each in times]
    numbered, places, reason = [_numbers(each) for each in exact], exact, "resampled"
    if _line(times, numbered)[1]:
        places, reason = numbered, "some samples are lost"
    elif sum(map(_roughness, counted, parts)) < _SMOOTHER * sum(map(_roughness, times, parts)):
        places, reason = counted, "outputs are smooth at equal ones"
    (period, _), steps = _line(times, places), np.concatenate([np.diff(each) for each in times])
    edges = [np.arange(int(each[-1] + 1e-9) + 2, dtype=np.float64) for each in places]
    pieces = list(zip(places, parts, edges, strict=True))
    curves = [CubicSpline(place, part.outputs)(edge[:-1]) for place, part, edge in pieces]
    lines = [_lines(place, part.outputs, edge[:-1]) for place, part, edge in pieces]
    spread, change = np.concatenate(lines).std(axis=0), np.concatenate(curves) - np.concatenate(lines)
    cost = float((np.sqrt(np.mean(change**2, axis=0)) / np.where(spread > 0, spread, 1)).max())
    # A line moves the response by part of a period; a curve through noisy samples that are close together oscillates.
    outputs = curves if cost <= _OSCILLATING else lines
    message = f"intervals are {steps.min():.4g} to {steps.max():.4g} s ({reason}), brought to {period:.4g} s; lines "
    message += f"and curves through the samples differ by {cost:.2%} of an output's standard deviation"
    finding = Finding("jitter", "warning" if cost > _COSTLY else "repaired", source, message, "log at equal intervals")
    inputs = [held_mean(place, part.inputs, edge) for place, part, edge in pieces]
    return [Rows(*each) for each in zip(times, inputs, outputs, strict=True)], period, [finding]


def _line(times: Sequence[Values], numbers: Sequence[Values]) -> tuple[float, bool]:
    """Return the period of numbered samples, and whether their stamps are even.

    It is the slope of lines through the stamps of each part, by least squares; stamps are even where all of a part, or
    all intervals, lie within a tenth of a period of equal ones.
    """
    centred = [each - each.mean() for each in numbers]
    covariance = sum(float(np.sum(number * time)) for number, time in zip(centred, times, strict=True))
    period = covariance / sum(float(np.sum(number**2)) for number in centred)
    most, late = _EVEN * period, [time - period * number for time, number in zip(times, numbers, strict=True)]
    return period, all(np.ptp(each) / 2 <= most or np.abs(np.diff(each)).max() <= most for each in late)


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


def _lines(time: Values, signals: Values, grid: Values) -> Values:
    return np.column_stack([np.interp(grid, time, each) for each in signals.T])


def held_mean(time: Values, signals: Values, edges: Values) -> Values:
    """Average signals that hold each value until the next sample, and the last one further on.

    A plant that is slower than a sampling period responds to the mean of what was in force; the value at one instant
    would move each change by up to a period.

    Args:
      time: of the samples, shape (N,).
      signals: values from these times on, shape (N, m).
      edges: ends of K intervals, none before the first sample, shape (K + 1,).

    Returns:
      Means over the intervals, shape (K, m).
    """
    time = np.append(time, max(time[-1], edges[-1]))
    area = np.vstack([np.zeros(signals.shape[1]), np.cumsum(signals * np.diff(time)[:, None], axis=0)])
    return np.diff(_lines(time, area, edges), axis=0) / np.diff(edges)[:, None]


def resampled(recording: Recording, period_s: float) -> Recording:
    """Return a recording at another sampling period [s]: inputs averaged, outputs interpolated by a cubic spline."""
    if abs(recording.period_s / period_s - 1) < 1e-6:
        return replace(recording, period_s=period_s)
    from scipy.interpolate import CubicSpline

    time = recording.period_s * np.arange(len(recording))
    edges = period_s * np.arange(int(time[-1] / period_s + 1e-9) + 2)
    inputs, outputs = held_mean(time, recording.inputs, edges), CubicSpline(time, recording.outputs)(edges[:-1])
    return replace(recording, inputs=inputs, outputs=outputs, period_s=period_s)

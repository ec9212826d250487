"""The log doctor on time: stamps become seconds, gaps cut a log into experiments, jitter is resampled away."""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.records.findings import Finding, refusal
from archerfish.records.log_table import LogTable, stated_unit
from archerfish.records.recording import JITTER_LIMIT

Array = NDArray[np.float64]

GAP_PERIODS = 3.0
"""Interval, in sampling periods, from which on a log is cut: what happened inside can't be told from its ends."""
_CATCHING_UP = 20
"""Samples within which stamps that were late are on time again."""

RESAMPLING_LIMIT = 0.02
"""Largest resampling error, as a share of the signal's standard deviation, that costs a fit no more than 2 points."""

_PLAUSIBLE_PERIOD_S = (1e-5, 0.5)
"""Sampling periods that a gimbal's log may have; a log of minutes at 1 Hz shows nothing of its dynamics."""

_SMOOTHER, _SMOOTHER_AT_ALL = 0.7, 0.9
"""Roughness of the output over equal intervals as a share of that over the stamps, below which the stamps are wrong."""
_EARLY = 0.3
"""Share of an interval that a stamp may come before its place; it may come late by the rest."""
_LOST = 1.5
"""Times the sampling period, above which a sample has been lost in between."""
_WINDOW = 20
"""Samples over which an interval is taken, so that what is late at its ends matters little."""

_SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class UnevenStampsError(InputError):
    """Samples so uneven that nothing between them can be trusted, by their stamps."""

    def __init__(self, message: str, sample_period_s: float) -> None:
        super().__init__(message, "jitter")
        self.sample_period_s = sample_period_s
        """Mean of the intervals: the sampling period, if samples were taken evenly and only stamped unevenly [s]."""


class Rows(NamedTuple):
    """Samples of a log whose values are all there, in order of time."""

    time: Array
    """Time since the first sample [s], shape (N,)."""
    signals: Array
    """Signals, shape (N, inputs + outputs)."""
    inputs: int
    """How many of the signals are inputs; they come first."""
    places: NDArray[np.int64]
    """Place of each sample in the source, shape (N,)."""
    cuts: NDArray[np.int64]
    """Samples that start a new experiment, the first one excluded; shape (cuts,)."""


class Piece(NamedTuple):
    """One experiment: an uninterrupted stretch at equal intervals."""

    time: Array
    """Time of each sample [s], shape (N,)."""
    signals: Array
    """Signals, shape (N, inputs + outputs)."""


def usable_rows(
    table: LogTable,
    inputs: Sequence[str],
    outputs: Sequence[str],
    sample_period_s: float | None,
    findings: list[Finding],
) -> Rows:
    """Return the samples that hold all signals, with time in seconds.

    Args:
      table: the log.
      inputs: names of its inputs.
      outputs: names of its outputs.
      sample_period_s: sampling period [s] of a log without stamps.
      findings: takes what was repaired.

    Raises:
      InputError: if time runs backward or stands still, or nothing is left.
    """
    signals = np.column_stack([table.columns[name] for name in (*inputs, *outputs)])
    counted = np.arange(len(signals), dtype=np.float64) * (sample_period_s or 1.0)
    stamps: Array = np.asarray(counted) if table.stamps is None else table.stamps
    missing = np.isnan(signals).any(axis=1) | np.isnan(stamps)
    if missing.any():
        findings.append(_missing_values(table, missing))
    kept = np.flatnonzero(~missing)
    stamps = stamps if table.stamps is None else _in_seconds(table, stamps, findings)
    repeated = np.flatnonzero((np.diff(stamps[kept]) == 0) & (np.diff(signals[kept], axis=0) == 0).all(axis=1)) + 1
    if repeated.size:
        message = f"{_many(repeated.size, 'sample')} repeated with the stamp of the one before, and left out"
        place = table.place(kept[repeated[0]])
        findings.append(
            Finding("time-duplicate", "repaired", place, message, "log each sample once", int(repeated.size))
        )
        kept = np.delete(kept, repeated)
    _check_order(table, stamps, kept)
    cuts = np.flatnonzero(np.cumsum(missing)[kept][1:] != np.cumsum(missing)[kept][:-1]) + 1
    return Rows(stamps[kept] - stamps[kept[0]], signals[kept], len(inputs), table.places[kept], cuts)


def _missing_values(table: LogTable, missing: NDArray[np.bool_]) -> Finding:
    first = int(np.argmax(missing))
    if missing.all():
        raise refusal(
            Finding("missing-values", "refused", table.place(first), "no row holds all signals", "log them together")
        )
    count = int(missing.sum())
    message = f"{_many(count, 'row')} without all values left out; the log was cut there into experiments"
    return Finding("missing-values", "repaired", table.place(first), message, "log a value in every row", count)


def _in_seconds(table: LogTable, stamps: Array, findings: list[Finding]) -> Array:
    unit = stated_unit(table.stamp_name)
    if unit not in _SECONDS:
        return stamps
    message = f'the stamps in "{table.stamp_name}" are in {unit}, as its name says, and were turned into seconds'
    findings.append(Finding("time-unit", "repaired", table.source, message, "nothing to do"))
    return stamps * _SECONDS[unit]


def _check_order(table: LogTable, stamps: Array, kept: NDArray[np.int64]) -> None:
    if kept.size < 2:
        raise refusal(Finding("too-short", "refused", table.source, "holds one usable sample", "pass a longer log"))
    steps = np.diff(stamps[kept])
    for index in np.flatnonzero(steps <= 0)[:1]:
        before, here = stamps[kept[index]], stamps[kept[index + 1]]
        message = f"time {here:.9g} s does not come after {before:.9g} s"
        place = table.place(kept[index + 1])
        if steps[index] < 0:
            remedy = "cut the log there into two, or sort its lines"
            raise refusal(Finding("time-backward", "refused", place, message, remedy))
        remedy = "log stamps of finer resolution, or pass --sample-period-s instead of the time column"
        raise refusal(Finding("time-duplicate", "refused", place, message, remedy))


def equal_intervals(table: LogTable, rows: Rows, shortest: int, findings: list[Finding]) -> list[Piece]:
    """Cut a log at its gaps and bring each piece to equal intervals.

    Args:
      table: the log, for its name and places.
      rows: its samples.
      shortest: pieces of fewer samples are left out.
      findings: takes what was repaired.

    Raises:
      InputError: if no piece is long enough, or resampling would change the signals by more than `RESAMPLING_LIMIT`.
    """
    steps = np.diff(rows.time)
    whole = np.delete(steps, rows.cuts - 1)
    period = float(np.median(whole if whole.size else steps))
    _check_period(table, period, findings)
    gaps = np.setdiff1d(_gaps(rows.time, period), rows.cuts)
    if gaps.size:
        longest = int(gaps[np.argmax(steps[gaps - 1])])
        place = f"{table.source}: {table.place_kind} {rows.places[longest]}"
        lacking = round(float(steps[gaps - 1].sum()) / period) - gaps.size
        message = (
            f"{_many(gaps.size, 'gap')} of up to {steps[longest - 1]:.4g} s, where the sampling period is "
            f"{period:.4g} s: about {_many(lacking, 'sample')} not logged; the log was cut there into experiments"
        )
        findings.append(Finding("gap", "repaired", place, message, "log without interruptions"))
    stretches = list(_stretches(len(rows.time), np.union1d(gaps, rows.cuts)))
    long = [each for each in stretches if each.stop - each.start >= shortest]
    _check_pieces(table, stretches, long, shortest, findings)
    return _pieces(table, rows, long, period, findings)


def _gaps(time: Array, period: float) -> NDArray[np.int64]:
    """Return the first sample after each gap; a sample that was only stamped late is followed by others at once."""
    lateness = np.pad(time - period * np.arange(time.size), (0, _CATCHING_UP), constant_values=np.inf)
    # The least that any of the next samples is late by.
    envelope = sliding_window_view(lateness, _CATCHING_UP + 1).min(axis=1)
    longer = np.diff(time) > GAP_PERIODS * period
    return np.flatnonzero(longer & (np.diff(envelope) > (GAP_PERIODS - 1) * period)) + 1


def _stretches(count: int, cuts: NDArray[np.int64]) -> Iterator[slice]:
    ends = [0, *cuts.tolist(), count]
    yield from (slice(start, stop) for start, stop in itertools.pairwise(ends))


def _check_period(table: LogTable, period: float, findings: list[Finding]) -> None:
    shortest, longest = _PLAUSIBLE_PERIOD_S
    if table.stamps is None or shortest <= period <= longest:
        return
    message = f'the stamps in "{table.stamp_name}" are {period:.4g} s apart, which no gimbal is logged at'
    remedy = 'if they are milliseconds, call the column "…_ms" (or "…_us"); --sample-period-s overrules it'
    findings.append(Finding("time-unit", "warning", table.source, message, remedy))


def _check_pieces(
    table: LogTable, stretches: list[slice], long: list[slice], shortest: int, findings: list[Finding]
) -> None:
    lost = sum(each.stop - each.start for each in stretches if each not in long)
    if not long:
        longest = max(each.stop - each.start for each in stretches)
        told = "holds" if len(stretches) == 1 else "between gaps and missing values holds at most"
        message = f"{told} {_many(longest, 'sample')}, where a usable stretch has {shortest}"
        raise refusal(Finding("too-short", "refused", table.source, message, "record longer or lower the order"))
    if lost:
        message = f"{_many(lost, 'sample')} in pieces shorter than {shortest} were left out"
        findings.append(Finding("short-piece", "repaired", table.source, message, "log without interruptions", lost))


def _pieces(table: LogTable, rows: Rows, stretches: list[slice], period: float, findings: list[Finding]) -> list[Piece]:
    times = [rows.time[each] for each in stretches]
    if all(_is_regular(time, period) for time in times):
        return [Piece(_evenly(time), rows.signals[each]) for time, each in zip(times, stretches, strict=True)]
    if all(_is_rounded(time) for time in times):
        message = "the intervals differ only by the rounding of the stamps; the samples were taken as equally spaced"
        findings.append(Finding("time-rounded", "repaired", table.source, message, "log finer stamps"))
        return [Piece(_evenly(time), rows.signals[each]) for time, each in zip(times, stretches, strict=True)]
    if (counted := _counted(rows, stretches, period, _SMOOTHER)) is not None:
        return _taken_evenly(table, rows, stretches, counted, findings)
    return _resampled(table, rows, stretches, period, findings)


def _counted(rows: Rows, stretches: list[slice], period: float, smoother: float) -> list[NDArray[np.int64]] | None:
    """Return the number of each sample, if they were taken at equal intervals and only stamped unevenly.

    An output that moves smoothly shows which it is: it is smooth over the times at which it was taken.

    Args:
      rows: of the log.
      stretches: of them, without gaps.
      period: sampling period [s].
      smoother: roughness over the numbers, as a share of that over the stamps, below which it is so.
    """
    stamps = [rows.time[each] for each in stretches]
    outputs = [rows.signals[each, rows.inputs :] for each in stretches]
    by_stamp = sum(_roughness(*pair) for pair in zip(stamps, outputs, strict=True))
    for numbers in ([np.arange(time.size) for time in stamps], [_places(time, period) for time in stamps]):
        by_number = sum(_roughness(each.astype(float), y) for each, y in zip(numbers, outputs, strict=True))
        if by_number < smoother * by_stamp:
            return numbers
    return None


def _places(time: Array, period: float) -> NDArray[np.int64]:
    """Return which sample each stamp is of, where some are lost and others late, from 0 on."""
    width = min(_WINDOW, time.size - 1)
    # Few windows hold a lost sample.
    interval = float(np.median(time[width:] - time[:-width])) / width if width else period
    place = np.floor((time - time[0]) / interval + _EARLY).astype(np.int64)
    # In order, no two at one place: one that was stamped late shares the place of the next.
    count = np.arange(time.size)
    return np.asarray(np.maximum.accumulate(place - count) + count)


def _usual_interval(time: Array, period: float) -> float:
    """Return the mean interval, those left out where samples were lost."""
    steps = np.diff(time)
    return float(steps[steps < _LOST * period].mean()) if np.any(steps < _LOST * period) else period


def _roughness(time: Array, outputs: Array) -> float:
    """Return the mean square of what a line between its neighbours misses each sample by, outputs of shape (N, p)."""
    left, right = np.diff(time[:-1]), np.diff(time[1:])
    share = (left / (left + right))[:, None]
    missed = outputs[1:-1] - (1 - share) * outputs[:-2] - share * outputs[2:]
    # White noise alone gives these squares their weights.
    weights = 1 + share**2 + (1 - share) ** 2
    return float(np.sum(missed**2 / weights))


def _taken_evenly(
    table: LogTable, rows: Rows, stretches: list[slice], counted: list[NDArray[np.int64]], findings: list[Finding]
) -> list[Piece]:
    """Take samples as equally spaced, and cut where some are missing."""
    from scipy.interpolate import CubicSpline

    span = sum(float(rows.time[each][-1] - rows.time[each][0]) for each in stretches)
    period = span / sum(int(each[-1] - each[0]) for each in counted)
    pieces, lost = [], 0
    for each, numbers in zip(stretches, counted, strict=True):
        signals, steps = rows.signals[each], np.diff(numbers)
        lost += int(np.sum(steps - 1))
        whole = np.arange(numbers[0], numbers[-1] + 1)
        # A command is held until the next one that was logged; the output is smooth across a lost sample.
        held = signals[np.searchsorted(numbers, whole, side="right") - 1, : rows.inputs]
        smooth = CubicSpline(numbers, signals[:, rows.inputs :])(whole)
        pieces.append(Piece(rows.time[each][0] + period * (whole - numbers[0]), np.column_stack([held, smooth])))
    message = f"the samples were taken every {period:.4g} s and stamped unevenly, as the smooth output shows; "
    message += "they were taken as equally spaced" + (f", {_many(lost, 'lost sample')} interpolated" if lost else "")
    findings.append(
        Finding("time-stamped-late", "repaired", table.source, message, "stamp samples where they are taken")
    )
    return pieces


def _is_regular(time: Array, period: float) -> bool:
    return bool(np.abs(np.diff(time) - period).max() <= JITTER_LIMIT * period)


def _is_rounded(time: Array) -> bool:
    """Tell whether the stamps lie within half a unit of their last digit from equal spacing."""
    distinct = np.unique(np.round(np.diff(time), 9))
    if distinct.size != 2:  # rounding makes two neighbouring intervals, no more
        return False
    count = np.arange(time.size)
    line = np.polynomial.polynomial.polyval(count, np.polynomial.polynomial.polyfit(count, time, 1))
    return bool(np.abs(time - line).max() <= 0.6 * (distinct[1] - distinct[0]))


def _evenly(time: Array) -> Array:
    return np.asarray(np.linspace(time[0], time[-1], time.size))


def _resampled(
    table: LogTable, rows: Rows, stretches: list[slice], period: float, findings: list[Finding]
) -> list[Piece]:
    from scipy.interpolate import CubicSpline  # takes long to import, and few logs need it

    inputs, pieces, error = rows.inputs, [], 0.0
    # Halves of one log may have other medians, but hardly another mean.
    period = float(np.mean([_usual_interval(rows.time[each], period) for each in stretches]))
    spread = np.maximum(rows.signals[:, inputs:].std(axis=0), np.finfo(np.float64).tiny)
    for each in stretches:
        time, signals = rows.time[each], rows.signals[each]
        grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + 1e-9))
        smooth = CubicSpline(time, signals[:, inputs:])(grid)
        straight = np.column_stack([np.interp(grid, time, signal) for signal in signals[:, inputs:].T])
        error = max(error, float((np.sqrt(np.mean((smooth - straight) ** 2, axis=0)) / spread).max()))
        pieces.append(Piece(grid, np.column_stack([held_mean(time, signals[:, :inputs], grid, period), smooth])))
    steps = np.concatenate([np.diff(rows.time[each]) for each in stretches])
    size = f"the intervals vary from {steps.min():.4g} to {steps.max():.4g} s (mean {period:.4g} s)"
    if error > RESAMPLING_LIMIT:
        # A curve through noisy samples at nearly the same time runs wild, and noise hides what is smooth.
        if (counted := _counted(rows, stretches, period, _SMOOTHER_AT_ALL)) is not None:
            return _taken_evenly(table, rows, stretches, counted, findings)
        message = f"{size}, and resampling would change the output by {error:.1%} of its standard deviation"
        raise UnevenStampsError(f"{table.source}: {message}; log at equal intervals", period)
    message = f"{size}; resampled to the mean, at a cost of {error:.2%} of the output's standard deviation"
    findings.append(Finding("jitter", "repaired", table.source, message, "log at equal intervals"))
    return pieces


def held_mean(time: Array, signals: Array, grid: Array, period: float) -> Array:
    """Average signals that hold their value from one sample to the next over equal intervals.

    A command is held by the robot until the next one comes; a plant that is slower than a period answers to the mean
    of what was held. Taking the value at one instant instead would move each change by up to a period.

    Args:
      time: time of each sample [s], shape (N,).
      signals: values from that time on, shape (N, m).
      grid: starts of the intervals [s], shape (K,).
      period: their length [s].

    Returns:
      Means, shape (K, m).
    """
    area = np.vstack([np.zeros(signals.shape[1]), np.cumsum(signals[:-1] * np.diff(time)[:, None], axis=0)])
    edges = np.append(grid, grid[-1] + period)
    return np.column_stack([np.diff(np.interp(edges, time, each)) / period for each in area.T])


def _many(count: int, thing: str) -> str:
    return f"{count} {thing}" + ("s" if count != 1 else "")

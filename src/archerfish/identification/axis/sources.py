"""Logs of one axis, from files or arrays: read, numbered, and brought to one sampling period."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from archerfish.errors import InputError
from archerfish.logs.log import read_log
from archerfish.logs.recording import Finding, Log, Recording
from archerfish.logs.stamps import period_findings, resampled

Source = str | Path | Log | Recording | Mapping[str, Any]
"""A file or arrays with the columns time_s, u and y, or what was read or made of other ones."""
_MOST = 40  # recordings that are fitted
_COARSER = 3.0  # sampling period over that of a log, from which much of the log is lost


class AxisLogs(NamedTuple):
    """Recordings of one sampling period."""

    fitted: list[Recording]  # to which a plant is fitted
    held_back: list[Recording]  # by which it is judged
    findings: tuple[Finding, ...]  # of all logs
    hashes: dict[str, str | int | float | None]  # SHA-256 by file


def read_sources(
    logs: Source | Sequence[Source], validate: Source | Sequence[Source] = (), divides_s: float | None = None
) -> AxisLogs:
    """Read logs and bring them to one sampling period: the longest, or the next longer one that divides a time.

    Args:
      logs: to be fitted.
      validate: to be held back.
      divides_s: the time [s].

    Raises:
      InputError: if one can't be read, none is given, or their signals have other names.
    """
    to_fit = [_log(source) for source in _sources(logs)]
    to_hold_back = [_log(source) for source in _sources(validate)]
    read = [*to_fit, *to_hold_back]
    fitted, held_back = _numbered(
        [recording for log in to_fit for recording in log.recordings],
        [recording for log in to_hold_back for recording in log.recordings],
    )
    if not fitted:
        raise InputError("identify: expected a log or more, got none; pass a file")
    for log in (*fitted, *held_back):
        if (log.input_names, log.output_names) != (fitted[0].input_names, fitted[0].output_names):
            names = f"{', '.join(fitted[0].input_names)} and {', '.join(fitted[0].output_names)}"
            raise InputError(f"{log.source}: expected the signals {names} of {fitted[0].source}; read the same ones")
    findings = [finding for log in read for finding in log.findings]
    kept, repeated = _without_repeats(fitted)
    longest, left_out = _longest(kept)
    others, not_held_back = _not_fitted(held_back, kept)
    findings += [*repeated, *left_out, *not_held_back]
    used = [*longest, *others]
    slowest = max(used, key=lambda log: log.period_s)
    period_s = _period(fitted[0], slowest.period_s, divides_s)
    message = f"brought to a sampling period of {1e3 * period_s:.4g} ms, since {slowest.source} has no shorter one"
    for log in used:
        if abs(log.period_s / period_s - 1) > 1e-6:
            severity: Any = "warning" if log.period_s < period_s / _COARSER else "repaired"
            findings.append(Finding("other-period", severity, log.source, message, "log all at one rate"))
    hashes: dict[str, str | int | float | None] = {log.source: log.sha256 for log in read if log.sha256}
    return AxisLogs(
        [resampled(log, period_s) for log in longest],
        [resampled(log, period_s) for log in others],
        tuple(findings),
        hashes,
    )


def _sources(group: Any) -> list[Source]:
    """Return the logs of a group, which may be one; arrays and data frames are one."""
    one = isinstance(group, str | Path | Log | Recording | Mapping) or hasattr(group, "columns")
    if not (one or isinstance(group, Iterable)):
        expected = "expected files, recordings, mappings of names to arrays, or data frames"
        raise InputError(f"identify_axis: {expected}, got one of type {type(group).__name__}; give one or several")
    return [group] if one or hasattr(group, "shape") else list(group)


def _log(source: Source) -> Log:
    if isinstance(source, Recording):
        return Log((source,), period_findings(source), len(source), source.source, "")
    return source if isinstance(source, Log) else read_log(source)


def _numbered(*groups: list[Recording]) -> list[list[Recording]]:
    """Return recordings, numbered where different ones have one name, so that messages tell them apart."""
    numbers = defaultdict[str, dict[bytes, int]](dict)
    for log in itertools.chain(*groups):
        of_name = numbers[log.source]
        of_name.setdefault(_content(log), 1 + len(of_name))

    def named(log: Recording) -> Recording:
        of_name = numbers[log.source]
        return replace(log, source=f"{log.source} ({of_name[_content(log)]})") if len(of_name) > 1 else log

    return [[named(log) for log in group] for group in groups]


def _without_repeats(fitted: Sequence[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Leave out recordings that are the same as an earlier one."""
    first, findings = dict[bytes, Recording](), list[Finding]()
    for log in fitted:
        earlier = first.setdefault(_content(log), log)
        if earlier is not log:
            message = f"the same as {earlier.source}, and left out"
            findings.append(Finding("repeated-log", "repaired", log.source, message, "name each log once", len(log)))
    return list(first.values()), findings


def _longest(fitted: list[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Keep the longest of very many recordings: each costs time, and has a beginning of its own to be estimated."""
    if len(fitted) <= _MOST:
        return fitted, []
    order = sorted(range(len(fitted)), key=lambda place: -len(fitted[place]))
    kept = [fitted[place] for place in sorted(order[:_MOST])]
    samples = sum(map(len, fitted)) - sum(map(len, kept))
    message = f"of {len(fitted)} recordings the {_MOST} longest are fitted"
    remedy = "log without interruptions"
    return kept, [Finding("many-pieces", "warning", fitted[0].source, message, remedy, samples)]


def _not_fitted(held_back: list[Recording], fitted: Sequence[Recording]) -> tuple[list[Recording], list[Finding]]:
    """Leave out held-back recordings that are fitted as well."""
    contents, message = set(map(_content, fitted)), "fitted, too, so that it shows nothing of other motions"
    both = [log for log in held_back if _content(log) in contents]
    findings = [Finding("not-held-back", "warning", log.source, message, "hold another log back") for log in both]
    return [log for log in held_back if log not in both], findings


def _period(first: Recording, period_s: float, divides_s: float | None) -> float:
    """Return the sampling period of all logs: the longest, or the next longer one that divides a time."""
    if divides_s is None:
        return period_s
    if period_s > divides_s * (1 + 1e-6):
        problem = f"has a sample every {period_s:.4g} s, expected one every {divides_s:g} s at least"
        raise InputError(f"{first.source}: {problem}; log faster")
    return divides_s / max(1, int(divides_s / period_s * (1 + 1e-6)))


def _content(recording: Recording) -> bytes:
    return str(recording.period_s).encode() + recording.inputs.tobytes() + recording.outputs.tobytes()

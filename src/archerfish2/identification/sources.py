"""Logs of one axis from files or arrays, at one sampling period."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from archerfish2.errors import InputError
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Finding, Log, Recording
from archerfish2.logs.stamps import resampled

Source = str | Path | Log | Recording
"""A file with the columns time_s, u and y, or what was read or made of another one."""


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
    groups = ([each] if isinstance(each, Source) else each for each in (logs, validate))
    read = [[_log(each) for each in group] for group in groups]
    fitted, held_back = ([each for log in group for each in log.recordings] for group in read)
    if not fitted:
        raise InputError("identify: expected a log or more, got none; pass a file")
    for each in (*fitted, *held_back):
        if (each.input_names, each.output_names) != (fitted[0].input_names, fitted[0].output_names):
            names = f"{', '.join(fitted[0].input_names)} and {', '.join(fitted[0].output_names)}"
            raise InputError(f"{each.source}: expected the signals {names} of {fitted[0].source}; read the same ones")
    contents, kept = dict[bytes, Recording](), list[Recording]()
    findings = [each for group in read for log in group for each in log.findings]
    for each in fitted:
        first = contents.setdefault(_content(each), each)
        if first is each:
            kept.append(each)
            continue
        message = f"the same as {first.source}, and left out"
        findings.append(Finding("repeated-log", "repaired", each.source, message, "name each log once", len(each)))
    message = "fitted, too, so that it shows nothing of other motions, and not held back"
    both = (each.source for each in held_back if _content(each) in contents)
    findings += [Finding("not-held-back", "warning", each, message, "hold another log back") for each in both]
    held_back = [each for each in held_back if _content(each) not in contents]
    period_s = max(each.period_s for each in (*fitted, *held_back))
    if divides_s is not None:
        if period_s > divides_s * (1 + 1e-6):
            problem = f"has a sample every {period_s:.4g} s, expected one every {divides_s:g} s at least"
            raise InputError(f"{fitted[0].source}: {problem}; log faster")
        period_s = divides_s / max(1, int(divides_s / period_s * (1 + 1e-6)))
    message = f"brought to a sampling period of {1e3 * period_s:.4g} ms"
    faster = (each.source for each in (*kept, *held_back) if abs(each.period_s / period_s - 1) > 1e-6)
    findings += [Finding("other-period", "repaired", each, message, "log all at one rate") for each in faster]
    hashes: dict[str, str | int | float | None] = {
        log.source: log.sha256 for group in read for log in group if log.sha256
    }
    kept, held_back = ([resampled(each, period_s) for each in group] for group in (kept, held_back))
    return AxisLogs(kept, held_back, tuple(findings), hashes)


def _content(recording: Recording) -> bytes:
    return str(recording.period_s).encode() + recording.inputs.tobytes() + recording.outputs.tobytes()


def _log(source: Source) -> Log:
    if isinstance(source, Recording):
        return Log((source,), (), len(source), source.source, "")
    return source if isinstance(source, Log) else read_log(source)

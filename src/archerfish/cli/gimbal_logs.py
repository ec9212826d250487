"""The logs that `archerfish identify gimbal` is given: read, examined, and cut into experiments."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from archerfish.cli.axis_evidence import Log
from archerfish.identification.doctor.common_period import at_common_period
from archerfish.identification.doctor.log_doctor import examine_log, examine_together
from archerfish.records.errors import InputError
from archerfish.records.findings import Finding
from archerfish.records.log_files import log_parts, read_log
from archerfish.records.storage import file_hash


class LogReading(NamedTuple):
    """How a log is to be read."""

    time: str
    """Name of the time column."""
    inputs: Sequence[str]
    """Names of the inputs."""
    outputs: Sequence[str]
    """Names of the outputs, the axis's own first."""
    sample_period_s: float | None
    """Sampling period [s] that stands in for the time column."""
    order: int
    """Order of the plant that is sought."""
    max_delay: int
    """Longest delay that is tried [samples]."""


class GimbalLogs(NamedTuple):
    """The experiments of an axis."""

    training: list[Log]
    """Experiments to fit."""
    validation: list[Log]
    """Experiments that are held back."""
    findings: list[Finding]
    """What was repaired, and what may spoil the estimate."""
    samples: int
    """Samples that the logs hold, those included that findings left out."""


def read_gimbal_logs(logs: Sequence[Path], held_back: Sequence[Path], reading: LogReading) -> GimbalLogs:
    """Read and examine all logs of an axis; a log with gaps becomes several experiments.

    Args:
      logs: to fit.
      held_back: to validate with.
      reading: how.

    Raises:
      InputError: with the code of the fault, if a log can't be used or all together are not enough.
    """
    period = reading.sample_period_s
    if period is not None and not (period > 0 and math.isfinite(period)):
        raise InputError(f"--sample-period-s must be above 0 s, got {period:g}", "sample-period")
    findings: list[Finding] = []
    examined: dict[str, Path] = {}
    training, fitted_samples = _experiments(logs, reading, examined, findings)
    # A log that was fitted may be foretold too, but that is no validation.
    for path in held_back:
        if (first := examined.get(_content(path))) is not None:
            message = f"is the fitted log {first.name} again, so its fit validates nothing"
            findings.append(Finding("not-held-back", "warning", str(path), message, "hold another log back"))
    validation, other_samples = _experiments(held_back, reading, {}, findings)
    recordings, resampled = at_common_period([each.recording for each in (*training, *validation)])
    findings += resampled
    paths = [each.path for each in (*training, *validation)]
    logs_at_once = [Log(*each) for each in zip(paths, recordings, strict=True)]
    training, validation = logs_at_once[: len(training)], logs_at_once[len(training) :]
    findings += examine_together([each.recording for each in training], reading.order)
    return GimbalLogs(training, validation, findings, fitted_samples + other_samples)


def _experiments(
    paths: Sequence[Path], reading: LogReading, examined: dict[str, Path], findings: list[Finding]
) -> tuple[list[Log], int]:
    logs: list[Log] = []
    samples = 0
    for path in paths:
        found = _examined(path, reading)
        content = _content(path)
        if content in examined:
            message = f"holds the same as {examined[content].name} and was left out"
            findings.append(Finding("repeated-log", "repaired", str(path), message, "name each log once"))
            continue
        examined[content] = path
        logs += found[0]
        findings += found[1]
        samples += found[2]
    return logs, samples


def _examined(path: Path, reading: LogReading) -> tuple[list[Log], list[Finding], int]:
    stamped = reading.sample_period_s is None
    table = read_log(path, reading.inputs, reading.outputs, time=reading.time if stamped else None)
    examination = examine_log(
        table if stamped else table._replace(stamps=None),
        reading.inputs,
        reading.outputs,
        order=reading.order,
        max_delay=reading.max_delay,
        sample_period_s=reading.sample_period_s,
    )
    logs = [Log(path.parent / each.source, each) for each in examination.recordings]
    return (logs if len(logs) > 1 else [Log(path, logs[0].recording)]), examination.findings, table.samples


def _content(path: Path) -> str:
    return "".join(file_hash(part) for part in log_parts(path)) if path.exists() else str(path)

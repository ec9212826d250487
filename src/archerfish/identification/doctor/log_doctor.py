"""The log doctor: examines every log before anything is fitted to it.

What can't be used is refused, what can is repaired only where the repair is certain, and everything is said with a
stable code, the place, and the remedy. docs/logs.md lists the codes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from archerfish.identification.doctor.checks import check_recordings, fewest_samples
from archerfish.identification.doctor.relation import relation_findings
from archerfish.identification.doctor.signals import signal_findings, single_sine_hz, unwrapped
from archerfish.identification.doctor.time_stamps import Piece, Rows, equal_intervals, usable_rows
from archerfish.identification.validation.frequency import driven_band_hz
from archerfish.records.findings import Finding, refusal
from archerfish.records.log_table import LogTable, stated_unit
from archerfish.records.recording import Recording

_STEADY_PERIODS = 6  # of the lowest excited frequency in a log: with fewer, the band may as well begin at zero


class Examination(NamedTuple):
    """What the doctor makes of logs."""

    recordings: list[Recording]
    """Usable experiments, at least one, in the order of the logs."""
    findings: list[Finding]
    """Repairs and warnings."""


def examine_log(
    table: LogTable,
    inputs: Sequence[str],
    outputs: Sequence[str],
    *,
    order: int,
    max_delay: int = 20,
    sample_period_s: float | None = None,
) -> Examination:
    """Turn a log into experiments that can be identified from.

    Args:
      table: the log as it was read.
      inputs: names of the inputs.
      outputs: names of the outputs.
      order: order of the plant that is sought.
      max_delay: longest delay that is tried [samples].
      sample_period_s: sampling period [s] of a log without stamps.

    Raises:
      InputError: with the code of the fault, if the log can't be used.
    """
    findings = list(table.findings)
    rows = usable_rows(table, inputs, outputs, sample_period_s, findings)
    rows = _without_wraps(table, rows, [*inputs, *outputs], findings)
    pieces = equal_intervals(table, rows, fewest_samples(order), findings)
    recordings = [_recording(table, piece, inputs, outputs, sample_period_s, pieces) for piece in pieces]
    moving = _moving(recordings, findings)
    for recording in moving:
        findings += signal_findings(recording)
        findings += relation_findings(recording, max_delay)
    silent = [finding for finding in findings if finding.severity == "refused"]
    if silent and len(silent) == len(moving):
        raise refusal(silent[0])
    return Examination(moving, [each for each in findings if each.severity != "refused"])


def examine_together(recordings: Sequence[Recording], order: int) -> list[Finding]:
    """Return what all experiments of one axis together leave open.

    Raises:
      InputError: if together they can't bear the order, or excite a single frequency.
    """
    check_recordings(recordings, order)
    sines = [_sine(recording) for recording in recordings]
    known = [each for each in sines if each is not None]
    if len(known) == len(sines) and max(known) < 1.05 * min(known):
        message = f"the input is a single sine of {known[0]:.4g} Hz, which tells two numbers: not gain, lag and delay"
        remedy = "record a sweep or a step"
        raise refusal(Finding("single-sine", "refused", recordings[0].source, message, remedy))
    if any(_drives_slowly(recording) for recording in recordings):
        return []
    low, high = driven_band_hz(recordings)
    message = f"the inputs excite {low:.3g} to {high:.3g} Hz: nothing is known below, nor the steady gain"
    return [Finding("excited-band", "warning", recordings[0].source, message, "add a step log")]


def _drives_slowly(recording: Recording) -> bool:
    return driven_band_hz([recording])[0] * len(recording) * recording.sample_period_s <= _STEADY_PERIODS


def _sine(recording: Recording) -> float | None:
    if recording.inputs.shape[1] > 1:
        return None
    return single_sine_hz(recording.inputs[:, 0], recording.sample_period_s)


def _without_wraps(table: LogTable, rows: Rows, names: list[str], findings: list[Finding]) -> Rows:
    signals = rows.signals.copy()
    for index, name in enumerate(names):
        signals[:, index], jumps = unwrapped(signals[:, index])
        if jumps:
            message = f'"{name}" jumps by a whole turn {jumps} times and was unwrapped'
            findings.append(Finding("angle-wrap", "repaired", table.source, message, "log the angle over many turns"))
    return rows._replace(signals=signals)


def _recording(
    table: LogTable,
    piece: Piece,
    inputs: Sequence[str],
    outputs: Sequence[str],
    sample_period_s: float | None,
    pieces: Sequence[Piece],
) -> Recording:
    # One period for all pieces of a log: their own differ in the last digits only.
    period = sum(each.time[-1] - each.time[0] for each in pieces) / sum(each.time.size - 1 for each in pieces)
    span = f"[{piece.time[0]:.3f}–{piece.time[-1]:.3f} s]" if len(pieces) > 1 else ""
    return Recording(
        piece.time,
        piece.signals[:, : len(inputs)],
        piece.signals[:, len(inputs) :],
        tuple(inputs),
        tuple(outputs),
        sample_period_s if table.stamps is None and sample_period_s else float(f"{period:.12g}"),
        Path(table.source).name + span,
        _units(inputs),
        _units(outputs),
    )


def _units(names: Sequence[str]) -> tuple[str, ...]:
    units = tuple(stated_unit(name) for name in names)
    return units if any(units) else ()


def _moving(recordings: list[Recording], findings: list[Finding]) -> list[Recording]:
    """Leave out experiments in which no input or not every output moves; refuse if none is left."""
    still = {id(each): reason for each in recordings if (reason := _standstill(each))}
    if len(still) == len(recordings):
        raise refusal(next(iter(still.values())))
    for recording in recordings:
        if id(recording) in still:
            reason = still[id(recording)]
            message = f"{reason.message}; this piece of {len(recording)} samples was left out"
            findings.append(reason._replace(severity="repaired", message=message, samples=len(recording)))
    return [each for each in recordings if id(each) not in still]


def _standstill(recording: Recording) -> Finding | None:
    for code, kind, names, signals in (
        ("constant-input", "input", recording.input_names, recording.inputs),
        ("constant-output", "output", recording.output_names, recording.outputs),
    ):
        for name, signal in zip(names, signals.T, strict=True):
            if np.ptp(signal) == 0:
                message = f'{kind} "{name}" is {signal[0]:g} throughout'
                remedy = "record a log in which it changes, or name another column"
                return Finding(code, "refused", recording.source, message, remedy)
    return None

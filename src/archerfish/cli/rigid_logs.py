"""The logs that `archerfish identify rigid` is given: read, cut at gaps, brought to radians."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.doctor.signals import unwrapped
from archerfish.identification.doctor.time_stamps import Piece, equal_intervals, usable_rows
from archerfish.identification.rigid.checks import FEWEST_SAMPLES
from archerfish.records.findings import Finding
from archerfish.records.log_files import read_log
from archerfish.records.log_table import stated_unit
from archerfish.records.recording import Recording

Array = NDArray[np.float64]


class RigidLog(NamedTuple):
    """What was read of a log of torque and angle."""

    recordings: list[Recording]
    """Its uninterrupted stretches."""
    samples: int
    """Samples that the log holds, those included that findings left out."""


def read_rigid_log(
    path: Path,
    torque: str,
    outputs: Sequence[str],
    *,
    time: str,
    sample_period_s: float | None,
    findings: list[Finding],
) -> RigidLog:
    """Read a log of torque and angle; one with gaps gives several recordings.

    The relation of input and output is not examined as for a position loop: an axis under torque drifts away, and a
    torque that a controller made from the angle is as good as any other.

    Args:
      path: the log.
      torque: name of the torque, or of the motor's current.
      outputs: names of the angle and, if there is one, of the rate.
      time: name of the time column.
      sample_period_s: sampling period [s] that stands in for the time column.
      findings: takes what was repaired.

    Raises:
      InputError: with the code of the fault, if the log can't be used.
    """
    table = read_log(path, [torque], outputs, time=time if sample_period_s is None else None)
    if sample_period_s is not None:
        table = table._replace(stamps=None)
    findings += table.findings
    rows = usable_rows(table, [torque], outputs, sample_period_s, findings)
    signals = rows.signals.copy()
    for index, name in enumerate(outputs, start=1):
        signals[:, index] = _radians(path, name, signals[:, index], findings)
    signals[:, 1], jumps = unwrapped(signals[:, 1])
    if jumps:
        message = f'"{outputs[0]}" jumps by a whole turn {jumps} times and was unwrapped'
        findings.append(Finding("angle-wrap", "repaired", str(path), message, "log the angle over many turns"))
    pieces = equal_intervals(table, rows._replace(signals=signals), FEWEST_SAMPLES, findings)
    recordings = [_recording(path, piece, torque, outputs, len(pieces)) for piece in pieces]
    return RigidLog(recordings, table.samples)


def _radians(path: Path, name: str, signal: Array, findings: list[Finding]) -> Array:
    if stated_unit(name) not in ("deg", "deg/s"):
        return signal
    message = f'"{name}" is in degrees, as its name says, and was turned into radians'
    findings.append(Finding("degrees", "repaired", str(path), message, "nothing to do"))
    return np.radians(signal)


def _recording(path: Path, piece: Piece, torque: str, outputs: Sequence[str], pieces: int) -> Recording:
    span = f"[{piece.time[0]:.3f}–{piece.time[-1]:.3f} s]" if pieces > 1 else ""
    period = float(f"{(piece.time[-1] - piece.time[0]) / (piece.time.size - 1):.12g}")
    return Recording(
        piece.time,
        piece.signals[:, :1],
        piece.signals[:, 1:],
        (torque,),
        tuple(outputs),
        period,
        path.name + span,
    )

"""Logs of camera and link, as text tables: angles of the gimbal, detections of a plate, moments, and message times.

Stamps stay as the file has them: the clocks of camera, gimbal and program may have any origin.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from archerfish.logs.recording import Finding, LogTable, Values, log_fault
from archerfish.logs.text import read_text

MessageTimes = tuple[Values, Values]
"""When messages were sent, increasing, and received, by one clock or by synchronised ones [s], (N,) each."""
Findings = list[Finding] | None
"""To which a reader adds what it left out."""
Frame = Literal["camera", "optical", "base"]
"""Of logged positions, see `read_detections`."""


class GimbalLog(NamedTuple):
    """Angles of a gimbal, as a program logged them."""

    time: Values  # stamps, increasing [s], (N,)
    yaw: Values  # measured, left positive, without jumps at ±π [rad], (N,)
    pitch: Values  # measured, muzzle up positive, zero if it was not logged [rad], (N,)
    command: Values | None = None  # commanded yaw, in force from its stamp on [rad], (N,), if it was logged
    source: str = "gimbal log"  # for messages


class DetectionLog(NamedTuple):
    """Detections of one plate, at most one per frame."""

    time: Values  # stamps on the camera's clock, increasing [s], (K,)
    position: Values  # of the plate in the camera's frame: x forward, y left, z up [m], (K, 3)
    receive: Values | None = None  # when each reached the program, on its clock [s], (K,), if it was; NaN: not logged
    source: str = "detections"  # for messages


def read_gimbal_log(path: str | Path, *, degrees: bool = False, findings: Findings = None) -> GimbalLog:
    """Read the columns time_s and yaw, and pitch and yaw_command where the table has them.

    Args:
      path: of the file.
      degrees: whether angles are in degrees instead of radians.
      findings: list to which is added what was left out.

    Raises:
      InputError: if a column is missing, a number is bad, or time does not increase.
    """
    angles = _table(path, ("time_s", "yaw"), ("pitch", "yaw_command"), findings).columns
    time = angles.pop("time_s")
    angles = {name: np.unwrap(np.radians(angle) if degrees else angle) for name, angle in angles.items()}
    pitch = angles.get("pitch", 0.0 * angles["yaw"])
    return GimbalLog(time, angles["yaw"], pitch, angles.get("yaw_command"), str(path))


def read_detections(
    path: str | Path, *, frame: Frame = "camera", degrees: bool = False, findings: Findings = None
) -> DetectionLog:
    """Read the columns time_s, x, y and z, and receive_s where the table has it.

    Args:
      path: of the file.
      frame: of the positions: "camera", x forward, y left, z up; "optical", x right, y down, z forward; or "base",
        already rotated by the gimbal angles of the columns rotated_yaw and, where the table has it, rotated_pitch.
      degrees: whether these angles are in degrees instead of radians.
      findings: list to which is added what was left out.

    Raises:
      InputError: if a column is missing, a number is bad, time does not increase, or most positions lie behind the
        camera.
    """
    rotated = ("rotated_yaw",) if frame == "base" else ()
    found = _table(path, ("time_s", "x", "y", "z", *rotated), ("receive_s", "rotated_pitch"), findings).columns
    x, y, z = (found["z"], -found["x"], -found["y"]) if frame == "optical" else (found[axis] for axis in "xyz")
    if rotated:
        unit = np.pi / 180 if degrees else 1.0
        level = (x + 1j * y) * np.exp(-1j * unit * found["rotated_yaw"])
        raised = (level.real + 1j * z) * np.exp(-1j * unit * found.get("rotated_pitch", 0.0 * x))
        x, y, z = raised.real, level.imag, raised.imag
    if np.mean(x <= 0) > 0.5:
        raise log_fault(path, f"most positions lie behind the camera ({frame} frame)", "name their frame", "frame")
    return DetectionLog(found["time_s"], np.column_stack([x, y, z]), found.get("receive_s"), str(path))


def read_moments(path: str | Path, *, findings: Findings = None) -> Values:
    """Read the column time_s: when a target was halfway through each of its steps, by the program's clock [s].

    Args:
      path: of the file.
      findings: list to which is added what was left out.

    Returns:
      Increasing, shape (S,).

    Raises:
      InputError: if the column is missing, a number is bad, or time does not increase.
    """
    return _table(path, ("time_s",), (), findings).columns["time_s"]


def read_message_times(path: str | Path, *, findings: Findings = None) -> MessageTimes:
    """Read the columns sent_s and received_s.

    Args:
      path: of the file.
      findings: list to which is added what was left out.

    Raises:
      InputError: if a column is missing, a number is bad, sent_s does not increase, a message was received before it
        was sent or long after, or there are fewer than 50.
    """
    table = _table(path, ("sent_s", "received_s"), (), findings)
    sent, received = table.columns.values()
    latency = received - sent
    if latency.size < 50:
        raise log_fault(path, f"has {latency.size} messages, expected at least 50", "log for longer", "too-short")
    for index in np.flatnonzero((latency < 0) | (latency > 2.0))[:1]:
        problem = f"received {latency[index]:.4g} s after it was sent, expected 0 to 2 s"
        raise log_fault(table.place(index), problem, "stamp both ends by one clock", "two-clocks")
    return sent, received


def _table(
    path: str | Path, required: Sequence[str], optional: Sequence[str] = (), findings: Findings = None
) -> LogTable:
    """Read a table whose first column increases, or else receipts, without rows that lack a value but a receipt."""
    table = read_text(Path(path), lambda names: [*required, *(name for name in names if name in optional)])
    found, missing = list(table.findings), {name: np.isnan(values) for name, values in table.columns.items()}
    receipts = missing.pop("receive_s", np.zeros(len(table.places), dtype=np.bool_))
    lost = np.any([*missing.values()], axis=0)
    values = [values for name, values in table.columns.items() if name != "receive_s"]
    again = np.append(False, np.all(np.diff(values) == 0, axis=0) & (len(values) > 1))
    for code, rows, message in (
        ("missing-values", lost, "rows without a value left out"),
        ("missing-values", receipts & ~lost, "detections without receive_s"),
        ("time-duplicate", again, "rows that repeat the one before left out"),
    ):
        if count := int(rows.sum()):
            place = table.place(int(rows.argmax()))
            found.append(Finding(code, "repaired", place, f"{message}: {count}", "log every value once", count))
    if findings is not None:
        findings += found
    kept = np.flatnonzero(~(lost | again))
    columns = {name: values[kept] for name, values in table.columns.items()}
    table = replace(table, columns=columns, places=np.asarray(table.places)[kept].tolist())
    steps = np.diff(columns[required[0]])
    # A clock that was set back is found by the receipts, which go on.
    received = np.diff(columns.get("receive_s", np.zeros(kept.size))) > 0
    for index in np.flatnonzero((steps == 0) | ((steps < 0) & ~received))[:1] + 1:
        remedy = "keep one line per stamp" if steps[index - 1] == 0 else "cut the log there into two"
        raise log_fault(table.place(index), "stamps do not increase", remedy, "time-backward")
    return table

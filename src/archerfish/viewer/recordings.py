"""A gimbal's log as something to look at: its angles and commands over time, and what it does not tell."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from archerfish.records.errors import InputError, file_error
from archerfish.records.log_files import read_log
from archerfish.records.log_table import LogTable, stated_unit
from archerfish.viewer.trial import Floats

ROLES = ("pitch", "yaw", "pitch_command", "yaw_command")
"""What a signal of a log can be."""
_ANGLES = ("{}", "{}_angle", "{}_rad", "{}_deg", "{}_angle_deg", "/joint_states/{}/position")
_COMMANDS = ("{}_command", "{}_cmd", "{}_command_deg", "{}_cmd_deg")
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_TELL_NOTHING = "A log holds no target and no pellets, so none are shown: the plate, hits and the rate are missing."


class GimbalRecording(NamedTuple):
    """Angles of a gimbal over time; an axis or command that the log lacks is NaN."""

    time: Floats
    """From the first sample on [s], shape (N,)."""
    angle: Floats
    """Pitch and yaw [rad], shape (N, 2)."""
    command: Floats
    """Their commands [rad], shape (N, 2)."""
    source: str
    """The file."""
    remarks: tuple[str, ...]
    """What is not in it, and what its reader repaired."""


def read_gimbal_recording(
    path: Path, time: str = "time_s", signals: Mapping[str, str] | None = None
) -> GimbalRecording:
    """Read the angles of a gimbal from a log: CSV, npz, MATLAB or a ROS bag.

    Args:
      path: the log.
      time: name of the time column; a bag has its own time.
      signals: role → signal; names in common use are tried for the roles where none is given.

    Raises:
      InputError: if the log can't be read, or no angle is found in it.
    """
    given = dict(signals or {})
    unknown = [role for role in given if role not in ROLES]
    if unknown:
        raise InputError(f"--signals must be of {', '.join(f'{role}=NAME' for role in ROLES)}, got {unknown[0]!r}")
    found: dict[str, str] = {}
    for role in ROLES:
        name = given[role] if role in given else _usual_name(path, time, role)
        if name:
            found[role] = name
    if "pitch" not in found and "yaw" not in found:
        tried = ", ".join(each.format("yaw") for each in _ANGLES)
        raise file_error(path, f"no angle of a gimbal was found in it (tried {tried})", "name it: --signals yaw=NAME")
    # All at once, so that they are on one clock.
    angles = [found[role] for role in ROLES[:2] if role in found]
    commands = [found[role] for role in ROLES[2:] if role in found]
    table = read_log(path, commands, angles, time=time)
    return _recording(path, table, found)


def _usual_name(path: Path, time: str, role: str) -> str:
    """Return the name in common use that a log has for a role, or nothing."""
    axis, _, kind = role.partition("_")
    for name in [each.format(axis) for each in (_COMMANDS if kind else _ANGLES)]:
        try:
            read_log(path, [], [name], time=time)
        except InputError as error:
            # Only a missing signal is a reason to try the next name.
            if error.code != "no-column" or re.search(rf'no \w+ "{re.escape(time)}"', str(error)):
                raise
            continue
        return name
    return ""


def _recording(path: Path, table: LogTable, found: Mapping[str, str]) -> GimbalRecording:
    if table.stamps is None or table.stamps.size < 2:
        raise file_error(path, "holds fewer than two stamped samples", "pass a longer log")
    stamps = np.asarray(table.stamps, np.float64) * _SECONDS.get(stated_unit(table.stamp_name), 1.0)
    unstamped = np.flatnonzero(~np.isfinite(stamps))
    if unstamped.size:
        remedy = "leave it out, or name another column: --time NAME"
        raise InputError(
            f"{table.place(int(unstamped[0]))}: no time in {table.stamp_name}, expected a number; {remedy}"
        )
    order = np.argsort(stamps, kind="stable")
    nothing = np.full(stamps.size, np.nan)

    def column(role: str) -> Floats:
        if role not in found:
            return nothing
        values = np.asarray(table.columns[found[role]], np.float64)[order]
        return np.radians(values) if stated_unit(found[role]) == "deg" else values

    places = [each.place.removeprefix(str(path)).lstrip(": ") for each in table.findings]
    repairs = [f"{place}: {each.message}".lstrip(": ") for place, each in zip(places, table.findings, strict=True)]
    absent = [role.replace("_", " ") for role in ROLES if role not in found]
    remarks = (_TELL_NOTHING, *([f"Not in the log: {', '.join(absent)}."] if absent else []), *repairs)
    return GimbalRecording(
        time=stamps[order] - stamps[order][0],
        angle=np.stack([column("pitch"), column("yaw")], axis=-1),
        command=np.stack([column("pitch_command"), column("yaw_command")], axis=-1),
        source=path.name,
        remarks=remarks,
    )


def angles_at(recording: GimbalRecording, time: float) -> tuple[Floats, Floats]:
    """Return angle and command at a time [s], shape (2,) each; what the log lacks stands at zero, or at the angle."""
    last = int(np.clip(np.searchsorted(recording.time, time, side="right") - 1, 0, recording.time.size - 1))
    angle = np.nan_to_num(recording.angle[last])
    command = recording.command[last]
    return angle, np.where(np.isfinite(command), command, angle)

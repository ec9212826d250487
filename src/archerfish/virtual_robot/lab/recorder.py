"""Playing commands on the robot and recording what it reports."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.messages import Heard
from archerfish.virtual_robot.robot import VirtualRobot

Array = NDArray[np.float64]
Play = Literal["inject", "link"]
Stamps = Literal["robot", "host"]
Advance = Callable[[float], None]
"""Is told how many seconds have been played."""

AXES = ("pitch", "yaw")
_CHUNK = 100
_ROUNDING_S = 1e-9


class Trace(NamedTuple):
    """A log of both axes, pitch and yaw: N rows."""

    time: Array
    """Stamps [s], rising, shape (N,)."""
    command: Array
    """Command in force from each stamp on [rad], shape (N, 2)."""
    angle: Array
    """Reported angles [rad], shape (N, 2)."""
    rate: Array
    """Reported rates [rad/s], shape (N, 2)."""


class Session(NamedTuple):
    """All that a host sent and heard while commands were played."""

    sent_time: Array
    """When each command was sent [s], shape (S,); of injected ones, when each came into force."""
    sent: Array
    """Commands [rad], shape (S, 2)."""
    heard: Heard
    """All messages of the one trial, padding dropped: shapes without the batch, (N, ...)."""


def play(robot: VirtualRobot, commands: Array, how: Play, advance: Advance = lambda _: None) -> Session:
    """Play commands on a robot of one trial that has been reset to the first of them.

    Args:
      robot: batch of one.
      commands: at every tick [rad], shape (N, 2).
      how: "inject" has the robot itself play them, a new one with each of its reports, so that the log holds exactly
        what was in force; "link" has the host send them over the link, as fast as it takes them.
      advance: is told of the progress.
    """
    link = robot.description.link
    rate = link.feedback_rate_hz if how == "inject" else link.command_rate_hz
    due = _due_ticks(len(commands), rate)
    held = np.repeat(commands[due], np.diff([*due, len(commands)]), axis=0)
    start = robot.time
    heard = _injected(robot, held, advance) if how == "inject" else _sent(robot, commands, due, advance)
    # The last reports are still under way.
    heard.append(robot.advance(round(max(link.feedback_latency_high_ms, 1.0)) + 1))
    return Session(start + TICK_S * due.astype(np.float64), commands[due], _joined(heard))


def _due_ticks(count: int, rate_hz: float) -> NDArray[np.int64]:
    """Return the ticks at which a new command is due at a rate."""
    moments = np.arange(int(np.ceil(count * TICK_S * rate_hz))) / (rate_hz * TICK_S)
    ticks = np.ceil(moments - _ROUNDING_S).astype(np.int64)
    return np.unique(ticks[ticks < count])


def _injected(robot: VirtualRobot, held: Array, advance: Advance) -> list[Heard]:
    heard = []
    for first in range(0, len(held), _CHUNK):
        chunk = held[first : first + _CHUNK, None]
        heard.append(robot.advance(len(chunk), inject=chunk))
        advance((first + len(chunk)) * TICK_S)
    return heard


def _sent(robot: VirtualRobot, commands: Array, due: NDArray[np.int64], advance: Advance) -> list[Heard]:
    heard = []
    for tick, after in zip(due, [*due[1:], len(commands)], strict=True):
        robot.send(commands[tick : tick + 1])
        heard.append(robot.advance(int(after - tick)))
        advance(after * TICK_S)
    return heard


def _joined(heard: list[Heard]) -> Heard:
    """Join the messages of one trial, without the padding."""
    joined = Heard(*(np.concatenate([getattr(each, name)[0] for each in heard]) for name in Heard._fields))
    kept = {
        "feedback": ~np.isnan(joined.feedback_received),
        "frame": ~np.isnan(joined.frame_received),
        "command": ~np.isnan(joined.command_stamp),
    }
    return Heard(*(getattr(joined, name)[kept[name.partition("_")[0]]] for name in Heard._fields))


def robot_trace(session: Session, start: Array, *, as_sent: bool) -> Trace:
    """Return the log of the robot's own stamps: each report with the command then in force.

    Args:
      session: what was played.
      start: command in force before [rad], shape (2,).
      as_sent: whether commands count from when they were sent, which for injected ones is when they came into force,
        or from when the robot received them.
    """
    heard = session.heard
    stamps, values = (session.sent_time, session.sent) if as_sent else (heard.command_stamp, heard.command_value)
    command = held_values(stamps, values, heard.feedback_stamp, start)
    return Trace(heard.feedback_stamp, command, heard.feedback_angle, heard.feedback_rate)


def host_trace(session: Session, start: Array) -> Trace:
    """Return the log of a host that knows its own clock only: a row for every command, with the latest report.

    Args:
      session: what was sent over the link.
      start: command in force before [rad], shape (2,).
    """
    heard = session.heard
    known = session.sent_time >= heard.feedback_received[0]
    time = session.sent_time[known]
    latest = np.searchsorted(heard.feedback_received, time + _ROUNDING_S, side="right") - 1
    command = held_values(session.sent_time, session.sent, time, start)
    return Trace(time, command, heard.feedback_angle[latest], heard.feedback_rate[latest])


def receipt_trace(session: Session, start: Array) -> Trace:
    """Return the log of a host that stamps each report when it gets it, of several at once the newest.

    Args:
      session: what was sent over the link.
      start: command in force before [rad], shape (2,).
    """
    heard = session.heard
    newest = np.diff(heard.feedback_received, append=np.inf) > _ROUNDING_S
    time = heard.feedback_received[newest]
    command = held_values(session.sent_time, session.sent, time, start)
    return Trace(time, command, heard.feedback_angle[newest], heard.feedback_rate[newest])


def held_values(stamps: Array, values: Array, time: Array, before: Array) -> Array:
    """Return which value is in force at each time.

    Args:
      stamps: from when each value holds [s], rising, shape (S,).
      values: shape (S, 2).
      time: [s], shape (N,).
      before: what held before the first, shape (2,).
    """
    index = np.searchsorted(stamps, time + _ROUNDING_S, side="right")
    return np.asarray(np.concatenate([before[None], values])[index])

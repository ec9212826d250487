"""Playing commands on the robot and recording what it reports."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.virtual_robot.batch import RobotBatch
from archerfish2.virtual_robot.description import TICK_S
from archerfish2.virtual_robot.flights import Received

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
    """All that was sent and received while commands were played."""

    sent_time: Array
    """When each command was sent [s], shape (S,); of injected ones, when each came into force."""
    sent: Array
    """Commands [rad], shape (S, 2)."""
    received: Received
    """All messages of the one trial, padding dropped: shapes without the batch, (N, ...)."""


def play(robot: RobotBatch, commands: Array, how: Play, advance: Advance = lambda _: None) -> Session:
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
    received = _injected(robot, held, advance) if how == "inject" else _sent(robot, commands, due, advance)
    # The last reports are still under way.
    received.append(robot.advance(round(max(link.feedback_latency_high_ms, 1.0)) + 1))
    return Session(start + TICK_S * due.astype(np.float64), commands[due], _joined(received))


def _due_ticks(count: int, rate_hz: float) -> NDArray[np.int64]:
    """Return the ticks at which a new command is due at a rate."""
    moments = np.arange(int(np.ceil(count * TICK_S * rate_hz))) / (rate_hz * TICK_S)
    ticks = np.ceil(moments - _ROUNDING_S).astype(np.int64)
    return np.unique(ticks[ticks < count])


def _injected(robot: RobotBatch, held: Array, advance: Advance) -> list[Received]:
    received = []
    for first in range(0, len(held), _CHUNK):
        chunk = held[first : first + _CHUNK, None]
        received.append(robot.advance(len(chunk), inject=chunk))
        advance((first + len(chunk)) * TICK_S)
    return received


def _sent(robot: RobotBatch, commands: Array, due: NDArray[np.int64], advance: Advance) -> list[Received]:
    received = []
    for tick, after in zip(due, [*due[1:], len(commands)], strict=True):
        robot.send(commands[tick : tick + 1])
        received.append(robot.advance(int(after - tick)))
        advance(after * TICK_S)
    return received


def _joined(parts: list[Received]) -> Received:
    """Join the messages of one trial, without the places that no message takes."""
    joined = list[Any]()
    for kind in zip(*parts, strict=True):
        fields = [np.concatenate([field[0] for field in pieces]) for pieces in zip(*kind, strict=True)]
        messages = type(kind[0])(*fields)
        is_there = ~np.isnan(messages.received_s)
        joined.append(type(messages)(*(field[is_there] for field in messages)))
    return Received(*joined)


def robot_trace(session: Session, start: Array, *, as_sent: bool) -> Trace:
    """Return the log of the robot's own stamps: each report with the command then in force.

    Args:
      session: what was played.
      start: command in force before [rad], shape (2,).
      as_sent: whether commands count from when they were sent, which for injected ones is when they came into force,
        or from when the robot received them.
    """
    received = session.received
    stamps, values = (
        (session.sent_time, session.sent) if as_sent else (received.commands.received_s, received.commands.angle)
    )
    command = held_values(stamps, values, received.feedback.sampled_s, start)
    return Trace(received.feedback.sampled_s, command, received.feedback.angle, received.feedback.rate)


def host_trace(session: Session, start: Array) -> Trace:
    """Return the log of a host that knows its own clock only: a row for every command, with the latest report.

    Args:
      session: what was sent over the link.
      start: command in force before [rad], shape (2,).
    """
    received = session.received
    known = session.sent_time >= received.feedback.received_s[0]
    time = session.sent_time[known]
    latest = np.searchsorted(received.feedback.received_s, time + _ROUNDING_S, side="right") - 1
    command = held_values(session.sent_time, session.sent, time, start)
    return Trace(time, command, received.feedback.angle[latest], received.feedback.rate[latest])


def receipt_trace(session: Session, start: Array) -> Trace:
    """Return the log of a host that stamps each report when it gets it, of several at once the newest.

    Args:
      session: what was sent over the link.
      start: command in force before [rad], shape (2,).
    """
    received = session.received
    newest = np.diff(received.feedback.received_s, append=np.inf) > _ROUNDING_S
    time = received.feedback.received_s[newest]
    command = held_values(session.sent_time, session.sent, time, start)
    return Trace(time, command, received.feedback.angle[newest], received.feedback.rate[newest])


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

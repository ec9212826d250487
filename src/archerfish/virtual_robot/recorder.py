"""Commands played on one robot, and the logs that come of it."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.flights import Received

Array = NDArray[np.float64]
REST_S = 0.5
"""At rest before and after every excitation [s]."""
_CHUNK = 100  # ticks that are played at once
_ROUNDING_S = 1e-9
_LEVELS = (
    (1.0, 0.03, -0.94, 0.05, -1.0, -0.04, 0.97, -0.02, 0.91, 0.07),
    (-1.0, 0.02, 0.63, 0.06, -0.58, -0.03, 0.98, 0.04, -0.95, -0.05),
)
"""Of a step log and of the one that is held back. They are uneven, since an encoder's step and friction leave an error
that depends on the level: always back to the same one, it would be the same each time and pass for a gain."""
_HOLDS = (1.0, 0.7, 1.3, 0.85, 1.15, 0.75, 1.2, 1.05, 0.8, 1.2)
"""How long each level is held, as shares. Friction leaves a small error after each step: at equal intervals these would
look like a slow oscillation of the axis, and a fit would make a pole of it."""


class Played(NamedTuple):
    """Commands that were played, and what came back."""

    sent_s: Array  # when each was sent, or came into force where the robot played it itself [s], (S,)
    sent: Array  # [rad], (S, 2)
    received: Received  # of the one robot, without the batch axis and without empty places

    def in_force(self, start: Array) -> Array:
        """Return the command in force at each report, (N, 2); before the first it is `start` [rad], (2,)."""
        place = np.searchsorted(self.sent_s, self.received.feedback.sampled_s + _ROUNDING_S, side="right")
        return np.asarray(np.concatenate([start[None], self.sent])[place])


def chirp(amplitude: float, low_hz: float, high_hz: float, duration_s: float) -> Array:
    """Return a sine whose frequency goes linearly from `low_hz` to `high_hz`, between two rests, a value a tick, (N,).

    Args:
      amplitude: of the sine, which begins upwards where it is positive [rad].
      low_hz: first frequency, which may be the larger one.
      high_hz: last frequency.
      duration_s: without the rests.
    """
    time = TICK_S * np.arange(round(duration_s / TICK_S))
    cycles = low_hz * time + 0.5 * (high_hz - low_hz) * time**2 / duration_s
    return between_rests(amplitude * np.sin(2.0 * np.pi * cycles))


def steps(size: float, hold_s: float, *, held_back: bool = False) -> Array:
    """Return steps to both sides, each held and followed by one back to near the middle, a value a tick, (N,).

    Args:
      size: of the largest [rad].
      hold_s: how long each is held, about [s].
      held_back: whether they have other sizes and another order, for a log that no fit uses.
    """
    ticks = [round(share * hold_s / TICK_S) for share in _HOLDS]
    return between_rests(np.repeat(size * np.array(_LEVELS[held_back]), ticks))


def between_rests(signal: Array) -> Array:
    """Return a signal with zeros before and after it, (N,)."""
    rest = np.zeros(round(REST_S / TICK_S))
    return np.concatenate([rest, signal, rest])


def inject_commands(robot: RobotBatch, commands: Array) -> Played:
    """Have the robot itself play commands, a new one with each of its reports, so that the log has what was in force.

    Args:
      robot: batch of one, which has been reset to the first command.
      commands: at every tick [rad], (N, 2).
    """
    due = _due_ticks(len(commands), robot.description.link.feedback_rate_hz)
    held, start, parts = np.repeat(commands[due], np.diff([*due, len(commands)]), axis=0), robot.time, list[Received]()
    for first in range(0, len(held), _CHUNK):
        chunk = held[first : first + _CHUNK, None]
        parts.append(robot.advance(len(chunk), inject=chunk))
    return _played(robot, start, due, commands, parts)


def send_commands(robot: RobotBatch, commands: Array) -> Played:
    """Send commands over the link, as fast as it takes them.

    Args:
      robot: batch of one, which has been reset to the first command.
      commands: at every tick [rad], (N, 2).
    """
    due = _due_ticks(len(commands), robot.description.link.command_rate_hz)
    start, parts = robot.time, list[Received]()
    for tick, after in zip(due, [*due[1:], len(commands)], strict=True):
        robot.send(commands[tick : tick + 1])
        parts.append(robot.advance(int(after - tick)))
    return _played(robot, start, due, commands, parts)


def _due_ticks(count: int, rate_hz: float) -> NDArray[np.int64]:
    """Return the ticks at which a new command is due at a rate."""
    moments = np.arange(int(np.ceil(count * TICK_S * rate_hz))) / (rate_hz * TICK_S)
    ticks = np.ceil(moments - _ROUNDING_S).astype(np.int64)
    return np.unique(ticks[ticks < count])


def _played(
    robot: RobotBatch, start_s: float, due: NDArray[np.int64], commands: Array, parts: list[Received]
) -> Played:
    latency_ms = robot.description.link.feedback_latency_high_ms
    parts = [*parts, robot.advance(round(max(latency_ms, 1.0)) + 1)]  # the last reports are still under way
    joined = list[Any]()
    for kind in zip(*parts, strict=True):
        fields = [np.concatenate([field[0] for field in pieces]) for pieces in zip(*kind, strict=True)]
        messages = type(kind[0])(*fields)
        is_there = ~np.isnan(messages.received_s)
        joined.append(type(messages)(*(field[is_there] for field in messages)))
    return Played(start_s + TICK_S * due.astype(np.float64), commands[due], Received(*joined))

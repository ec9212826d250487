"""From what is seen to the numbers that a policy gets, and from its action to an angle command.

Two observations. `paper`: the six numbers of the paper, the gimbal's angles at the last two moments and the target's
position at this one (its height never changes, so two coordinates). `history`: the last frames, scaled and differenced,
with the error of the line of fire; raw frames hold the same facts in a form that a small network hardly learns from.
It also tells where the command would come to rest if it braked now as hard as the limits allow: on which side of the
aim that lies decides between pushing on and braking, the switching rule of a time-optimal slew.

In both, an action is an offset from the aim at the target as seen now.
"""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.stopping_way import overshoot

KINDS = ("history", "paper")
DEFAULT_FRAMES = 4
ACTION_SCALES = {"box": (0.1, 0.3), "gate": (0.03, 0.1), "los-2deg": (0.03, 0.1)}
"""Command limit → offset of the command from the aim per unit of action, pitch and yaw [rad]: wide where the command
may overdrive the gimbal, narrow where it can't, so that exploring does not drown the last milliradians."""
UNLIMITED = 1e3
"""Braking of a command that may jump [rad]."""
_FRAME = 7
"""Numbers per remembered frame: angle 2, aim 2, range, command 2."""
_FINE = 100.0
"""Scale of the fine error: 10 mrad, the width of an armor at 5 m, is one."""


class Observer(NamedTuple):
    """How a policy sees and acts; arrays only, so that it passes through a compiled program."""

    history: Array
    """Weight of each remembered frame, ones, shape (h,); empty for the six numbers of the paper."""
    action_scale: Array
    """Offset from the aim per unit of action, pitch and yaw [rad], shape (2,)."""
    braking: Array
    """By how much the command's move per decision may change from one decision to the next, pitch and yaw [rad],
    shape (2,)."""
    muzzle: Muzzle
    """The muzzle that the aim is computed for."""

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return observation_size(self)

    def begin(self, seen: Seen) -> Array:
        """Return the memory at the beginning of an engagement, see `begin_memory`."""
        return begin_memory(self, seen)

    def remember(self, memory: Array, seen: Seen) -> Array:
        """Take in what is seen now, shape B + (h, 7); see `remember`."""
        return remember(self, memory, seen)

    def observe(self, memory: Array) -> Array:
        """Build the observation, shape B + (size,)."""
        return observe(self, memory)

    def decode(self, memory: Array, action: Array) -> Array:
        """Turn an action, shape B + (2,), into a command; see `decode_action`."""
        return decode_action(self, memory, action)


def make_observer(
    kind: str,
    muzzle: Muzzle,
    frames: int = DEFAULT_FRAMES,
    action_scale: tuple[float, float] = ACTION_SCALES["box"],
    braking: Array | None = None,
) -> Observer:
    """Build an observer.

    Args:
      kind: "history" or "paper".
      muzzle: the muzzle to aim with.
      frames: frames that `history` remembers, at least 2.
      action_scale: offset of the command from the aim per unit of action, pitch and yaw [rad].
      braking: by how much the limits let the command's move per decision change, pitch and yaw [rad], shape (2,);
        without limit if not given.

    Raises:
      InputError: if the kind is unknown or frames < 2.
    """
    if kind not in KINDS:
        raise InputError(f"observation must be one of {', '.join(KINDS)}, got {kind!r}")
    if kind == "history" and frames < 2:
        raise InputError(f"frames must be at least 2 for the history observation, got {frames}")
    braking = np.full(2, UNLIMITED) if braking is None else braking
    return Observer(np.ones(frames if kind == "history" else 0), np.array(action_scale), braking, muzzle)


def observation_size(observer: Observer) -> int:
    """Return how many numbers an observation has."""
    frames = observer.history.shape[0]
    return 6 if frames == 0 else 8 + 7 * (frames - 1) + 2 + 4


def begin_memory(observer: Observer, seen: Seen) -> Array:
    """Return the memory at the beginning of an engagement, as if nothing had moved before it.

    Returns:
      Shape B + (h, 7), or B + (2, 7) for the six numbers.
    """
    xp = namespace(seen.angle, seen.plate)
    frame = _frame(observer, seen)
    return xp.stack([frame] * max(observer.history.shape[0], 2), axis=-2)


def remember(observer: Observer, memory: Array, seen: Seen) -> Array:
    """Push the newest frame into the memory, shape B + (h, 7); the last one is the newest."""
    xp = namespace(memory, seen.angle)
    return xp.concat([memory[..., 1:, :], _frame(observer, seen)[..., None, :]], axis=-2)


def _frame(observer: Observer, seen: Seen) -> Array:
    xp = namespace(seen.angle, seen.plate)
    plate = seen.plate[..., 0, :]
    aim = aim_at(plate, observer.muzzle).angle
    distance = xp.sqrt(xp.sum(plate**2, axis=-1, keepdims=True))
    return xp.concat([seen.angle, aim, distance, seen.command], axis=-1)


def observe(observer: Observer, memory: Array) -> Array:
    """Build the observation from the memory, shape B + (observation_size,)."""
    if observer.history.shape[0] == 0:
        return _six_numbers(memory)
    xp = namespace(memory)
    angle, aim, distance, command = (memory[..., a:b] for a, b in ((0, 2), (2, 4), (4, 5), (5, 7)))
    error = aim[..., -1, :] - angle[..., -1, :]
    steps = [xp.reshape(_differences(each), (*memory.shape[:-2], -1)) for each in (angle, aim, distance)]
    asked = command - angle
    rest = overshoot(observer.braking, aim[..., -1, :], command[..., -1, :], command[..., -2, :])
    return xp.concat(
        [
            2.0 * error,
            xp.tanh(_FINE / 3.0 * error),
            2.0 * aim[..., -1, 1:],
            0.5 * (distance[..., -1, :] - 3.0),
            xp.reshape(2.0 * asked[..., -2:, :], (*memory.shape[:-2], -1)),
            10.0 * steps[0],
            _FINE * steps[1],
            _FINE * steps[2],
            xp.reshape(2.0 * _differences(command), (*memory.shape[:-2], -1)),
            2.0 * rest,
            xp.tanh(_FINE / 3.0 * rest),
        ],
        axis=-1,
    )


def _six_numbers(memory: Array) -> Array:
    """Angles of two moments and the target's yaw and range now: the paper's six numbers."""
    xp = namespace(memory)
    angles = xp.reshape(memory[..., -2:, 0:2], (*memory.shape[:-2], 4))
    target = memory[..., -1, 3:5]
    return xp.concat([2.0 * angles, 2.0 * target[..., :1], 0.5 * (target[..., 1:] - 3.0)], axis=-1)


def _differences(series: Array) -> Array:
    return series[..., 1:, :] - series[..., :-1, :]


def decode_action(observer: Observer, memory: Array, action: Array) -> Array:
    """Turn an action into a pitch and yaw command [rad], shape B + (2,).

    Args:
      observer: its action scale.
      memory: shape B + (h, 7).
      action: shape B + (2,); zero aims at where the target is seen.
    """
    return memory[..., -1, 2:4] + lift(observer.action_scale, action) * action

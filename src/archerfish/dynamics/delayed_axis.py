"""Two linear gimbal axes whose commands take effect at any tick, each after a delay of its own.

Over a link every command comes late by another time, and feedback shows the axes at a moment between two decisions. So
the axes must be advanced by any number of ticks under a command that changes on the way: a product with the n-step
matrices for each stretch between two changes, which are computed in float64 for every n up to a decision period.
"""

from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.dynamics.linear_axis import (
    LinearAxis,
    axis_draws,
    padded,
    refined,
    scaled,
    ticks_per_period,
)
from archerfish.errors import InputError
from archerfish.records.plant import PlantRecord


class DelayedGimbal(NamedTuple):
    """Both axes by the tick (index 0 is pitch, 1 is yaw; N ticks make a period) in k posterior draws."""

    transition: Array  # state to state over 0…N ticks, (k, N + 1, 2, n, n)
    input: Array  # held command to state over 0…N ticks, (k, N + 1, 2, n)
    angle: Array  # state to angle [rad], (k, 2, n)
    feedthrough: Array  # command in force to angle, (k, 2)
    rate: Array  # state to rate [rad/s], (k, 2, n)
    rate_feedthrough: Array  # command in force to rate, (k, 2)
    rest: Array  # state at rest per unit of command, (k, 2, n)
    delay: Array  # of the axes themselves [ticks], (k, 2)
    tick: Array  # length of a tick [s], ()


class DelayedState(NamedTuple):
    """Moving axes and the commands on their way to them."""

    plant: Array  # state of the axes, B + (2, n)
    commands: Array  # the one in force and those on their way, oldest first [rad], B + (2, Q)
    due: Array  # when each takes effect, from now, rising, ≤ 0 for the one in force [ticks], B + (2, Q)


def delayed_gimbal(pitch: PlantRecord, yaw: PlantRecord, period_s: float) -> DelayedGimbal:
    """Build the model of a gimbal from the posterior draws of its axes, or from the best estimates without any.

    Args:
      pitch: plant of the pitch axis, one input; of several outputs the first is its angle.
      yaw: plant of the yaw axis, likewise, of the same sampling period.
      period_s: decision period [s], a multiple of the sampling period.

    Raises:
      InputError: if the period is no multiple of the sampling period, the periods differ, or a plant has several
        inputs.
    """
    if abs(pitch.sample_period_s - yaw.sample_period_s) > 1e-9:
        raise InputError(
            f"both axes must have the same sampling period, got {pitch.sample_period_s} s for pitch and "
            f"{yaw.sample_period_s} s for yaw; record both at the same rate"
        )
    axes = axis_draws(pitch, yaw)
    for axis in axes:
        ticks_per_period(axis, period_s)
    # The ticks of both axes shortened to about a millisecond, or of none: latencies are not to be rounded to the
    # feedback's rate.
    finer = [refined(axis) for axis in axes]
    axes = finer if abs(finer[0].period_s - finer[1].period_s) < 1e-9 else axes
    ticks, size = ticks_per_period(axes[0], period_s), max(axis.b.shape[-1] for axis in axes)
    both = [_by_tick(scaled(axis), ticks, size) for axis in axes]
    fields: Any = []
    for states, arrays in zip((2, 1, 1, 0, 1, 0, 1), zip(*both, strict=True), strict=True):
        fields.append(np.stack(arrays, axis=-states - 1))
    delay = np.stack([axis.delay for axis in axes], axis=-1).astype(np.int32)
    fields += [delay, np.asarray(axes[0].period_s)]
    return DelayedGimbal(*fields)


def _by_tick(axis: LinearAxis, ticks: int, size: int) -> tuple[Array, ...]:
    """Return the fields of `DelayedGimbal` up to `rest` of one axis, padded to a size, k first."""
    a, b, c, d = axis[:4]
    one = np.eye(a.shape[-1])
    transitions, inputs = [0.0 * a + one], [0.0 * b]
    for _ in range(ticks):
        inputs.append(np.vecdot(a, inputs[-1][..., None, :]) + b)
        transitions.append(a @ transitions[-1])
    rate, rest = (np.vecdot(a.mT, c[..., None, :]) - c) / axis.period_s, np.linalg.solve(one - a, b[..., None])[..., 0]
    return (
        padded(np.stack(transitions, axis=1), 2, size),
        padded(np.stack(inputs, axis=1), 1, size),
        padded(c, 1, size),
        d,
        padded(rate, 1, size),
        np.vecdot(c, b) / axis.period_s,
        padded(rest, 1, size),
    )


def longest_wait(gimbal: DelayedGimbal, latency_ticks: float) -> int:
    """Return how many commands may be on their way or in force, Q, with a latency of up to so many ticks."""
    period = gimbal.transition.shape[1] - 1
    return int(np.ceil((np.max(gimbal.delay) + latency_ticks) / period)) + 2


def rest_under(gimbal: DelayedGimbal, draw: Array, command: Array, places: int) -> DelayedState:
    """Return the axes at rest under a constant command.

    Args:
      gimbal: the gimbal.
      draw: which of the k draws, shape B.
      command: pitch and yaw command [rad], shape B + (2,).
      places: Q, see `longest_wait`.
    """
    xp = namespace(command)
    commands = xp.stack([command] * places, axis=-1)
    return DelayedState(gimbal.rest[draw] * command[..., None], commands, xp.zeros_like(commands))


def send(gimbal: DelayedGimbal, draw: Array, state: DelayedState, command: Array, latency: Array) -> DelayedState:
    """Send a command on its way; none overtakes the one before it.

    Args:
      gimbal: the gimbal.
      draw: which of the k draws, shape B.
      state: of the axes.
      command: pitch and yaw command [rad], shape B + (2,).
      latency: of the link, before the axes' own delay [s], shape B.
    """
    xp = namespace(command, state.due)
    ticks = xp.round(latency / gimbal.tick)[..., None]
    # NumPy would make float64 of float32 and whole numbers.
    ticks = ticks + xp.astype(gimbal.delay[draw], ticks.dtype)
    due = xp.maximum(ticks, state.due[..., -1])
    return DelayedState(
        state.plant,
        xp.concat([state.commands[..., 1:], command[..., None]], axis=-1),
        xp.concat([state.due[..., 1:], due[..., None]], axis=-1),
    )


def run(gimbal: DelayedGimbal, draw: Array, state: DelayedState, ticks: Array) -> DelayedState:
    """Advance the axes.

    Args:
      gimbal: the gimbal.
      draw: which of the k draws, shape B.
      state: of the axes.
      ticks: how far, whole and within 0…N, shape B.
    """
    xp = namespace(state.plant)
    end = ticks[..., None]
    plant = state.plant
    axes = np.arange(2)
    places = state.commands.shape[-1]
    for place in range(places):
        begin = xp.clip(state.due[..., place], 0.0, end) if place else 0.0 * end
        until = xp.clip(state.due[..., place + 1], 0.0, end) if place + 1 < places else end
        stretch = xp.astype(until - begin, xp.int32)
        transition = gimbal.transition[draw[..., None], stretch, axes]
        pushed = gimbal.input[draw[..., None], stretch, axes] * state.commands[..., place][..., None]
        plant = xp.sum(transition * plant[..., None, :], axis=-1) + pushed
    return DelayedState(plant, state.commands, state.due - end[..., None])


def angle_and_rate(gimbal: DelayedGimbal, draw: Array, state: DelayedState) -> tuple[Array, Array]:
    """Return pitch and yaw [rad] and their rates over the coming tick [rad/s], shape B + (2,) each."""
    xp = namespace(state.plant)
    # The latest command that is due; all older ones are due too.
    acting = state.due <= 0.0
    rising = xp.concat([acting[..., 1:], xp.zeros_like(acting[..., :1])], axis=-1)
    newest = acting & ~rising
    newest = xp.concat([newest[..., :1] | ~acting[..., :1], newest[..., 1:]], axis=-1)
    command = xp.sum(xp.where(newest, state.commands, 0.0), axis=-1)
    angle = xp.sum(gimbal.angle[draw] * state.plant, axis=-1) + gimbal.feedthrough[draw] * command
    rate = xp.sum(gimbal.rate[draw] * state.plant, axis=-1) + gimbal.rate_feedthrough[draw] * command
    return angle, lift(rate, angle)

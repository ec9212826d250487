"""Two linear gimbal axes whose commands take effect at any tick, each after a delay of its own.

Over a link every command comes late by another time, and feedback shows the axes at a moment between two decisions. So
the axes must be advanced by any number of ticks under a command that changes on the way: a product with the n-step
matrices for each stretch between two changes, which are computed in float64 for every n up to a decision period.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.linear_axis import LATENCY_TICK_S, plant_draws, refined, scaled_matrices, ticks_per_period
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

Matrix = NDArray[np.float64]


class DelayedGimbal(NamedTuple):
    """Both axes by the tick (index 0 is pitch, 1 is yaw; N ticks make a period); k draws lead where there are any."""

    transition: Array
    """State to state over 0…N ticks, shape (k, N + 1, 2, n, n)."""
    input: Array
    """Held command to state over 0…N ticks, shape (k, N + 1, 2, n)."""
    angle: Array
    """State to angle [rad], shape (k, 2, n)."""
    feedthrough: Array
    """Command in force to angle, shape (k, 2)."""
    rate: Array
    """State to rate [rad/s], shape (k, 2, n)."""
    rate_feedthrough: Array
    """Command in force to rate, shape (k, 2)."""
    rest: Array
    """State at rest per unit of command, shape (k, 2, n)."""
    delay: Array
    """Delay of the axes themselves [ticks], shape (k, 2)."""
    tick: Array
    """Length of a tick [s], shape ()."""


class DelayedState(NamedTuple):
    """Axes on the move and the commands on their way to them."""

    plant: Array
    """State of the axes, shape B + (2, n)."""
    commands: Array
    """The command in force and those on their way, oldest first [rad], shape B + (2, Q)."""
    due: Array
    """When each takes effect, from now [ticks], at most zero for the one in force, rising; shape B + (2, Q)."""


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
    for plant in (pitch, yaw):
        ticks_per_period(plant, period_s)
    draws = _refined([plant_draws(plant) for plant in (pitch, yaw)])
    ticks = ticks_per_period(draws[0][0], period_s)
    count = min(len(each) for each in draws if len(each) > 1) if max(map(len, draws)) > 1 else 1
    axes = [[_axis(each[index % len(each)], ticks) for each in draws] for index in range(count)]
    gimbals = [_both(pair) for pair in axes]
    joined = DelayedGimbal(*(np.stack(arrays) for arrays in zip(*gimbals, strict=True)))
    return joined._replace(tick=np.asarray(draws[0][0].sample_period_s))


def _refined(draws: list[list[PlantRecord]]) -> list[list[PlantRecord]]:
    """Shorten all ticks to about a millisecond, or none: latencies are not to be rounded to the feedback's rate."""
    finer = [[refined(plant, LATENCY_TICK_S) for plant in each] for each in draws]
    periods = {plant.sample_period_s for each in finer for plant in each}
    return finer if max(periods) - min(periods) < 1e-9 else draws


class _Axis(NamedTuple):
    transition: Matrix
    input: Matrix
    angle: Matrix
    feedthrough: float
    rate: Matrix
    rate_feedthrough: float
    rest: Matrix
    delay: int


def _axis(plant: PlantRecord, ticks: int) -> _Axis:
    a, b, c, d = scaled_matrices(plant)
    transitions, inputs = [np.eye(len(a))], [np.zeros(len(a))]
    for _ in range(ticks):
        inputs.append(a @ inputs[-1] + b)
        transitions.append(a @ transitions[-1])
    period = plant.sample_period_s
    return _Axis(
        np.array(transitions),
        np.array(inputs),
        c,
        d,
        (c @ a - c) / period,
        float(c @ b) / period,
        np.asarray(np.linalg.solve(np.eye(len(a)) - a, b)),
        plant.delay_samples,
    )


def _both(axes: Sequence[_Axis]) -> tuple[Matrix, ...]:
    size = max(len(axis.angle) for axis in axes)

    def pad(array: Matrix, dimensions: int) -> Matrix:
        return np.pad(array, [(0, 0)] * (array.ndim - dimensions) + [(0, size - array.shape[-1])] * dimensions)

    return (
        np.stack([pad(axis.transition, 2) for axis in axes], axis=1),
        np.stack([pad(axis.input, 1) for axis in axes], axis=1),
        np.stack([pad(axis.angle, 1) for axis in axes]),
        np.array([axis.feedthrough for axis in axes]),
        np.stack([pad(axis.rate, 1) for axis in axes]),
        np.array([axis.rate_feedthrough for axis in axes]),
        np.stack([pad(axis.rest, 1) for axis in axes]),
        np.array([axis.delay for axis in axes], dtype=np.int32),
        np.zeros(()),
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

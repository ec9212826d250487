"""Two linear gimbal axes under commands held for a decision period, eqs (11)–(16).

    x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]

Over n ticks with held commands this is one matrix product, exact: the n-step matrices are computed in float64, so no
loop over ticks is left. The state of an axis holds, beside x, the past commands that the delay still needs and the
rate at the end of the period, so that one product advances everything.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

Matrix = NDArray[np.float64]


class GimbalModel(NamedTuple):
    """Both axes over one decision period; index 0 is pitch, 1 is yaw; leading batch dimensions for plant draws."""

    transition: Array
    """State to state, shape (..., 2, m, m)."""
    input: Array
    """Held command to state, shape (..., 2, m)."""
    angle: Array
    """State to angle [rad], shape (..., 2, m)."""
    rate: Array
    """State to rate [rad/s], shape (..., 2, m)."""
    rest: Array
    """State at rest per unit of command, shape (..., 2, m)."""


def gimbal_model(pitch: PlantRecord, yaw: PlantRecord, period_s: float) -> GimbalModel:
    """Build the model of a gimbal for decisions every `period_s`.

    Args:
      pitch: plant of the pitch axis, one input; of several outputs the first is its angle.
      yaw: plant of the yaw axis, likewise.
      period_s: decision period [s], a multiple of both sampling periods.

    Returns:
      The best estimate, shape (2, ...). `gimbal_draws` gives the posterior.

    Raises:
      InputError: if the period is no multiple of a sampling period, or a plant has several inputs or outputs.
    """
    return _stack([period_model(plant, period_s) for plant in (pitch, yaw)], axis=0)


def gimbal_draws(pitch: PlantRecord, yaw: PlantRecord, period_s: float) -> GimbalModel | None:
    """Build the models of all posterior draws, shape (k, 2, ...), or None where a record has no draws."""
    if not pitch.draws or not yaw.draws:
        return None
    count = min(len(pitch.draws["A"]), len(yaw.draws["A"]))
    pairs = ([period_model(_draw(plant, index), period_s) for plant in (pitch, yaw)] for index in range(count))
    return _stack([_stack(pair, axis=0) for pair in pairs], axis=0)


def _draw(plant: PlantRecord, index: int) -> PlantRecord:
    matrices = {name: draws[index] for name, draws in plant.draws.items()}
    delay = int(plant.delays_of_draws()[index])
    return PlantRecord(**matrices, delay_samples=delay, sample_period_s=plant.sample_period_s)


def period_model(plant: PlantRecord, period_s: float) -> GimbalModel:
    """Build the model of one axis, without the leading dimension of the two axes.

    A delay of d = q n + r ticks (r < n) lets the command of q + 1 periods ago act for r ticks and that of q periods ago
    for the other n − r.
    """
    ticks = _ticks(plant, period_s)
    a, b, c, d = _scaled(plant)
    order = len(a)
    whole, part = divmod(plant.delay_samples, ticks)
    power = [np.linalg.matrix_power(a, count) for count in (ticks, ticks - part)]
    held = [_held_input(a, b, count) for count in (ticks - part, part)]
    size = order + whole + 2  # x, the commands of the last whole + 1 periods, the rate
    transition, into = np.zeros((size, size)), np.zeros(size)
    # The command in force during the last n − r ticks, and the one before it, as rows over (state, new command).
    commands = np.zeros((whole + 2, size + 1))
    commands[0, -1] = 1.0
    commands[np.arange(1, whole + 2), order + np.arange(whole + 1)] = 1.0
    after = np.zeros((order, size + 1))
    after[:, :order] = power[0]
    after += np.outer(held[0], commands[whole]) + np.outer(power[1] @ held[1], commands[whole + 1])
    output = c @ after + d * commands[whole]
    # The output one tick earlier gives the rate; it is simulated with the same held commands.
    earlier = _output_before_last_tick(a, b, c, d, ticks, part, commands[whole : whole + 2], order)
    rows = np.vstack([after, commands[: whole + 1], (output - earlier) / plant.sample_period_s])
    transition[:], into[:] = rows[:, :-1], rows[:, -1]
    angle, rate = np.zeros(size), np.zeros(size)
    angle[:order], angle[order + whole] = c, d
    rate[-1] = 1.0
    return GimbalModel(transition, into, angle, rate, np.linalg.solve(np.eye(size) - transition, into))


def _ticks(plant: PlantRecord, period_s: float) -> int:
    ratio = period_s / plant.sample_period_s
    if abs(ratio - round(ratio)) > 1e-6 * ratio or round(ratio) < 1:
        raise InputError(
            f"period_s must be a multiple of the plant's sampling period {plant.sample_period_s} s, got {period_s} s; "
            "choose another period or resample the log before identifying"
        )
    if plant.B.shape[1] != 1:
        raise InputError(
            f"a gimbal axis needs one input, got {plant.B.shape[1]}; identify it with one --input and one --output"
        )
    return round(ratio)


def _scaled(plant: PlantRecord) -> tuple[Matrix, Matrix, Matrix, float]:
    """Scale each state by its peak in the step response: entries of order one keep float32 accurate."""
    a, b, c = plant.A, plant.B[:, 0], plant.C[0]
    state, peak = np.zeros(len(a)), np.zeros(len(a))
    for _ in range(2000):
        state = a @ state + b
        peak = np.maximum(peak, np.abs(state))
    scale = np.where(peak > 0, peak, 1.0)
    return a * scale / scale[:, None], b / scale, c * scale, float(plant.D[0, 0])


def _held_input(a: Matrix, b: Matrix, ticks: int) -> Matrix:
    """Return the state after `ticks` ticks from zero under a unit command."""
    state = np.zeros(len(a))
    for _ in range(ticks):
        state = a @ state + b
    return state


def _output_before_last_tick(
    a: Matrix, b: Matrix, c: Matrix, d: float, ticks: int, part: int, commands: Matrix, order: int
) -> Matrix:
    """Return the output after ticks − 1 ticks, as a row over (state, new command)."""
    state = np.zeros((order, commands.shape[1]))
    state[:, :order] = np.eye(order)
    in_force = commands[1]
    for tick in range(ticks - 1):
        in_force = commands[0] if tick >= part else commands[1]
        state = a @ state + np.outer(b, in_force)
    # With one tick a period the output before it is that of the last period: the feedthrough used its last command.
    return np.asarray(c @ state + d * in_force)


def _stack(models: Sequence[GimbalModel], axis: int) -> GimbalModel:
    size = max(model.input.shape[-1] for model in models)
    padded = zip(*(_pad(model, size) for model in models), strict=True)
    return GimbalModel(*(np.stack(arrays, axis) for arrays in padded))


def _pad(model: GimbalModel, size: int) -> GimbalModel:
    extra = size - model.input.shape[-1]

    def pad(array: Matrix, axes: int) -> Matrix:
        return np.pad(array, [(0, 0)] * (array.ndim - axes) + [(0, extra)] * axes)

    return GimbalModel(pad(model.transition, 2), *(pad(array, 1) for array in model[1:]))


def rest_state(model: GimbalModel, command: Array) -> Array:
    """Return the state at rest under a constant command.

    Args:
      model: the gimbal.
      command: pitch and yaw command [rad], shape B + (2,).

    Returns:
      State, shape B + (2, m).
    """
    command = command[..., None]
    return lift(model.rest, command) * command


def advance(model: GimbalModel, state: Array, command: Array) -> Array:
    """Advance both axes by one decision period under a held command.

    Args:
      model: the gimbal.
      state: shape B + (2, m).
      command: pitch and yaw command [rad], shape B + (2,).

    Returns:
      State at the end of the period, shape B + (2, m).
    """
    xp = namespace(state, command)
    # A sum of products, not a matrix product: batched 6 × 6 products are slow, this fuses.
    past, command = state[..., None, :], command[..., None]
    return xp.sum(lift(model.transition, past) * past, axis=-1) + lift(model.input, state) * command


def gimbal_angle(model: GimbalModel, state: Array) -> Array:
    """Return pitch and yaw [rad], shape B + (2,)."""
    return namespace(state).sum(lift(model.angle, state) * state, axis=-1)


def gimbal_rate(model: GimbalModel, state: Array) -> Array:
    """Return the rates of pitch and yaw over the last tick [rad/s], shape B + (2,)."""
    return namespace(state).sum(lift(model.rate, state) * state, axis=-1)

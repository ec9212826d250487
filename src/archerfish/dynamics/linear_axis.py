"""Two linear gimbal axes, eq (11) and eq (14), under commands held for a decision period.

    x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]

Over n ticks with held commands this is one matrix product, exact: the n-step matrices are computed in float64, so no
loop over ticks is left. The state of an axis holds, beside x, the past commands that the delay still needs and the
rate at the end of the period, so that one product advances everything.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.errors import InputError
from archerfish.records.json_files import Matrix
from archerfish.records.plant import PlantRecord

LATENCY_TICK_S = 1e-3
"""Latencies are rounded to no more than this where the plant allows it [s]."""


class GimbalModel(NamedTuple):
    """Both axes over one decision period; index 0 is pitch, 1 is yaw; leading batch dimensions for plant draws."""

    transition: Array  # state to state, (..., 2, m, m)
    input: Array  # held command to state, (..., 2, m)
    angle: Array  # state to angle [rad], (..., 2, m)
    rate: Array  # state to rate [rad/s], (..., 2, m)
    rest: Array  # state at rest per unit of command, (..., 2, m)


class LinearAxis(NamedTuple):
    """One axis, from its command to its angle, or its k posterior draws: B is () or (k,)."""

    a: Matrix  # B + (n, n)
    b: Matrix  # B + (n,)
    c: Matrix  # B + (n,)
    d: Array  # B
    delay: Array  # [samples], B
    period_s: float  # of sampling [s]


def gimbal_model(pitch: PlantRecord, yaw: PlantRecord, period_s: float, latency_s: float = 0.0) -> GimbalModel:
    """Build the model of a gimbal for decisions every `period_s`, the best estimate, shape (2, ...).

    Args:
      pitch: plant of the pitch axis, one input; of several outputs the first is its angle.
      yaw: plant of the yaw axis, likewise.
      period_s: decision period [s], a multiple of both sampling periods.
      latency_s: by which commands come late, before the delays of the plants [s]; rounded to a millisecond where the
        plant allows it.

    Raises:
      InputError: if the period is no multiple of a sampling period, or a plant has several inputs.
    """
    axes = [axis_of(plant) for plant in (pitch, yaw)]
    if latency_s:
        axes = [refined(axis) for axis in axes]
        axes = [axis._replace(delay=axis.delay + round(latency_s / axis.period_s)) for axis in axes]
    return _stack([_period_model(scaled(axis), period_s) for axis in axes])


def gimbal_draws(pitch: PlantRecord, yaw: PlantRecord, period_s: float) -> GimbalModel:
    """Build the models of all posterior draws, shape (k, 2, ...); arguments and errors as of `gimbal_model`."""
    models = [
        _stack([_period_model(LinearAxis(*draw, axis.period_s), period_s) for draw in zip(*axis[:-1], strict=True)])
        for axis in map(scaled, axis_draws(pitch, yaw))
    ]
    return _stack(models, place=1)


def axis_of(plant: PlantRecord) -> LinearAxis:
    """Return the axis of a plant with one input; of several outputs the first is the angle."""
    if plant.B.shape[1] != 1:
        raise InputError(f"a gimbal axis must have one input, got {plant.B.shape[1]}; identify it with one input")
    return LinearAxis(plant.A, plant.B[:, 0], plant.C[0], plant.D[0, 0], plant.delay_samples, plant.sample_period_s)


def axis_draws(pitch: PlantRecord, yaw: PlantRecord) -> list[LinearAxis]:
    """Return the k posterior draws of pitch and yaw.

    The best estimate of an axis without draws is repeated; of unequal numbers of draws the smaller one counts.
    """
    axes = []
    for plant in (pitch, yaw):
        *best, period_s = axis_of(plant)
        draws, delays = plant.draws, plant.delays_of_draws()
        fields: list[Any] = [np.asarray(field)[None] for field in best]
        if len(delays):
            fields = [draws["A"], draws["B"][:, :, 0], draws["C"][:, 0], draws["D"][:, 0, 0], delays]
        axes.append(LinearAxis._make((*fields, period_s)))
    count = min((len(axis.a) for axis in axes if len(axis.a) > 1), default=1)
    chosen = []
    for axis in axes:
        fields = [field[np.arange(count) % len(field)] for field in axis[:-1]]
        chosen.append(LinearAxis._make((*fields, axis.period_s)))
    return chosen


def _period_model(axis: LinearAxis, period_s: float) -> GimbalModel:
    """Build the model of one axis, B = (), without the leading dimension of the two axes.

    A delay of d = q n + r ticks (r < n) lets the command of q + 1 periods ago act for r ticks and that of q periods ago
    for the other n − r.
    """
    ticks = ticks_per_period(axis, period_s)
    a, b, c, d = axis[:4]
    order = len(a)
    whole, part = divmod(int(axis.delay), ticks)
    size = order + whole + 2  # x, the commands of the last whole + 1 periods, the rate
    # The command in force during the last n − r ticks, and the one before it, as rows over (state, new command).
    commands = np.zeros((whole + 2, size + 1))
    commands[0, -1] = 1.0
    commands[np.arange(1, whole + 2), order + np.arange(whole + 1)] = 1.0
    after, outputs = np.eye(order, size + 1), []
    for tick in range(ticks):
        in_force = commands[whole if tick >= part else whole + 1]
        after = a @ after + np.outer(b, in_force)
        outputs.append(c @ after + d * in_force)
    # With one tick a period the output before it is that of the last period: the feedthrough used its last command.
    before = np.eye(order, size + 1)
    earlier = outputs[-2] if ticks > 1 else c @ before + d * commands[whole + 1]
    output = c @ after + d * commands[whole]
    rows = np.vstack([after, commands[: whole + 1], (output - earlier) / axis.period_s])
    transition, into = rows[:, :-1], rows[:, -1]
    angle, rate = np.zeros(size), np.zeros(size)
    angle[:order], angle[order + whole] = c, d
    rate[-1] = 1.0
    return GimbalModel(transition, into, angle, rate, np.linalg.solve(np.eye(size) - transition, into))


def ticks_per_period(axis: LinearAxis, period_s: float) -> int:
    """Return the samples of an axis in a decision period.

    Raises:
      InputError: if the period is no multiple of the sampling period.
    """
    ratio = period_s / axis.period_s
    if abs(ratio - round(ratio)) > 1e-6 * ratio or round(ratio) < 1:
        raise InputError(
            f"period_s must be a multiple of the plant's sampling period {axis.period_s} s, got {period_s} s; "
            f"choose another period, or identify the axis with divides_s={period_s:g}"
        )
    return round(ratio)


def scaled(axis: LinearAxis) -> LinearAxis:
    """Return an axis with its states scaled by their peaks in the step response: entries of order one for float32."""
    state = peak = 0.0 * axis.b
    for _ in range(2000):
        state = np.vecdot(axis.a, state[..., None, :]) + axis.b
        peak = np.maximum(peak, np.abs(state))
    scale = np.where(peak > 0, peak, 1.0)
    return axis._replace(a=axis.a * scale[..., None, :] / scale[..., None], b=axis.b / scale, c=axis.c * scale)


def padded(array: Array, states: int, size: int) -> Matrix:
    """Pad the last axes of an array, as many as `states`, with zeros to the size of a larger state, B + (size, ...)."""
    return np.pad(array, [(0, 0)] * (array.ndim - states) + [(0, size - array.shape[-1])] * states)


def _stack(models: Sequence[GimbalModel], place: int = 0) -> GimbalModel:
    size = max(model.input.shape[-1] for model in models)
    axes_of_state = GimbalModel(transition=2, input=1, angle=1, rate=1, rest=1)
    stacked = []
    for states, arrays in zip(axes_of_state, zip(*models, strict=True), strict=True):
        stacked.append(np.stack([padded(array, states, size) for array in arrays], axis=place))
    return GimbalModel(*stacked)


def refined(axis: LinearAxis, tick_s: float = LATENCY_TICK_S) -> LinearAxis:
    """Return the same axis with a shorter sampling period.

    Commands that are held over the longer period give the same angles at its ends.

    The matrix [[A, B], [0, 1]] of a held command has a root, that of the shorter period. A plant with a pole on the
    negative real axis has none; the axis comes back as it is if that holds for any of its draws.

    Args:
      axis: the axis.
      tick_s: wanted period [s]; the largest one not above it that divides the axis' is taken.
    """
    parts = int(np.ceil(axis.period_s / tick_s - 1e-6))
    poles = np.linalg.eigvals(axis.a)
    if parts < 2 or np.any((np.abs(poles.imag) < 1e-9) & (poles.real <= 0.0)):
        return axis
    held = np.concat([axis.a, axis.b[..., None]], axis=-1)
    held = np.concat([held, 0.0 * held[..., :1, :]], axis=-2)
    held[..., -1, -1] = 1.0
    # Of the square root, whose eigenvalues are in the right half-plane, where the iteration for any root converges.
    half = _root(_root(held, 2), parts)
    finer = half @ half
    return axis._replace(
        a=finer[..., :-1, :-1], b=finer[..., :-1, -1], delay=axis.delay * parts, period_s=axis.period_s / parts
    )


def _root(matrix: Matrix, degree: int) -> Matrix:
    """Return the principal root of matrices by the coupled Newton iteration (Iannazzo 2006), B + (n, n)."""
    one = np.eye(matrix.shape[-1])
    root, rest = one, matrix
    for _ in range(60):
        step = ((degree - 1) * one + rest) / degree
        root, rest = root @ step, np.linalg.matrix_power(np.linalg.inv(step), degree) @ rest
    return root


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


def angle_then(past: Array, age: Array, period: Array) -> Array:
    """Interpolate the angles of a time ago: cubic Hermite pieces between decisions.

    Args:
      past: angles [rad] and rates [rad/s] now and at the decisions before, latest first, shape B + (H, 2, 2).
      age: how long ago [s]; more than H − 1 decisions count as that many, shape B.
      period: between decisions [s], shape ().

    Returns:
      Pitch and yaw [rad], shape B + (2,).
    """
    xp = namespace(past, age)
    count = past.shape[-3]
    ago = xp.clip(age / period, 0.0, count - 1.0)[..., None]
    offset = lift(xp.arange(count, dtype=past.dtype), ago) - ago
    gap = xp.minimum(xp.abs(offset), 1.0)
    weights = xp.stack([1.0 + 2.0 * gap, period * offset], axis=-1) * ((1.0 - gap) ** 2)[..., None]
    return xp.sum(weights[..., None] * past, axis=(-3, -2))

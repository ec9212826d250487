"""Two linear gimbal axes under commands held for a decision period, eqs (11)–(16).

    x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]

Over n ticks with held commands this is one matrix product, exact: the n-step matrices are computed in float64, so no
loop over ticks is left. The state of an axis holds, beside x, the past commands that the delay still needs and the
rate at the end of the period, so that one product advances everything.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord

Matrix = NDArray[np.float64]

LATENCY_TICK_S = 1e-3
"""Latencies are rounded to no more than this where the plant allows it [s]."""


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


def gimbal_model(pitch: PlantRecord, yaw: PlantRecord, period_s: float, latency_s: float = 0.0) -> GimbalModel:
    """Build the model of a gimbal for decisions every `period_s`.

    Args:
      pitch: plant of the pitch axis, one input; of several outputs the first is its angle.
      yaw: plant of the yaw axis, likewise.
      period_s: decision period [s], a multiple of both sampling periods.
      latency_s: by which commands come late, before the delays of the plants [s]; rounded to a millisecond where the
        plant allows it.

    Returns:
      The best estimate, shape (2, ...). `gimbal_draws` gives the posterior.

    Raises:
      InputError: if the period is no multiple of a sampling period, or a plant has several inputs or outputs.
    """
    return _stack([period_model(_later(plant, latency_s), period_s) for plant in (pitch, yaw)], axis=0)


def gimbal_draws(pitch: PlantRecord, yaw: PlantRecord, period_s: float) -> GimbalModel | None:
    """Build the models of all posterior draws, shape (k, 2, ...), or None where a record has no draws."""
    if not pitch.draws or not yaw.draws:
        return None
    pairs = zip(plant_draws(pitch), plant_draws(yaw), strict=False)
    return _stack([_stack([period_model(plant, period_s) for plant in pair], axis=0) for pair in pairs], axis=0)


def plant_draws(plant: PlantRecord) -> list[PlantRecord]:
    """Return the posterior draws of a plant as plants, or the plant itself where it has none."""
    if not plant.draws:
        return [plant]
    delays = plant.delays_of_draws()
    return [
        PlantRecord(
            **{name: draws[index] for name, draws in plant.draws.items()},
            delay_samples=int(delays[index]),
            sample_period_s=plant.sample_period_s,
        )
        for index in range(len(plant.draws["A"]))
    ]


def _later(plant: PlantRecord, latency_s: float) -> PlantRecord:
    if latency_s == 0.0:
        return plant
    plant = refined(plant, LATENCY_TICK_S)
    return replace(plant, delay_samples=plant.delay_samples + round(latency_s / plant.sample_period_s))


def period_model(plant: PlantRecord, period_s: float) -> GimbalModel:
    """Build the model of one axis, without the leading dimension of the two axes.

    A delay of d = q n + r ticks (r < n) lets the command of q + 1 periods ago act for r ticks and that of q periods ago
    for the other n − r.
    """
    ticks = ticks_per_period(plant, period_s)
    a, b, c, d = scaled_matrices(plant)
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


def ticks_per_period(plant: PlantRecord, period_s: float) -> int:
    """Return the samples of a plant in a decision period.

    Raises:
      InputError: if the period is no multiple of the sampling period, or the plant has several inputs.
    """
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


def scaled_matrices(plant: PlantRecord) -> tuple[Matrix, Matrix, Matrix, float]:
    """Return A, B, C and D of one input and the first output, its states scaled by their peaks in the step response.

    Entries of order one keep float32 accurate. Shapes (n, n), (n,), (n,) and ().
    """
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


class RampResponse(NamedTuple):
    """How angles follow commands that change at a constant rate, once settled: gain × the command of `lead` ago."""

    gain: Array
    """Steady gain of pitch and yaw, shape (2,)."""
    lead: Array
    """From a decision back to the command whose angle the gimbal has at the end of the decision's period, and that
    period: how far commands must lead so that pellets do [s], shape (2,)."""


def ramp_response(model: GimbalModel, period_s: float) -> RampResponse:
    """Return how a gimbal follows commands that change at a constant rate.

    With x' = A x + b u and y = c x', a command u = k settles at y = g (k + 1 − l), where g = c (I − A)⁻¹ b and
    g l = c (I − A)⁻² b.

    Args:
      model: the gimbal, shape (2, ...), stable.
      period_s: of its decisions [s].
    """
    rest = np.linalg.solve(np.eye(model.transition.shape[-1]) - model.transition, model.input[..., None])
    behind = np.linalg.solve(np.eye(model.transition.shape[-1]) - model.transition, rest)
    gain, late = ((model.angle * each[..., 0]).sum(-1) for each in (rest, behind))
    return RampResponse(gain, period_s * late / gain)


def refined(plant: PlantRecord, tick_s: float) -> PlantRecord:
    """Return the same plant, without its draws, with a shorter sampling period.

    Commands that are held over the longer period give the same angles at its ends.

    The matrix [[A, B], [0, 1]] of a held command has a logarithm, the plant in continuous time, from which any other
    period follows. A plant with a pole on the negative real axis has none; it comes back as it is.

    Args:
      plant: one input.
      tick_s: wanted period [s]; the largest one not above it that divides the plant's is taken.
    """
    parts = int(np.ceil(plant.sample_period_s / tick_s - 1e-6))
    poles = np.linalg.eigvals(plant.A)
    if parts < 2 or np.any((np.abs(poles.imag) < 1e-9) & (poles.real <= 0.0)):
        return plant
    order = len(plant.A)
    held = np.block([[plant.A, plant.B], [np.zeros((1, order)), np.eye(1)]])
    finer = np.real(expm(np.real(logm(held)) / parts))
    return replace(
        plant,
        A=finer[:order, :order],
        B=finer[:order, order:],
        delay_samples=plant.delay_samples * parts,
        sample_period_s=plant.sample_period_s / parts,
        draws={},
        draw_delays=np.zeros(0, np.int64),
    )

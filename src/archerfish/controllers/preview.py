"""The commands that bring a linear gimbal onto a given path of angles: a quadratic programme over a horizon.

    min_u  ½ ‖y − r‖² + ½ s ‖Δu‖²,   y = free response + M u,   subject to bounds on u, on its rate and acceleration

The bounds enter as rows L u = (u, Δu, Δ²u). The programme runs as a fixed number of ADMM iterations from the unbounded
optimum, so where no bound acts the result is exact, and the work is the same for every member of a batch.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, namespace, repeat
from archerfish.dynamics.command_limits import NEVER, CommandLimits
from archerfish.dynamics.linear_axis import GimbalModel

Rows = tuple[Array, Array, Array]
"""Of L u: u, Δu and Δ²u."""


class Preview(NamedTuple):
    """Matrices of the programme for both axes (index 0 pitch, 1 yaw) over N decisions."""

    response: Array
    """M: commands to angles at the ends of the periods, shape (2, N, N)."""
    free: Array
    """State to those angles without commands, shape (2, N, m)."""
    optimum: Array
    """Right-hand side to the unbounded optimum, shape (2, N, N)."""
    inverse: Array
    """(H + Lᵀ ρ L)⁻¹, shape (2, N, N)."""
    penalty: Array
    """ρ of the rows of L, as (u, Δu, Δ²u), shape (2, 3)."""
    smoothing: Array
    """s, shape (2,)."""
    limits: CommandLimits
    """The bounds."""
    period: Array
    """Decision period [s], shape ()."""


def make_preview(model: GimbalModel, limits: CommandLimits, period_s: float, horizon: int, smoothing: float) -> Preview:
    """Build the programme.

    Args:
      model: the gimbal, shape (2, ...), float64.
      limits: what may be asked.
      period_s: decision period [s].
      horizon: N decisions.
      smoothing: weight s of the changes of the command.
    """
    response, free = zip(*(_responses(model, axis, horizon) for axis in range(2)), strict=True)
    differences = [np.eye(horizon), _difference(horizon, 1), _difference(horizon, 2)]
    penalties, optima, inverses = [], [], []
    for axis, matrix in enumerate(response):
        hessian = matrix.T @ matrix + smoothing * differences[1].T @ differences[1]
        scale = np.trace(hessian) / horizon
        acts = [True, limits.max_rate[axis] < NEVER, limits.max_acceleration[axis] < NEVER]
        # A row's penalty follows the size of what it bounds; rows that never act get none.
        penalty = scale * np.array([0.3, 3.0, 30.0]) * acts
        bounded = hessian + sum(p * d.T @ d for p, d in zip(penalty, differences, strict=True))
        penalties.append(penalty)
        optima.append(np.linalg.inv(hessian))
        inverses.append(np.linalg.inv(bounded))
    return Preview(
        np.array(response),
        np.array(free),
        np.array(optima),
        np.array(inverses),
        np.array(penalties),
        np.full(2, smoothing),
        limits,
        np.asarray(period_s),
    )


def _responses(model: GimbalModel, axis: int, horizon: int) -> tuple[Array, Array]:
    transition, angle = model.transition[axis], model.angle[axis]
    row, free, impulse = angle, [], []
    for _ in range(horizon):
        impulse.append(row @ model.input[axis])
        row = row @ transition
        free.append(row)
    lag = np.arange(horizon)[:, None] - np.arange(horizon)
    return np.where(lag >= 0, np.array(impulse)[np.maximum(lag, 0)], 0.0), np.array(free)


def _difference(size: int, order: int) -> Array:
    matrix = np.eye(size)
    for _ in range(order):
        matrix = matrix - np.vstack([np.zeros(size), matrix[:-1]])
    return matrix


def track_path(
    preview: Preview,
    state: Array,
    command: Array,
    command_rate: Array,
    path: Array,
    sight: Array,
    iterations: int = 40,
    relaxation: float = 1.0,
    along: int = 0,
) -> Array:
    """Solve for the commands of the horizon.

    Args:
      preview: the programme.
      state: of the axes, shape B + (2, m).
      command: in force now [rad], shape B + (2,).
      command_rate: rate at which it was reached [rad/s], shape B + (2,).
      path: wanted angles at the ends of the periods [rad], shape B + (N, 2).
      sight: predicted line of sight at the decisions [rad], shape B + (N, 2).
      iterations: of ADMM.
      relaxation: over-relaxation of ADMM, 1 (none) to below 2; it pays where there are hundreds of iterations.
      along: axis of the horizon in the iterations. First (0) is quickest, since a loop over a batch is long; last (−1)
        rounds alike in batches of any size, which matters to ill-conditioned programmes of hundreds of iterations.

    Returns:
      Commands [rad], shape B + (N, 2).
    """
    axes = [
        _track_axis(
            preview,
            axis,
            state[..., axis, :],
            command[..., axis],
            command_rate[..., axis],
            path[..., axis],
            sight[..., axis],
            iterations,
            relaxation,
            along,
        )
        for axis in range(2)
    ]
    return namespace(path).stack(axes, axis=-1)


def _track_axis(
    preview: Preview,
    axis: int,
    state: Array,
    command: Array,
    command_rate: Array,
    path: Array,
    sight: Array,
    iterations: int,
    relaxation: float,
    along: int,
) -> Array:
    error = path - state @ preview.free[axis].T
    right = error @ preview.response[axis]
    xp = namespace(right)
    right = xp.concat([right[..., :1] + preview.smoothing[axis] * command[..., None], right[..., 1:]], axis=-1)
    bounds = command_bounds(preview, axis, command, command_rate, sight)
    # Three kinds of rows as three arrays: compiled, most of an iteration would go into stacking them.
    low, high = (tuple(xp.moveaxis(each[..., kind, :], -1, along) for kind in range(3)) for each in bounds)
    penalty = tuple(preview.penalty[axis])
    turned, unbounded = (xp.moveaxis(each, -1, along) for each in (right, right @ preview.optimum[axis]))

    def improve(variables: tuple[Array, Rows]) -> tuple[Array, Rows]:
        _, rows = variables  # with their duals, which are what the bounds cut off
        kept = tuple(xp.clip(*each) for each in zip(rows, low, high, strict=True))
        pulls = (share * (2.0 * inside - row) for share, inside, row in zip(penalty, kept, rows, strict=True))
        # Added before the product: the two cancel, and the inverse may be large.
        pulled = xp.moveaxis(turned + _commands_of(pulls, along), along, -1)
        commands = xp.moveaxis(pulled @ preview.inverse[axis], -1, along)
        unbound = _rows_of(commands, along)
        return commands, tuple(
            relaxation * (new - inside) + row for new, inside, row in zip(unbound, kept, rows, strict=True)
        )

    return xp.moveaxis(repeat(improve, iterations, (unbounded, _rows_of(unbounded, along)))[0], along, -1)


def command_rows(commands: Array) -> Array:
    """L u: the commands, their differences and second differences, zero before the first; B + (N,) → B + (3, N)."""
    return namespace(commands).stack(_rows_of(commands, along=-1), axis=-2)


def rows_to_commands(rows: Array) -> Array:
    """Lᵀ applied to rows, shape B + (3, N) → B + (N,)."""
    return _commands_of((rows[..., kind, :] for kind in range(3)), along=-1)


def _rows_of(commands: Array, along: int) -> Rows:
    """L u, the three kinds of rows apart."""
    first = _differ(commands, along)
    return commands, first, _differ(first, along)


def _commands_of(rows: Iterable[Array], along: int) -> Array:
    """Lᵀ applied to the three kinds of rows."""
    commands, first, second = rows
    return commands + _differ_back(first + _differ_back(second, along), along)


def _differ(series: Array, along: int) -> Array:
    xp = namespace(series)
    return xp.diff(series, axis=along, prepend=xp.zeros((), dtype=series.dtype))


def _differ_back(series: Array, along: int) -> Array:
    xp = namespace(series)
    return -xp.diff(series, axis=along, append=xp.zeros((), dtype=series.dtype))


def command_bounds(
    preview: Preview, axis: int, command: Array, command_rate: Array, sight: Array
) -> tuple[Array, Array]:
    """Bounds of the rows L u of one axis, shape B + (3, N) each; the first rows count from the command in force."""
    xp = namespace(command, sight)
    limits, period = preview.limits, preview.period
    zero = 0.0 * sight
    low = xp.maximum(sight - limits.max_lead[axis], limits.low[axis])
    high = xp.minimum(sight + limits.max_lead[axis], limits.high[axis])
    first = command[..., None]
    step = command_rate[..., None] * period
    shift_1 = xp.concat([first, zero[..., 1:]], axis=-1)
    shift_2 = xp.concat([first + step, -first, zero[..., 2:]], axis=-1)
    rate = limits.max_rate[axis] * period
    change = limits.max_acceleration[axis] * period**2
    return (
        xp.stack([low, shift_1 - rate, shift_2 - change], axis=-2),
        xp.stack([high, shift_1 + rate, shift_2 + change], axis=-2),
    )

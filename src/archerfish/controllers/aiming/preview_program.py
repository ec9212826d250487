"""The commands that bring a linear gimbal onto a given path of angles: a quadratic program over a horizon.

    min_u  ½ ‖y − r‖² + ½ s ‖Δu‖²,   y = free response + M u,   subject to bounds on u, on its rate and acceleration

The bounds enter as rows L u = (u, Δu, Δ²u). The program is solved by a fixed number of ADMM iterations from the
unbounded optimum, so where no bound acts the result is exact, and the work is the same for every member of a batch.
"""

from collections.abc import Iterable

import numpy as np

from archerfish.arrays import Array, lift, namespace, repeat, tree
from archerfish.dynamics.command_limits import NEVER, CommandLimits
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.protocols import Base

RowsLu = tuple[Array, ...]
"""Of L u: u, Δu and Δ²u."""


@tree(static=("iterations", "relaxation", "along"))
class Preview:
    """Matrices of the program for both axes (index 0 pitch, 1 yaw) over N decisions."""

    response: Array  # M: commands to angles at the ends of the periods, (2, N, N)
    free: Array  # state to those angles without commands, (2, N, m)
    optimum: Array  # right-hand side to the unbounded optimum, (2, N, N)
    inverse: Array  # (H + Lᵀ ρ L)⁻¹, (2, N, N)
    penalty: Array  # ρ of the rows of L, as (u, Δu, Δ²u), (2, 3)
    smoothing: Array  # s, (2,)
    limits: CommandLimits  # the bounds, in the frame of the base
    period: Array  # decision period [s], ()
    iterations: int = 40  # of ADMM
    relaxation: float = 1.0  # over-relaxation of ADMM, 1 (none) to below 2; it pays in hundreds of iterations
    along: int = 0  # axis of the horizon in the iterations. First (0) is quickest, since a loop over a batch is long;
    #                 last (−1) rounds alike in batches of any size, which matters to ill-conditioned programs of
    #                 hundreds of iterations.

    def track(self, state: Array, command: Array, command_rate: Array, path: Array, base_yaw: Array) -> Array:
        """Solve for the commands of the horizon.

        Args:
          state: of the axes, shape B + (2, m).
          command: in force now [rad], shape B + (2,).
          command_rate: rate at which it was reached [rad/s], shape B + (2,).
          path: wanted angles at the ends of the periods [rad], shape B + (N, 2).
          base_yaw: yaw of the base then, see `base_yaw` [rad], shape B + (N,).

        Returns:
          Commands [rad], shape B + (N, 2).
        """
        xp, along = namespace(path), self.along

        def solve(axis: int) -> Array:
            error = path[..., axis] - state[..., axis, :] @ self.free[axis].T
            right = error @ self.response[axis]
            now = command[..., axis]
            right = xp.concat([right[..., :1] + self.smoothing[axis] * now[..., None], right[..., 1:]], axis=-1)
            low, high = self.bounds(axis, now, command_rate[..., axis], base_yaw)
            # Three kinds of rows as three arrays: compiled, most of an iteration would go into stacking them.
            low = tuple(xp.moveaxis(row, -1, along) for row in low)
            high = tuple(xp.moveaxis(row, -1, along) for row in high)
            penalty = tuple(self.penalty[axis])
            turned, unbounded = xp.moveaxis(right, -1, along), xp.moveaxis(right @ self.optimum[axis], -1, along)

            def improve(variables: tuple[Array, RowsLu]) -> tuple[Array, RowsLu]:
                _, rows = variables  # with their duals, which are what the bounds cut off
                kept = tuple(map(xp.clip, rows, low, high))
                pulls = (share * (2.0 * inside - row) for share, inside, row in zip(penalty, kept, rows, strict=True))
                # Added before the product: the two cancel, and the inverse may be large.
                pulled = xp.moveaxis(turned + commands_of(pulls, along), along, -1)
                commands = xp.moveaxis(pulled @ self.inverse[axis], -1, along)
                unbound = zip(rows_of(commands, along), kept, rows, strict=True)
                return commands, tuple(self.relaxation * (new - inside) + row for new, inside, row in unbound)

            return xp.moveaxis(repeat(improve, self.iterations, (unbounded, rows_of(unbounded, along)))[0], along, -1)

        return xp.stack([solve(0), solve(1)], axis=-1)

    def bounds(self, axis: int, command: Array, command_rate: Array, base_yaw: Array) -> tuple[RowsLu, RowsLu]:
        """Return the bounds of the rows L u of one axis, B + (N,) each; the first count from the command in force.

        Args:
          axis: 0 pitch, 1 yaw.
          command: of that axis, in force now [rad], shape B.
          command_rate: rate at which it was reached [rad/s], shape B.
          base_yaw: yaw of the base at the ends of the periods [rad], shape B + (N,); the range of the yaw follows it.
        """
        xp, limits, period = namespace(command, base_yaw), self.limits, self.period
        zero, first, step = 0.0 * base_yaw, command[..., None], command_rate[..., None] * period
        begin = xp.concat([first, zero[..., 1:]], axis=-1)
        begin_2 = xp.concat([first + step, -first, zero[..., 2:]], axis=-1)
        rate, change = limits.max_rate[axis] * period, limits.max_acceleration[axis] * period**2
        turned = base_yaw if axis else zero
        low = turned + limits.low[axis], begin - rate, begin_2 - change
        return low, (turned + limits.high[axis], begin + rate, begin_2 + change)

    def base_yaw(self, base: Base, count: int) -> Array:
        """Return the yaw of a base that turns on at its rate, at the ends of the coming periods.

        Args:
          base: now, shape B.
          count: of the periods.

        Returns:
          Yaw [rad], shape B + (count,).
        """
        yaw, rate = base.yaw[..., None], base.yaw_rate[..., None]
        return yaw + lift(namespace(yaw).arange(1, count + 1, dtype=yaw.dtype), yaw) * self.period * rate


def make_preview(model: GimbalModel, limits: CommandLimits, period_s: float, horizon: int, smoothing: float) -> Preview:
    """Build the program.

    Args:
      model: the gimbal, shape (2, ...), float64.
      limits: of the commands.
      period_s: decision period [s].
      horizon: N decisions.
      smoothing: weight s of the changes of the command.
    """
    differences, matrices = row_matrices(horizon), []
    for axis in range(2):
        response, free = _responses(model, axis, horizon)
        hessian = response.T @ response + smoothing * differences[1].T @ differences[1]
        acts = [True, limits.max_rate[axis] < NEVER, limits.max_acceleration[axis] < NEVER]
        # A row's penalty follows the size of what it bounds; rows that never act get none.
        penalty = np.trace(hessian) / horizon * np.array([0.3, 3.0, 30.0]) * acts
        bounded = hessian + bounding(penalty, horizon)
        matrices.append((response, free, np.linalg.inv(hessian), np.linalg.inv(bounded), penalty))
    response, free, optimum, inverse, penalty = (np.array(axes) for axes in zip(*matrices, strict=True))
    return Preview(response, free, optimum, inverse, penalty, np.full(2, smoothing), limits, np.asarray(period_s))


def row_matrices(horizon: int) -> tuple[Array, Array, Array]:
    """Return L as matrices of the three kinds of rows, (N, N) each."""
    difference = np.eye(horizon) - np.eye(horizon, k=-1)
    return np.eye(horizon), difference, difference @ difference


def bounding(penalty: Array, horizon: int) -> Array:
    """Return Lᵀ ρ L, shape (N, N), of a penalty ρ of shape (3,)."""
    return sum(p * d.T @ d for p, d in zip(penalty, row_matrices(horizon), strict=True))


def _responses(model: GimbalModel, axis: int, horizon: int) -> tuple[Array, Array]:
    rows = [model.angle[axis]]
    for _ in range(horizon):
        rows.append(rows[-1] @ model.transition[axis])
    impulse = np.array([row @ model.input[axis] for row in rows[:-1]])
    lag = np.arange(horizon)[:, None] - np.arange(horizon)
    return np.where(lag >= 0, impulse[np.maximum(lag, 0)], 0.0), np.array(rows[1:])


def rows_of(commands: Array, along: int = -1) -> RowsLu:
    """Return L u: commands, shape (..., N, ...), their differences and second differences, zero before the first.

    Args:
      commands: u.
      along: axis of the N decisions.
    """
    first = _differ(commands, along)
    return commands, first, _differ(first, along)


def commands_of(rows: Iterable[Array], along: int = -1) -> Array:
    """Return Lᵀ applied to the three kinds of rows, of the shape of each; arguments as of `rows_of`."""
    commands, first, second = rows
    return commands + _differ_back(first + _differ_back(second, along), along)


def _differ(series: Array, along: int) -> Array:
    xp = namespace(series)
    return xp.diff(series, axis=along, prepend=xp.zeros((), dtype=series.dtype))


def _differ_back(series: Array, along: int) -> Array:
    xp = namespace(series)
    return -xp.diff(series, axis=along, append=xp.zeros((), dtype=series.dtype))

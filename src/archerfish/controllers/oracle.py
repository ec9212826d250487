"""The oracle: knows the target's path and the plant, and plans the whole engagement at once.

It is a strong heuristic, and so a lower bound on what a command limit allows; upper ones are proven (docs/bounds.md).
It looks for the commands, within the limits, that put the most shots on the armor. A sum of absolute angle errors, that
gives up the shots that slewing costs anyway, is minimised by ADMM; shots that miss are then weighted down and the rest
improved. One of the plans that it begins with is what a causal preview controller would fly, were it given the path. Of
all plans the one with the largest expected number of hits is flown.
"""

from typing import NamedTuple

import numpy as np

from archerfish.controllers.preview import (
    Preview,
    command_bounds,
    command_rows,
    make_preview,
    rows_to_commands,
    track_path,
)
from archerfish.controllers.preview_aim import HORIZON, SMOOTHING
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import Array, lift, map_arrays, namespace, repeat
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.linear_axis import GimbalModel, advance, rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always

ROUNDS = 3
"""Times that the weights are set anew."""
ITERATIONS = 150
"""Of ADMM, per round."""
LEAST_SQUARES_ITERATIONS = 1500
"""Of ADMM, for the plan to begin with."""
RELAXATION = 1.8
"""Over-relaxation of ADMM, between 1 (none) and 2: far slews need about half the iterations."""
MARGIN = 0.995
"""Share of the acceleration limit to plan with: ADMM leaves small excesses, and a plan cut off by the limit drifts."""
SHRINK = 0.1
"""Threshold of the absolute error in ADMM [rad]."""


class OracleState(NamedTuple):
    """The plan and how much of it is flown."""

    commands: Array
    """Shape B + (T, 2)."""
    step: Array
    """Shape ()."""


class Oracle(NamedTuple):
    """Knows everything but the dispersion draws; where plants differ between engagements, only their best estimate."""

    preview: Preview
    """Bounds and responses over the whole engagement."""
    tracking: Preview
    """The programme of a preview controller, over its horizon."""
    solve: Array
    """(MᵀM + Lᵀ ρ L)⁻¹ of the absolute errors' programme, shape (2, T, T)."""
    muzzle: Muzzle
    """For drop, drag, flight time and dispersion."""
    hit_radius: Array
    """Largest miss distance that hits [m], shape ()."""

    @property
    def needs_truth(self) -> bool:
        """The oracle alone is told the truth."""
        return True

    def reset(self, seen: Seen, truth: Truth | None = None) -> OracleState:
        """Plan the engagement.

        Raises:
          ValueError: if the truth is not given.
        """
        if truth is None:
            raise ValueError("the oracle needs the truth; a real robot can't give it")
        return OracleState(self._plan(seen, truth), namespace(seen.angle).asarray(0))

    def step(self, state: OracleState, seen: Seen) -> tuple[OracleState, Command]:  # noqa: ARG002
        """Fly the plan."""
        return OracleState(state.commands, state.step + 1), fire_always(state.commands[..., state.step, :])

    def _plan(self, seen: Seen, truth: Truth) -> Array:
        xp = namespace(seen.angle)
        count = self.preview.response.shape[-1]
        all_path, all_sight, all_distance = self._wanted(seen, truth)
        path, sight, distance = all_path[..., :count, :], all_sight[..., :count, :], all_distance[..., :count]
        state = rest_state(truth.gimbal, seen.command)
        least_squares = track_path(
            self.preview,
            state,
            seen.command,
            0.0 * seen.command,
            path,
            sight,
            LEAST_SQUARES_ITERATIONS,
            RELAXATION,
            along=-1,
        )
        tracked = self._track(seen, truth, all_path, all_sight)
        best, best_hits = least_squares, -1.0 + 0.0 * distance[..., 0]
        # Far slews converge better from no plan at all, near ones from least squares.
        for start in (least_squares, 0.0 * least_squares, tracked):
            plans = [_AxisPlan.begin(self, axis, start, path, sight, state, seen.command) for axis in range(2)]
            commands, hits, weight = self._judge(plans, distance)
            for _ in range(ROUNDS):
                better = hits > best_hits
                best, best_hits = xp.where(better[..., None, None], commands, best), xp.maximum(hits, best_hits)
                plans = [plan.improve(self, axis, weight) for axis, plan in enumerate(plans)]
                commands, hits, weight = self._judge(plans, distance)
            best = xp.where((hits > best_hits)[..., None, None], commands, best)
            best_hits = xp.maximum(hits, best_hits)
        return best

    def _track(self, seen: Seen, truth: Truth, path: Array, sight: Array) -> Array:
        """Return the commands of a preview controller that knows the path, B + (T, 2)."""
        xp = namespace(path)
        count, horizon = self.preview.response.shape[-1], self.tracking.response.shape[-1]

        def step(flown: tuple[Array, ...]) -> tuple[Array, ...]:
            state, command, rate, path, sight, commands = flown
            wanted = track_path(self.tracking, state, command, rate, path[..., :horizon, :], sight[..., :horizon, :])[
                ..., 0, :
            ]
            limits, period = self.tracking.limits, self.tracking.period
            allowed = limit_command(limits, wanted, command, rate, sight[..., 0, :], period)
            state, rate = advance(truth.gimbal, state, allowed), (allowed - command) / period
            path, sight = (xp.concat([each[..., 1:, :], each[..., :1, :]], axis=-2) for each in (path, sight))
            return state, allowed, rate, path, sight, xp.concat([commands[..., 1:, :], allowed[..., None, :]], axis=-2)

        begun = rest_state(truth.gimbal, seen.command), seen.command, 0.0 * seen.command, path, sight
        flown: tuple[Array, ...] = repeat(step, count, (*begun, 0.0 * path[..., :count, :]))
        return flown[-1]

    def _judge(self, plans: list["_AxisPlan"], distance: Array) -> tuple[Array, Array, Array]:
        """Commands, expected hits, and weights that give up what misses by far."""
        xp = namespace(distance)
        errors = xp.stack([plan.errors(self, axis) for axis, plan in enumerate(plans)], axis=-1)
        miss = distance * xp.sqrt(xp.sum(errors**2, axis=-1))
        weight = 1.0 / (0.02 + (miss / self.hit_radius) ** 2)
        commands = xp.stack([plan.allowed() for plan in plans], axis=-1)
        return commands, self._expected_hits(miss, distance), weight / xp.max(weight, axis=-1, keepdims=True)

    def _wanted(self, seen: Seen, truth: Truth) -> tuple[Array, Array, Array]:
        """Angles at the shots, line of sight at the decisions, and range at the shots.

        Shapes B + (N, 2), B + (N, 2) and B + (N,), with the horizon of the preview controller after the T decisions.
        """
        xp = namespace(seen.angle)
        steps = self.preview.response.shape[-1] + self.tracking.response.shape[-1] - 1
        count = xp.reshape(xp.arange(steps, dtype=seen.angle.dtype), (-1,) + (1,) * seen.elapsed.ndim)
        starts = count * self.preview.period + 0.0 * seen.elapsed[None]
        motion = map_arrays(lambda each: each[None], truth.motion)
        aim = intercept(motion.position, starts + self.preview.period, self.muzzle)
        place = motion.position(starts + self.preview.period)
        distance = xp.sqrt(xp.sum(place**2, axis=-1))
        sight = line_of_sight(motion.position(starts))
        return xp.moveaxis(aim.angle, 0, -2), xp.moveaxis(sight, 0, -2), xp.moveaxis(distance, 0, -1)

    def _expected_hits(self, miss: Array, distance: Array) -> Array:
        """Sum over the shots of a smooth chance to hit: logistic in the margin over the dispersion."""
        xp = namespace(miss)
        spread = distance * xp.mean(self.muzzle.sd) + 1e-4
        margin = xp.clip(1.7 * (self.hit_radius - miss) / spread, -30.0, 30.0)
        return xp.sum(1.0 / (1.0 + xp.exp(-margin)), axis=-1)


class _AxisPlan(NamedTuple):
    """ADMM variables of one axis; N is the number of decisions."""

    wanted: Array  # path less free response, B + (N,)
    low: Array  # bounds of the rows L u, B + (3, N)
    high: Array
    commands: Array  # B + (N,)
    error: Array  # M u − wanted after the shrinkage, B + (N,)
    error_dual: Array
    rows: Array  # L u after the clipping, B + (3, N)
    rows_dual: Array

    @staticmethod
    def begin(
        oracle: Oracle, axis: int, plan: Array, path: Array, sight: Array, state: Array, command: Array
    ) -> "_AxisPlan":
        """Begin at a plan, shape B + (N, 2)."""
        preview = oracle.preview
        wanted = path[..., axis] - state[..., axis, :] @ preview.free[axis].T
        low, high = command_bounds(preview, axis, command[..., axis], 0.0 * command[..., axis], sight[..., axis])
        commands = plan[..., axis]
        error, rows = commands @ preview.response[axis].T - wanted, command_rows(commands)
        return _AxisPlan(wanted, low, high, commands, error, 0.0 * error, rows, 0.0 * rows)

    def improve(self, oracle: Oracle, axis: int, weight: Array) -> "_AxisPlan":
        """Run ADMM on Σ weight |M u − wanted| within the bounds."""
        xp = namespace(self.wanted)
        response = oracle.preview.response[axis]
        penalty = lift(oracle.preview.penalty[axis][:, None], self.rows)

        def iterate(plan: "_AxisPlan") -> "_AxisPlan":
            right = (self.wanted + plan.error - plan.error_dual) @ response
            right = right + rows_to_commands(penalty * (plan.rows - plan.rows_dual))
            commands = right @ oracle.solve[axis]
            missed = commands @ response.T - self.wanted
            residual = RELAXATION * missed + (1.0 - RELAXATION) * plan.error + plan.error_dual
            error = xp.sign(residual) * xp.maximum(xp.abs(residual) - SHRINK * weight, 0.0)
            asked = RELAXATION * command_rows(commands) + (1.0 - RELAXATION) * plan.rows + plan.rows_dual
            rows = xp.clip(asked, self.low, self.high)
            return plan._replace(
                commands=commands,
                error=error,
                error_dual=residual - error,
                rows=rows,
                rows_dual=asked - rows,
            )

        improved: _AxisPlan = repeat(iterate, ITERATIONS, self)
        return improved

    def allowed(self) -> Array:
        """Commands within the range, B + (N,)."""
        return namespace(self.commands).clip(self.commands, self.low[..., 0, :], self.high[..., 0, :])

    def errors(self, oracle: Oracle, axis: int) -> Array:
        """Angle errors of the allowed commands [rad], B + (N,)."""
        return self.allowed() @ oracle.preview.response[axis].T - self.wanted


def make_oracle(
    model: GimbalModel, muzzle: Muzzle, limits: CommandLimits, period_s: float, decisions: int, hit_radius: float
) -> Oracle:
    """Build the oracle for engagements of a number of decisions.

    Args:
      model: the plant, shape (2, ...), float64.
      muzzle: for drop, drag, flight time and dispersion.
      limits: what may be asked.
      period_s: decision period [s].
      decisions: T, length of an engagement.
      hit_radius: largest miss that is a hit [m].
    """
    planned = limits._replace(max_acceleration=limits.max_acceleration * MARGIN)
    preview = make_preview(model, planned, period_s, decisions, smoothing=1e-6)
    tracking = make_preview(model, limits, period_s, HORIZON, SMOOTHING)
    solve = [
        np.linalg.inv(preview.response[axis].T @ preview.response[axis] + _bounding(preview, axis, decisions))
        for axis in range(2)
    ]
    return Oracle(preview, tracking, np.array(solve), muzzle, np.asarray(hit_radius))


def _bounding(preview: Preview, axis: int, size: int) -> Array:
    rows = [np.eye(size)]
    for _ in range(2):
        rows.append(rows[-1] - np.vstack([np.zeros(size), rows[-1][:-1]]))
    return sum(p * d.T @ d for p, d in zip(preview.penalty[axis], rows, strict=True)) + 1e-9 * np.eye(size)

"""The oracle: has the target's path and the plant, and plans the whole engagement at once.

It is a strong heuristic, and so a lower bound on what a command limit allows. It looks for the commands, within the
limits, that put the most shots on the armor:

- ADMM minimises a weighted sum of absolute angle errors. Absolute errors give up the shots that are lost to slewing
  anyway, where squared ones would spend every other shot on them.
- The shots that still miss get smaller weights, and the others are improved. This is repeated.
- It starts from three plans: least squares, no command at all, and what a preview controller would command if it were
  given the path.
- Of all plans that come up, the one with the largest expected number of hits is taken.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, map_arrays, namespace, repeat, tree
from archerfish.controllers.aiming.preview_lq import HORIZON
from archerfish.controllers.aiming.preview_program import Preview, RowsLu, bounding, commands_of, make_preview, rows_of
from archerfish.controllers.tuning import SMOOTHING
from archerfish.dynamics.aiming import intercept
from archerfish.dynamics.command_limits import limit_command
from archerfish.dynamics.linear_axis import advance, rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.errors import InputError
from archerfish.protocols import Command, Seen, Truth, aim
from archerfish.robot import Robot
from archerfish.task import Task
from archerfish.tracking.detections import relative_place, unwrapped

REWEIGHTINGS, ADMM_ITERATIONS, LEAST_SQUARES_ITERATIONS = 3, 150, 1500
"""Times that the weights are set again, iterations of ADMM for each, and for the plan to begin with."""
RELAXATION = 1.8
"""Over-relaxation of ADMM, between 1 (none) and 2: far slews need about half the iterations."""
MARGIN = 0.995
"""Share of the acceleration limit to plan with: ADMM leaves small excesses, and a plan cut off by the limit drifts."""
SHRINK = 0.1
"""Threshold of the absolute error in ADMM [rad]."""


class OracleState(NamedTuple):
    """The plan and how much of it is done."""

    commands: Array  # [rad], B + (T, 2)
    step: Array  # ()


@tree()
class Oracle:
    """Is given all but the dispersion draws; where plants differ between engagements, it is given the best estimate."""

    preview: Preview  # bounds and responses over the whole engagement
    tracking: Preview  # the program of a preview controller, over its horizon
    solve: Array  # (MᵀM + Lᵀ ρ L)⁻¹ of the absolute errors' program, (2, T, T)
    muzzle: Muzzle  # for drop, drag, flight time and dispersion
    hit_radius: Array  # largest miss distance that hits [m], ()

    needs_truth = True

    def reset(self, seen: Seen, truth: Truth | None = None) -> OracleState:
        """Plan the engagement.

        Raises:
          InputError: if the truth is not given, or the target has several plates.
        """
        if truth is None:
            raise InputError("the oracle needs the truth, which only a simulator has; evaluate it in one")
        if truth.target.plates != 1:
            raise InputError(f"the oracle plans for one plate, got {truth.target.plates}; evaluate another controller")
        return OracleState(self._plan(seen, truth), namespace(seen.command).asarray(0))

    def step(self, state: OracleState, seen: Seen) -> tuple[OracleState, Command]:  # noqa: ARG002
        """Command the plan."""
        return OracleState(state.commands, state.step + 1), aim(state.commands[..., state.step, :])

    def _plan(self, seen: Seen, truth: Truth) -> Array:
        xp = namespace(seen.command)
        count = self.preview.response.shape[-1]
        ahead = self._wanted(seen, truth)
        path, distance, base_yaw = ahead[0][..., :count, :], ahead[1][..., :count], ahead[2][..., :count]
        state, command, still = rest_state(truth.gimbal, seen.command), seen.command, 0.0 * seen.command
        least_squares = self.preview.track(state, command, still, path, base_yaw)
        best, best_hits = least_squares, -1.0 + 0.0 * distance[..., 0]
        # Far slews converge better from no plan at all, near ones from least squares.
        for start in (least_squares, 0.0 * least_squares, self._track(command, truth, ahead[0], ahead[2])):
            plans, weight = [], 0.0 * distance
            for axis in range(2):
                wanted = path[..., axis] - state[..., axis, :] @ self.preview.free[axis].T
                low, high = self.preview.bounds(axis, command[..., axis], still[..., axis], base_yaw)
                commands = start[..., axis]
                error, rows = commands @ self.preview.response[axis].T - wanted, rows_of(commands)
                none = tuple(0.0 * row for row in rows)
                plans.append(_AxisPlan(wanted, low, high, commands, error, 0.0 * error, rows, none))
            for again in range(REWEIGHTINGS + 1):
                if again:
                    plans = [self._improve(axis, plan, weight) for axis, plan in enumerate(plans)]
                commands, hits, weight = self._judge(plans, distance)
                best = xp.where((hits > best_hits)[..., None, None], commands, best)
                best_hits = xp.maximum(hits, best_hits)
        return best

    def _wanted(self, seen: Seen, truth: Truth) -> tuple[Array, Array, Array]:
        """Angles, distance of the target and yaw of the base at the shots, B + (N, 2), B + (N,) and B + (N,).

        After the T decisions come those of the horizon of the preview controller.
        """
        xp = namespace(seen.command)
        steps = self.preview.response.shape[-1] + self.tracking.response.shape[-1] - 1
        count = xp.reshape(xp.arange(steps, dtype=seen.command.dtype), (-1,) + (1,) * seen.elapsed.ndim)
        shots = count * self.preview.period + 0.0 * seen.elapsed[None] + self.preview.period
        base = map_arrays(lambda array: array[None], seen.base)

        def position(time: Array) -> Array:
            return relative_place(truth.target.at(time).position[..., 0, :], base, time)

        angle = unwrapped(intercept(position, shots, self.muzzle).angle, seen.command[None])
        distance = xp.sqrt(xp.sum(position(shots) ** 2, axis=-1))
        return xp.moveaxis(angle, 0, -2), xp.moveaxis(distance, 0, -1), self.preview.base_yaw(seen.base, steps)

    def _track(self, command: Array, truth: Truth, path: Array, base_yaw: Array) -> Array:
        """Return the commands of a preview controller that is given the path, B + (T, 2)."""
        xp, (limits, period) = namespace(path), (self.tracking.limits, self.tracking.period)
        count, horizon = self.preview.response.shape[-1], self.tracking.response.shape[-1]
        yaw_alone = xp.asarray([0.0, 1.0], dtype=path.dtype)

        def step(before: tuple[Array, ...]) -> tuple[Array, ...]:
            state, command, rate, path, yaw, commands = before
            ask = self.tracking.track(state, command, rate, path[..., :horizon, :], yaw[..., :horizon])[..., 0, :]
            turn = yaw[..., :1] * lift(yaw_alone, ask)
            low, high = lift(limits.low, ask) + turn, lift(limits.high, ask) + turn
            allowed = limit_command(limits._replace(low=low, high=high), ask, command, rate, path[..., 0, :], period)
            state, rate = advance(truth.gimbal, state, allowed), (allowed - command) / period
            path, yaw = xp.roll(path, -1, axis=-2), xp.roll(yaw, -1, axis=-1)
            return state, allowed, rate, path, yaw, xp.concat([commands[..., 1:, :], allowed[..., None, :]], axis=-2)

        begun = rest_state(truth.gimbal, command), command, 0.0 * command, path, base_yaw, 0.0 * path[..., :count, :]
        return repeat(step, count, begun)[-1]

    def _judge(self, plans: list["_AxisPlan"], distance: Array) -> tuple[Array, Array, Array]:
        """Commands within the range, expected hits, and weights that give up what misses by far.

        A shot hits with a smooth probability: logistic in the margin over the dispersion.
        """
        xp = namespace(distance)
        allowed = [xp.clip(plan.commands, plan.low[0], plan.high[0]) for plan in plans]
        reached = zip(allowed, self.preview.response, plans, strict=True)
        errors = xp.stack([commands @ response.T - plan.wanted for commands, response, plan in reached], axis=-1)
        miss = distance * xp.sqrt(xp.sum(errors**2, axis=-1))
        weight = 1.0 / (0.02 + (miss / self.hit_radius) ** 2)
        spread = distance * xp.mean(self.muzzle.sd) + 1e-4
        margin = xp.clip(1.7 * (self.hit_radius - miss) / spread, -30.0, 30.0)
        hits = xp.sum(1.0 / (1.0 + xp.exp(-margin)), axis=-1)
        return xp.stack(allowed, axis=-1), hits, weight / xp.max(weight, axis=-1, keepdims=True)

    def _improve(self, axis: int, begun: "_AxisPlan", weight: Array) -> "_AxisPlan":
        """Run ADMM on Σ weight |M u − wanted| within the bounds."""
        xp = namespace(weight)
        response, penalty = self.preview.response[axis], tuple(self.preview.penalty[axis])

        def iterate(plan: "_AxisPlan") -> "_AxisPlan":
            right = (begun.wanted + plan.error - plan.error_dual) @ response
            pulls = zip(penalty, plan.rows, plan.rows_dual, strict=True)
            right = right + commands_of(share * (row - dual) for share, row, dual in pulls)
            commands = right @ self.solve[axis]
            missed = commands @ response.T - begun.wanted
            residual = RELAXATION * missed + (1.0 - RELAXATION) * plan.error + plan.error_dual
            error = xp.sign(residual) * xp.maximum(xp.abs(residual) - SHRINK * weight, 0.0)
            unbound = zip(rows_of(commands), plan.rows, plan.rows_dual, strict=True)
            asked = [RELAXATION * new + (1.0 - RELAXATION) * row + dual for new, row, dual in unbound]
            rows = tuple(map(xp.clip, asked, begun.low, begun.high))
            rows_dual = tuple(new - row for new, row in zip(asked, rows, strict=True))
            return _AxisPlan(*plan[:3], commands, error, residual - error, rows, rows_dual)

        return _AxisPlan(*repeat(iterate, ADMM_ITERATIONS, begun))


class _AxisPlan(NamedTuple):
    """ADMM variables of one axis; N is the number of decisions."""

    wanted: Array  # path less free response, B + (N,)
    low: RowsLu  # bounds of the rows L u, B + (N,) each
    high: RowsLu
    commands: Array  # B + (N,)
    error: Array  # M u − wanted after the shrinkage, B + (N,)
    error_dual: Array
    rows: RowsLu  # L u after the clipping, B + (N,) each
    rows_dual: RowsLu


def make_oracle(robot: Robot, task: Task) -> Oracle:
    """Build the oracle for engagements of one length, in float64.

    Args:
      robot: plant, muzzle and limits.
      task: decision period, command limit, hit radius, and the length.

    Raises:
      InputError: if the task has several lengths.
    """
    if len(task.lengths) != 1:
        raise InputError(f"the oracle plans for one length, got lengths_s = {[*task.lengths]}; make one for each")
    period, limits, model = task.period_s, robot.command_limits(task), robot.gimbal(task.period_s)
    decisions = round(task.lengths[0] / period)
    planned = limits._replace(max_acceleration=limits.max_acceleration * MARGIN)
    preview = make_preview(model, planned, period, decisions, smoothing=1e-6)
    preview = replace(preview, iterations=LEAST_SQUARES_ITERATIONS, relaxation=RELAXATION, along=-1)
    tracking = make_preview(model, limits, period, HORIZON, SMOOTHING)
    solve = []
    for response, penalty in zip(preview.response, preview.penalty, strict=True):
        square = response.T @ response + 1e-9 * np.eye(decisions)
        solve.append(np.linalg.inv(square + bounding(penalty, decisions)))
    return Oracle(preview, tracking, np.array(solve), robot.muzzle_model(), np.asarray(task.hit_radius_m))

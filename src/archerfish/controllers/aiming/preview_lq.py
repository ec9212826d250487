"""Aim through the identified plant: predict the target, and find the commands that bring the gimbal onto its path.

The strong classical baseline: it looks a horizon ahead, has a model of the gimbal's lag and of its limits, and
overdrives the command accordingly.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, map_arrays, namespace, over, tree
from archerfish.controllers.aiming.preview_program import Preview, make_preview
from archerfish.controllers.predictors.predictor import Predictor
from archerfish.controllers.tuning import SMOOTHING
from archerfish.dynamics.aiming import intercept
from archerfish.dynamics.linear_axis import GimbalModel, advance, angle_then, gimbal_angle, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.protocols import Command, Seen, Truth, aim
from archerfish.robot import Robot
from archerfish.task import Task
from archerfish.tracking.detections import unwrapped

HORIZON = 15
"""Decisions that the preview looks ahead: 0.3 s, twice the yaw axis' time constant."""
PAST = 14
"""Decisions that the observer looks back for what feedback shows: feedback older than a quarter of a second is of no
use."""


class PreviewState(NamedTuple):
    """Memory of the controller."""

    track: Any  # of the predictor
    plant: Array  # estimated state of the axes, B + (2, m)
    past: Array  # angles [rad] and rates [rad/s] now and at the decisions before, latest first, B + (PAST, 2, 2)
    command: Array  # in force before the latest [rad], B + (2,)


@tree()
class PreviewAim:
    """Kalman (or another predictor) and preview LQ on the identified plant."""

    predictor: Any  # Predictor
    muzzle: Muzzle  # for drop, drag and flight time
    model: GimbalModel  # the plant, (2, ...)
    gain: Array  # of the state observer: angle error to state, (2, m)
    preview: Preview  # the program of the horizon
    lead: Array  # how much later than by the model the pellets are taken to leave the muzzle [s], ()

    def reset(self, seen: Seen, truth: Truth | None = None) -> PreviewState:  # noqa: ARG002
        """Begin tracking, with the gimbal at rest."""
        plant = rest_state(self.model, seen.command)
        past = namespace(plant).stack([self._motion(plant)] * PAST, axis=-3)
        return PreviewState(self.predictor.reset(seen), plant, past, seen.command)

    def step(self, state: PreviewState, seen: Seen) -> tuple[PreviewState, Command]:
        """Decide."""
        xp = namespace(seen.command)
        track = self.predictor.step(state.track, seen)
        moved = (seen.elapsed > 0.0)[..., None]
        plant = xp.where(moved[..., None], advance(self.model, state.plant, seen.command), state.plant)
        newest = self._motion(plant)[..., None, :, :]
        past = xp.where(moved[..., None, None], xp.concat([newest, state.past[..., :-1, :, :]], axis=-3), state.past)
        error = (seen.gimbal.angle - angle_then(past, seen.gimbal.age, self.preview.period))[..., None]
        correction = lift(self.gain, plant) * error
        plant = plant + correction
        # The past moves along: what is corrected now must not be corrected again by each feedback on its way.
        past = past + xp.stack([gimbal_angle(self.model, correction), 0.0 * error[..., 0]], axis=-2)[..., None, :, :]
        rate = (seen.command - state.command) / self.preview.period
        path, base_yaw = self._wanted(track, seen), self.preview.base_yaw(seen.base, self.preview.response.shape[-1])
        commands = self.preview.track(plant, seen.command, rate, path, base_yaw)
        return PreviewState(track, plant, past, seen.command), aim(commands[..., 0, :])

    def _motion(self, plant: Array) -> Array:
        """Angles and rates of a state, shape B + (2, 2), pitch and yaw last."""
        return namespace(plant).stack([gimbal_angle(self.model, plant), gimbal_rate(self.model, plant)], axis=-2)

    def _wanted(self, track: Any, seen: Seen) -> Array:
        """Angles to have at the ends of the coming periods, shape B + (N, 2)."""
        xp = namespace(seen.command)
        count = xp.arange(self.preview.response.shape[-1], dtype=seen.command.dtype)
        starts = xp.reshape(count, (-1,) + (1,) * seen.elapsed.ndim) * self.preview.period + 0.0 * seen.elapsed[None]
        lifted = map_arrays(lambda array: array[None], self.predictor.against_pivot(track, seen.base))
        position = partial(self.predictor.position_after, lifted)
        mean = partial(self.predictor.mean_after, lifted)
        late, muzzle = self.preview.period + self.lead, self.muzzle
        angle = over(lambda start: intercept(position, start + late, muzzle, mean).angle, starts)
        return xp.moveaxis(unwrapped(angle, seen.command[None]), 0, -2)


def make_preview_aim(
    predictor: Predictor, robot: Robot, task: Task, *, smoothing: float = SMOOTHING, lead_s: float = 0.0
) -> PreviewAim:
    """Build the controller, in float64.

    Args:
      predictor: where the target will be.
      robot: plant, muzzle and limits.
      task: decision period and command limit.
      smoothing: weight of the changes of the command against squared angle errors.
      lead_s: how much later than by the model the pellets are taken to leave the muzzle [s].
    """
    model = robot.gimbal(task.period_s)
    preview = make_preview(model, robot.command_limits(task), task.period_s, HORIZON, smoothing)
    return PreviewAim(predictor, robot.muzzle_model(), model, observer_gain(model), preview, np.asarray(float(lead_s)))


def observer_gain(model: GimbalModel) -> Array:
    """Return the stationary Kalman gain of each axis' state from its angle, shape (2, m).

    The command acts with an error of a tenth of a degree and the angle is read to a hundredth.

    Args:
      model: the plant, shape (2, ...), float64.
    """
    from scipy.linalg import solve_discrete_are

    gains, noise = [], np.deg2rad(0.01) ** 2
    for transition, into, angle in zip(model.transition, model.input, model.angle, strict=True):
        process = np.deg2rad(0.1) ** 2 * np.outer(into, into) + 1e-12 * np.eye(len(into))
        covariance = solve_discrete_are(transition.T, angle[:, None], process, np.array([[noise]]))
        gains.append(covariance @ angle / (angle @ covariance @ angle + noise))
    return np.array(gains)

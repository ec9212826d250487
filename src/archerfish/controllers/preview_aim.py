"""Aim through the identified plant: predict the target, and find the commands that bring the gimbal onto its path.

The strong classical baseline: it looks a horizon ahead, knows the gimbal's lag and its limits, and overdrives the
command accordingly.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from archerfish.controllers.intercept import intercept
from archerfish.controllers.predictors import Predictor
from archerfish.controllers.preview import Preview, make_preview, track_path
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import Array, lift, map_arrays, namespace
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always

HORIZON = 15
"""Decisions that the preview looks ahead: 0.3 s, twice the yaw axis' time constant."""
SMOOTHING = 1e-4
"""Weight of the changes of the command against squared angle errors."""


class PreviewState(NamedTuple):
    """What the controller remembers."""

    track: Any
    """Of the predictor."""
    plant: Array
    """Estimated state of the axes, shape B + (2, m)."""
    command: Array
    """Command in force before the latest [rad], shape B + (2,)."""


class PreviewAim(NamedTuple):
    """Kalman (or another predictor) and preview LQ on the identified plant."""

    predictor: Predictor
    """Where the target will be."""
    muzzle: Muzzle
    """For drop, drag and flight time."""
    model: GimbalModel
    """The plant, shape (2, ...)."""
    gain: Array
    """Of the state observer: angle error to state, shape (2, m)."""
    preview: Preview
    """The programme of the horizon."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> PreviewState:  # noqa: ARG002
        """Begin tracking, with the gimbal at rest."""
        return PreviewState(self.predictor.reset(seen), rest_state(self.model, seen.command), seen.command)

    def step(self, state: PreviewState, seen: Seen) -> tuple[PreviewState, Command]:
        """Decide."""
        xp = namespace(seen.angle)
        track = self.predictor.step(state.track, seen)
        moved = (seen.elapsed > 0.0)[..., None]
        plant = xp.where(moved[..., None], advance(self.model, state.plant, seen.command), state.plant)
        # The feedback shows the past: the estimate goes back to it along its own rate.
        then = gimbal_angle(self.model, plant) - seen.gimbal_age[..., None] * gimbal_rate(self.model, plant)
        error = (seen.angle - then)[..., None]
        plant = plant + lift(self.gain, plant) * error
        path, sight = self._wanted(track, seen)
        rate = (seen.command - state.command) / self.preview.period
        commands = track_path(self.preview, plant, seen.command, rate, path, sight)
        return PreviewState(track, plant, seen.command), fire_always(commands[..., 0, :])

    def _wanted(self, track: Any, seen: Seen) -> tuple[Array, Array]:
        """Angles to have at the ends of the coming periods, and the line of sight at their beginnings, B + (N, 2)."""
        xp = namespace(seen.angle)
        horizon = self.preview.response.shape[-1]
        count = xp.arange(horizon, dtype=seen.angle.dtype)
        starts = xp.reshape(count, (-1,) + (1,) * seen.elapsed.ndim) * self.preview.period + 0.0 * seen.elapsed[None]
        lifted = map_arrays(lambda each: each[None], track)
        shots = starts + self.preview.period
        aim = intercept(lambda time: self.predictor.position_after(lifted, time), shots, self.muzzle)
        sight = line_of_sight(self.predictor.position_after(lifted, starts))
        return xp.moveaxis(aim.angle, 0, -2), xp.moveaxis(sight, 0, -2)


def make_preview_aim(
    predictor: Predictor,
    muzzle: Muzzle,
    model: GimbalModel,
    limits: CommandLimits,
    period_s: float,
    smoothing: float = SMOOTHING,
) -> PreviewAim:
    """Build the controller.

    Args:
      predictor: where the target will be.
      muzzle: for drop, drag and flight time.
      model: the plant, shape (2, ...), float64.
      limits: what may be asked.
      period_s: decision period [s].
      smoothing: weight of the changes of the command against squared angle errors.
    """
    gain = np.array([observer_gain(model, axis) for axis in range(2)])
    return PreviewAim(predictor, muzzle, model, gain, make_preview(model, limits, period_s, HORIZON, smoothing))


def observer_gain(model: GimbalModel, axis: int) -> Array:
    """Stationary Kalman gain of an axis' state from its angle, shape (m,).

    The command acts with an error of a tenth of a degree and the angle is read to a hundredth.
    """
    transition, row = model.transition[axis], model.angle[axis][:, None]
    process = np.deg2rad(0.1) ** 2 * np.outer(model.input[axis], model.input[axis]) + 1e-12 * np.eye(len(row))
    noise = np.array([[np.deg2rad(0.01) ** 2]])
    covariance = solve_discrete_are(transition.T, row, process, noise)
    return np.asarray(covariance @ row / (row.T @ covariance @ row + noise))[:, 0]

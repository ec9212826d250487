"""Aim through the identified plant: predict the target, and find the commands that bring the gimbal onto its path.

The strong classical baseline: it looks a horizon ahead, knows the gimbal's lag and its limits, and overdrives the
command accordingly.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from archerfish.controllers.predictors import Predictor
from archerfish.controllers.preview import Preview, make_preview, track_path
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import Array, lift, map_arrays, namespace
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always

HORIZON = 15
"""Decisions that the preview looks ahead: 0.3 s, twice the yaw axis' time constant."""
SMOOTHING = 1e-4
"""Weight of the changes of the command against squared angle errors."""
PAST = 14
"""Decisions that the observer looks back for what feedback shows: feedback older than a quarter of a second is of no
use to anybody."""


class PreviewState(NamedTuple):
    """What the controller remembers."""

    track: Any
    """Of the predictor."""
    plant: Array
    """Estimated state of the axes, shape B + (2, m)."""
    past: Array
    """Angles [rad] and rates [rad/s] that it had now and at the decisions before, latest first, B + (PAST, 2, 2)."""
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
    lead: Array = 0.0
    """How much later than the model says the pellets are taken to leave the muzzle [s], shape ()."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> PreviewState:  # noqa: ARG002
        """Begin tracking, with the gimbal at rest."""
        plant = rest_state(self.model, seen.command)
        past = namespace(plant).stack([self._turn(plant)] * PAST, axis=-3)
        return PreviewState(self.predictor.reset(seen), plant, past, seen.command)

    def step(self, state: PreviewState, seen: Seen) -> tuple[PreviewState, Command]:
        """Decide."""
        xp = namespace(seen.angle)
        track = self.predictor.step(state.track, seen)
        moved = (seen.elapsed > 0.0)[..., None]
        plant = xp.where(moved[..., None], advance(self.model, state.plant, seen.command), state.plant)
        newest = self._turn(plant)[..., None, :, :]
        past = xp.where(moved[..., None, None], xp.concat([newest, state.past[..., :-1, :, :]], axis=-3), state.past)
        error = (seen.angle - angle_then(past, seen.gimbal_age, self.preview.period))[..., None]
        mend = lift(self.gain, plant) * error
        plant = plant + mend
        # The past moves along: what is mended now must not be mended again by each feedback that is on its way.
        past = past + xp.stack([gimbal_angle(self.model, mend), 0.0 * seen.angle], axis=-2)[..., None, :, :]
        path, sight = self._wanted(track, seen)
        rate = (seen.command - state.command) / self.preview.period
        commands = track_path(self.preview, plant, seen.command, rate, path, sight)
        return PreviewState(track, plant, past, seen.command), fire_always(commands[..., 0, :])

    def _turn(self, plant: Array) -> Array:
        """Angles and rates of a state, shape B + (2, 2), pitch and yaw last."""
        return namespace(plant).stack([gimbal_angle(self.model, plant), gimbal_rate(self.model, plant)], axis=-2)

    def _wanted(self, track: Any, seen: Seen) -> tuple[Array, Array]:
        """Angles to have at the ends of the coming periods, and the line of sight at their beginnings, B + (N, 2)."""
        xp = namespace(seen.angle)
        horizon = self.preview.response.shape[-1]
        count = xp.arange(horizon, dtype=seen.angle.dtype)
        starts = xp.reshape(count, (-1,) + (1,) * seen.elapsed.ndim) * self.preview.period + 0.0 * seen.elapsed[None]
        lifted = map_arrays(lambda each: each[None], track)
        shots = starts + self.preview.period + self.lead
        mean_after = getattr(self.predictor, "mean_after", self.predictor.position_after)
        aim = intercept(
            lambda time: self.predictor.position_after(lifted, time),
            shots,
            self.muzzle,
            lambda time: mean_after(lifted, time),
        )
        sight = line_of_sight(mean_after(lifted, starts))
        return xp.moveaxis(aim.angle, 0, -2), xp.moveaxis(sight, 0, -2)


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
    away = xp.minimum(xp.abs(offset), 1.0)
    angle = (1.0 + 2.0 * away) * (1.0 - away) ** 2
    slope = period * offset * (1.0 - away) ** 2
    weights = xp.stack([angle, slope], axis=-1)[..., None]
    return xp.sum(weights * past, axis=(-3, -2))


def make_preview_aim(
    predictor: Predictor,
    muzzle: Muzzle,
    model: GimbalModel,
    limits: CommandLimits,
    period_s: float,
    smoothing: float = SMOOTHING,
    lead_s: float = 0.0,
) -> PreviewAim:
    """Build the controller.

    Args:
      predictor: where the target will be.
      muzzle: for drop, drag and flight time.
      model: the plant, shape (2, ...), float64.
      limits: what may be asked.
      period_s: decision period [s].
      smoothing: weight of the changes of the command against squared angle errors.
      lead_s: how much later than the model says the pellets are taken to leave the muzzle [s].
    """
    gain = np.array([observer_gain(model, axis) for axis in range(2)])
    preview = make_preview(model, limits, period_s, HORIZON, smoothing)
    return PreviewAim(predictor, muzzle, model, gain, preview, np.asarray(lead_s))


def observer_gain(model: GimbalModel, axis: int) -> Array:
    """Stationary Kalman gain of an axis' state from its angle, shape (m,).

    The command acts with an error of a tenth of a degree and the angle is read to a hundredth.
    """
    transition, row = model.transition[axis], model.angle[axis][:, None]
    process = np.deg2rad(0.1) ** 2 * np.outer(model.input[axis], model.input[axis]) + 1e-12 * np.eye(len(row))
    noise = np.array([[np.deg2rad(0.01) ** 2]])
    covariance = solve_discrete_are(transition.T, row, process, noise)
    return np.asarray(covariance @ row / (row.T @ covariance @ row + noise))[:, 0]

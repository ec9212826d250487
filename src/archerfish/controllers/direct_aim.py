"""Classical auto-aim: predict the target, solve for the angles, command them. It knows nothing of the gimbal's lag."""

from typing import Any, NamedTuple

from archerfish.controllers.predictors import Predictor
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.command_limits import CommandLimits, fastest_approach
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always


class DirectAim(NamedTuple):
    """Commands the intercept's angles; with a Kalman filter as predictor, the paper's baseline."""

    predictor: Predictor
    """Where the target will be."""
    muzzle: Muzzle
    """For drop, drag and flight time."""
    limits: CommandLimits
    """What may be asked; the way to the aim keeps them, so that it can stop there."""
    lead: Array
    """Time from a decision until the pellet leaves the muzzle [s], shape ()."""
    period: Array
    """Decision period [s], shape ()."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:  # noqa: ARG002
        """Begin tracking."""
        return self.predictor.reset(seen)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide."""
        track = self.predictor.step(state, seen)
        delay = 0.0 * seen.elapsed + self.lead
        aim = intercept(lambda time: self.predictor.position_after(track, time), delay, self.muzzle)
        command = approach(self.limits, aim.angle, seen.command, self.period)
        return track, fire_always(command)


def approach(limits: CommandLimits, aim: Array, command: Array, period: Array) -> Array:
    """Return the next command on the fastest way to an aim that can stop there.

    Args:
      limits: acceleration and rate are used.
      aim: where to go [rad], shape B + (2,).
      command: in force now [rad], shape B + (2,).
      period: until the next decision [s].
    """
    xp = namespace(aim, command)
    way = aim - command
    max_rate, max_acceleration = lift(limits.max_rate, way), lift(limits.max_acceleration, way)
    rate = xp.minimum(max_rate, fastest_approach(xp.abs(way), max_acceleration, period))
    # An aim within reach is taken exactly: no rounding by way of the rate.
    return xp.where(xp.abs(way) <= rate * period * (1.0 + 1e-5), aim, command + xp.sign(way) * rate * period)

"""Direct aim: the angles of the intercept are commanded. With a Kalman filter as predictor it is the paper's baseline.

It has no model of the gimbal's lag.
"""

from functools import partial
from typing import Any

from archerfish.arrays import Array, tree
from archerfish.dynamics.aiming import intercept
from archerfish.dynamics.command_limits import CommandLimits, approach
from archerfish.dynamics.muzzle import Muzzle
from archerfish.protocols import Command, Seen, Truth, aim
from archerfish.tracking.detections import unwrapped


@tree()
class DirectAim:
    """Commands the intercept's angles; with a Kalman filter as predictor, the paper's baseline."""

    predictor: Any  # Predictor
    muzzle: Muzzle  # for drop, drag and flight time
    limits: CommandLimits  # the slew to the aim keeps them, so that it can stop there
    lead: Array  # from a decision until the pellet leaves the muzzle [s], ()
    period: Array  # decision period [s], ()

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:  # noqa: ARG002
        """Begin tracking."""
        return self.predictor.reset(seen)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        """Decide."""
        state = self.predictor.step(state, seen)
        relative = self.predictor.against_pivot(state, seen.base)
        lead = 0.0 * seen.elapsed + self.lead
        angle = intercept(partial(self.predictor.position_after, relative), lead, self.muzzle).angle
        rate, acceleration = self.limits.max_rate, self.limits.max_acceleration
        return state, aim(approach(unwrapped(angle, seen.command), seen.command, rate, acceleration, self.period))

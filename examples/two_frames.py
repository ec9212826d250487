"""Aims ahead by the target's velocity between the last two frames, with no filter and no model of the gimbal."""

from typing import NamedTuple

import numpy as np

from archerfish.controllers.roster import Workbench
from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always


class TwoFrames(NamedTuple):
    """Leads by the difference of two frames."""

    muzzle: Muzzle
    """For drop, drag and flight time."""
    period: Array
    """Decision period [s], shape ()."""

    @classmethod
    def build(cls, bench: Workbench) -> "TwoFrames":
        """Build it for a robot."""
        return cls(bench.muzzle, np.asarray(bench.conditions.control_period_s))

    def reset(self, seen: Seen, truth: Truth | None = None) -> Array:
        """Remember the first position [m], shape B + (3,)."""
        return seen.plate[..., 0, :]

    def step(self, state: Array, seen: Seen) -> tuple[Array, Command]:
        """Decide, from the position [m] one frame ago, shape B + (3,)."""
        xp, plate = namespace(state), seen.plate[..., 0, :]
        velocity = (plate - state) / xp.maximum(seen.elapsed, 1e-6)[..., None]
        delay = 0.0 * seen.elapsed + self.period  # a command is held for a period, then the pellet leaves
        aim = intercept(lambda time: plate + velocity * time[..., None], delay, self.muzzle)
        return plate, fire_always(aim.angle)

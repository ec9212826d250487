"""What a shot is worth in a training: eq (8), a hit, and rewards of a user's own."""

from typing import Any, Protocol

import numpy as np

from archerfish.arrays import Array, namespace, tree
from archerfish.errors import InputError, meant
from archerfish.plugins import FORMS, Plugin, find_plugin, is_plugin
from archerfish.protocols import Command, Seen, Shot

REWARDS = {"eq-8": (1.0, 0.0, 0.0), "hit": (1.0, 0.1, 0.0), "smooth-hit": (0.1, 0.1, 0.012)}
"""Name → weight of the distance, worth of a hit [m], and width over which it is smoothed [m]."""
FARTHEST = -1.0
"""Smallest margin that a reward distinguishes [m]: farther off, and without a pellet, all are worth the same."""
_STEEPEST = 40.0
"""Beyond it the logistic function is 0 or 1 in float32, and its exponential would overflow."""


class RewardFunction(Protocol):
    """What a decision is worth."""

    def __call__(self, shot: Shot, command: Command, seen: Seen) -> Array:
        """Return the reward [m], shape B.

        Args:
          shot: what became of the pellet, shape B.
          command: of the decision.
          seen: after it.
        """


@tree()
class Reward:
    """What a shot is worth [m]: the distance of eq (8), and a hit.

        r = −w d + h σ(m / s),   with the step m ≥ 0 in the place of σ where s = 0

    d is the distance between pellet and plate, m the margin to the edge of the hit area. Eq (8) is w = 1, h = 0. Where
    a target may or may not turn back, the nearest place on average is one that neither hits, so a hit is worth
    something in itself. A step has no slope, though: for a trainer that follows the simulator's gradient the hit is
    smoothed, as a little more dispersion would do.
    """

    distance: Array  # w, ()
    hit: Array  # h [m], ()
    width: Array  # s [m], ()
    hit_radius: Array  # [m], ()

    def __call__(self, shot: Shot, command: Command, seen: Seen) -> Array:  # noqa: ARG002
        """Return the reward [m], shape B."""
        xp = namespace(shot.margin)
        margin = xp.maximum(shot.margin, FARTHEST)
        smooth = self.width > 0.0
        steepness = margin / xp.where(smooth, self.width, 1.0)
        likely = 1.0 / (1.0 + xp.exp(xp.clip(-steepness, -_STEEPEST, _STEEPEST)))
        worth = xp.where(smooth, likely, xp.where(margin >= 0.0, 1.0 + 0.0 * margin, 0.0 * margin))
        return self.hit * worth - self.distance * (self.hit_radius - margin)


@tree(static=("plugin",))
class UserReward:
    """A user's reward."""

    plugin: Plugin  # of a `RewardFunction`

    def __call__(self, shot: Shot, command: Command, seen: Seen) -> Array:
        """Return the reward [m], shape B.

        Raises:
          InputError: if the user's code fails, or returns something else.
        """
        with self.plugin.running():
            reward, expected = self.plugin.value(shot, command, seen), shot.margin.shape
            if getattr(reward, "shape", None) != expected or reward.dtype.kind != "f":
                found = f"{getattr(reward, 'dtype', type(reward).__name__)} of shape {getattr(reward, 'shape', ())}"
                raise InputError(
                    f"returns {found}, expected floats of shape {expected}, one per engagement; correct it"
                )
            return reward


def make_reward(reward: str | RewardFunction, hit_radius_m: float) -> Any:
    """Return a reward as a tree.

    Args:
      reward: one of `REWARDS`, or one of a user's own, a name as `find_plugin` takes it or the function.
      hit_radius_m: largest miss that hits [m].

    Raises:
      InputError: if there is none of this name.
    """
    if isinstance(reward, str) and reward in REWARDS:
        return Reward(*(np.asarray(number) for number in (*REWARDS[reward], hit_radius_m)))
    if isinstance(reward, str) and not is_plugin(reward, "reward"):
        expected = f"{', '.join(REWARDS)}, or one of your own ({FORMS})"
        remedy = meant(reward, REWARDS, "name one of these")
        raise InputError(f"reward must be one of {expected}, got {reward!r}; {remedy}")
    return UserReward(find_plugin(reward, "reward"))

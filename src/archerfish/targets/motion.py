"""How a target moves. A motion is a NamedTuple with one function, `position(time)`.

To add one of your own, see docs/adding.md. Every array of it begins with the batch shape B, so one record holds
many targets, and a batch of them can be cut, stacked and chosen from without knowing which motion it is.
"""

from typing import NamedTuple, Protocol

from archerfish.dynamics.array_namespace import Array, lift, namespace


class TargetMotion(Protocol):
    """A path in the gimbal's frame."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s] since the engagement began, shape B + (3,)."""


class StillOrMoving(NamedTuple):
    """Targets of which some stand still and the others move."""

    place: Array
    """Where those that don't move stand [m], shape B + (3,)."""
    moving: Array
    """Whether a target moves, shape B."""
    motion: TargetMotion
    """How."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        moved = self.motion.position(time)
        xp = namespace(self.place, moved)
        return xp.where(lift(xp.asarray(self.moving)[..., None], moved), moved, lift(self.place, moved))

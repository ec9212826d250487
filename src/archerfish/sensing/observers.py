"""What all ways of seeing and acting of a policy have in common."""

from typing import Any, Protocol

from archerfish.dynamics.array_namespace import Array
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Seen


class AnyObserver(Protocol):
    """How a policy sees and acts; a NamedTuple of arrays, so that it passes through a compiled program."""

    @property
    def muzzle(self) -> Muzzle:
        """The muzzle that the aim is computed for."""

    @property
    def size(self) -> int:
        """How many numbers n an observation has."""

    def begin(self, seen: Seen) -> Any:
        """Return the memory at the beginning of an engagement, as if nothing had moved before it."""

    def remember(self, memory: Any, seen: Seen) -> Any:
        """Take in what is seen now, and return the memory with it; arrays begin with the batch shape B."""

    def observe(self, memory: Any) -> Array:
        """Build the observation from the memory, shape B + (n,)."""

    def decode(self, memory: Any, action: Array) -> Array:
        """Turn an action, shape B + (2,), into a pitch and yaw command [rad]; zero aims at the target as seen now."""

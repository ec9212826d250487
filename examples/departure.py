"""A target that stands for up to half a second, then leaves to the left or right at a constant speed."""

from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, namespace


class Departure(NamedTuple):
    """Stands until it leaves."""

    place: Array
    """Where it stands [m], shape B + (3,)."""
    leaves: Array
    """When it leaves [s], shape B."""
    velocity: Array
    """How fast, left positive [m/s], shape B."""

    @classmethod
    def draw(cls, place: Array, speed: Array, chance: Array) -> "Departure":
        """Draw one for each engagement: place [m] B + (3,), speed [m/s] B, and numbers from 0 to 1, B + (4,)."""
        xp = namespace(place)
        velocity = xp.where(chance[..., 0] < 0.5, speed, -speed)
        return cls(place, leaves=0.5 * chance[..., 1], velocity=velocity)

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.place, time)
        driven = self.velocity * xp.maximum(time - self.leaves, 0.0)
        still = self.place + 0.0 * driven[..., None]
        return xp.stack([still[..., 0], still[..., 1] + driven, still[..., 2]], axis=-1)

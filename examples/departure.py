"""A target that stands for up to half a second, then leaves to either side."""

from typing import Any, NamedTuple

from archerfish.authors import namespace


class Departure(NamedTuple):
    place: Any  # where it stands [m], B + (3,)
    leaves: Any  # when it leaves [s], B
    velocity: Any  # to the left [m/s], B

    def position(self, time):  # times [s] of shape B or (N,) + B → places [m], shape of the times + (3,)
        xp = namespace(self.place, time)
        driven = self.velocity * xp.maximum(time - self.leaves, 0.0)
        x, y, z = (self.place[..., axis] + 0.0 * driven for axis in range(3))
        return xp.stack([x, y + driven, z], axis=-1)


def departure(place, speed, uniforms):  # [m] B + (3,); [m/s] B; 0…1, B + (4,)
    side = namespace(place).where(uniforms[..., 0] < 0.5, -1.0, 1.0)
    return Departure(place, 0.5 * uniforms[..., 1], side * speed)

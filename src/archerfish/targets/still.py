"""A target that stands still."""

from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.targets.path import TIMES


class Static(NamedTuple):
    """A target that stands still."""

    place: Array
    """Position [m], shape B + (3,)."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        time = namespace(self.place, time).asarray(time)[..., None]
        return lift(self.place, time) + 0.0 * time


def still_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Return no way at all, shape B + (n,) → B + (N, 2)."""
    nowhere = 0.0 * chance[..., :1, None]
    return nowhere + lift(np.zeros((len(TIMES), 2), np.float32), nowhere)

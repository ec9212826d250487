"""How fast, how far and how often targets move: the one table that every motion draws its parameters from.

Most of it follows what robots do in matches, as published with one position per second and robot (RoboMaster's regional
championship of 2026: 613 games, of which we evaluated 103). Positions once a second hide how a robot turns back, so
times between turns are assumed, over a wide range.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from archerfish.dynamics.array_namespace import Array, lift, namespace


class Distribution(NamedTuple):
    """Of one parameter."""

    unit: str
    """Of its values."""
    share: tuple[float, ...]
    """Probabilities at which the distribution function is known, 0…1, rising."""
    value: tuple[float, ...]
    """Its values there; between them it is linear, in the logarithm of the value if `logarithmic`."""
    logarithmic: bool
    """Whether the logarithm is what is drawn evenly."""
    reason: str
    """Where it comes from."""

    def draw(self, uniform: Array) -> Array:
        """Turn uniform draws in [0, 1), shape B, into values, shape B: the inverse of the distribution function."""
        # Plain numbers, so that float32 stays float32.
        values = [math.log(each) if self.logarithmic else each for each in self.value]
        xp = namespace(uniform)
        found = values[0] + 0.0 * uniform
        for low, high, begin, end in zip(self.share, self.share[1:], values, values[1:], strict=False):
            found = found + (end - begin) * xp.clip((uniform - low) / (high - low), 0.0, 1.0)
        return xp.exp(found) if self.logarithmic else found


def _uniform(low: float, high: float, unit: str, reason: str) -> Distribution:
    return Distribution(unit, (0.0, 1.0), (low, high), False, reason)


def _log_uniform(low: float, high: float, unit: str, reason: str) -> Distribution:
    return Distribution(unit, (0.0, 1.0), (low, high), True, reason)


LARGEST_SPEED = 3.0
"""Of any target [m/s]: the chassis of an infantry robot reaches no more."""
LARGEST_LATERAL, LARGEST_FORWARD = 1.2, 0.4
"""Largest way to the side and towards the gimbal, as shares of the distance: 50° to either side, where the yaw axis
ends at 75°, and never nearer than 0.6 of the distance that the cell names."""

SPEED = Distribution(
    "m/s",
    (0.0, 0.5, 0.8, 0.9, 0.98, 1.0),
    (0.31, 1.0, 1.7, 2.05, 2.6, 3.0),
    False,
    "infantry robots in matches, the faster half (the slower one stands): median 0.31, then 1.0, 1.7, 2.05 and 2.6 m/s "
    "at 75, 90, 95 and 99 % of all",
)
DIRECTION = _uniform(-90.0, 90.0, "°", "any: 0 is across the line of sight, and robots approach and retreat as well")
ACCELERATION = _uniform(3.0, 8.0, "m/s²", "assumed: 6 m/s² in the public simulator that states one")

TABLE: Mapping[str, Mapping[str, Distribution]] = MappingProxyType(
    {
        "still": {},
        "parabola": {
            "half width": _log_uniform(0.08, 0.6, "m", "eq (7) has 0.115; wider and narrower swings about it"),
            "time between turns": _log_uniform(
                0.4, 4.0, "s", "the paper's targets turn back every 0.66 s or later, some after many seconds"
            ),
            "depth": _uniform(
                0.0, 0.12, "m", "way towards the gimbal between turns: 0.04 in eq (7), from none to threefold"
            ),
        },
        "pass": {"speed": SPEED, "direction": DIRECTION},
        "strafe": {
            "speed": SPEED,
            "direction": DIRECTION,
            "time between turns": _log_uniform(0.4, 4.0, "s", "mean of a target's own; as for the parabola"),
            "irregularity": _uniform(0.1, 1.0, "", "0 turns at equal times, 1 at times without memory"),
            "acceleration": ACCELERATION,
        },
        "stop-and-go": {
            "speed": SPEED,
            "direction": DIRECTION,
            "time of a leg": _log_uniform(0.4, 3.0, "s", "mean of a target's own, driving and standing alike; assumed"),
            "irregularity": _uniform(0.1, 1.0, "", "as for the strafe"),
            "acceleration": ACCELERATION,
        },
        "sinusoid": {
            "amplitude": _log_uniform(0.08, 0.6, "m", "as the parabola's half width"),
            "frequency": _log_uniform(0.25, 1.5, "Hz", "as the parabola's turns; slower where 8 m/s² would not do"),
            "direction": DIRECTION,
        },
        "circle": {
            "radius": _log_uniform(0.15, 1.0, "m", "from a robot that turns about itself to a wide arc"),
            "speed": SPEED,
        },
        "singer": {
            "speed": SPEED,
            "direction": _uniform(-180.0, 180.0, "°", "of the first velocity; any"),
            "acceleration": _log_uniform(0.3, 2.0, "m/s²", "change of velocity in a second: 0.4, 1.3 m/s at 50, 90 %"),
            "time constant": _log_uniform(0.3, 1.5, "s", "Singer 1970 gives seconds for vehicles; assumed shorter"),
        },
    }
)
"""Motion → parameter → distribution."""

VARIATION: Mapping[str, Distribution] = MappingProxyType(
    {
        "pace": _log_uniform(0.1, 1.0, "", "the same way more slowly: turns are rarer and less sharp; assumed"),
        "amplitude": _log_uniform(0.02, 0.15, "m", "of a sway beside the motion; assumed"),
        "frequency": _log_uniform(0.5, 2.0, "Hz", "of the sway; slower where 8 m/s² would not do"),
        "direction": _uniform(-90.0, 90.0, "°", "of the sway; any"),
    }
)
"""Parameter → distribution, of `targets.variation`."""


def draw_parameters(motion: str, chance: Array) -> tuple[Array, ...]:
    """Draw the parameters of a motion, in the order of the table.

    Args:
      motion: name in the table.
      chance: uniform draws, shape B + (n,) with at least as many as there are parameters.

    Returns:
      Shape B each; angles in rad.
    """
    drawn = (each.draw(chance[..., index]) for index, each in enumerate(TABLE[motion].values()))
    units = (each.unit for each in TABLE[motion].values())
    return tuple(np.pi / 180.0 * value if unit == "°" else value for value, unit in zip(drawn, units, strict=True))


def direction(heading: Array) -> Array:
    """Return unit vectors of level directions, zero to the left, positive away from the gimbal, B → B + (2,).

    Args:
      heading: [rad], shape B.
    """
    xp = namespace(heading)
    return xp.stack([xp.sin(heading), xp.cos(heading)], axis=-1)


def way_along(heading: Array, way: Array) -> Array:
    """Return the level way of targets that move along a line, shape B + (N,) → B + (N, 2).

    Args:
      heading: as for `direction`, shape B.
      way: how far along it [m], shape B + (N,).
    """
    return lift(direction(heading)[..., None, :], way[..., None]) * way[..., None]

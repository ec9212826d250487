"""The one table of the distributions that parameters of motions are drawn from.

Most of it follows what robots do in matches, as published with one position per second and robot (RoboMaster's regional
championship of 2026: 613 games, of which we evaluated 103). Positions once a second hide how a robot turns back, so
times between turns are assumed, over a wide range.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from archerfish.arrays import Array, lift, namespace


class Distribution(NamedTuple):
    """The distribution of one parameter."""

    value: tuple[float, ...]
    """Values, rising; between them the distribution function is linear, in the value's logarithm if `logarithmic`."""
    unit: str
    """Of the values."""
    logarithmic: bool = False
    """Whether the logarithm is drawn evenly."""
    share: tuple[float, ...] = (0.0, 1.0)
    """The distribution function at the values, 0…1, rising."""

    def draw(self, uniform: Array) -> Array:
        """Turn uniform draws in [0, 1), shape B, into values in SI units and radians, shape B.

        This is the inverse of the distribution function.
        """
        # Plain numbers, so that float32 stays float32.
        values = [math.log(value) if self.logarithmic else value for value in self.value]
        xp, found = namespace(uniform), values[0] + 0.0 * uniform
        for low, high, begin, end in zip(self.share, self.share[1:], values, values[1:], strict=False):
            found = found + (end - begin) * xp.clip((uniform - low) / (high - low), 0.0, 1.0)
        found = xp.exp(found) if self.logarithmic else found
        return math.pi / 180.0 * found if self.unit == "°" else found


LARGEST_SPEED = 3.0
"""Of any target [m/s]: the chassis of an infantry robot reaches no more."""
LARGEST_ACCELERATION = 8.0
"""Of targets in curves [m/s²]; the largest of targets that drive and stop or turn."""

# Infantry robots in matches, the faster half (the slower one stands): median 0.31, then 1.0, 1.7, 2.05 and 2.6 m/s at
# 75, 90, 95 and 99 % of all.
_SPEED = Distribution((0.31, 1.0, 1.7, 2.05, 2.6, 3.0), "m/s", share=(0.0, 0.5, 0.8, 0.9, 0.98, 1.0))
_DIRECTION = Distribution((-90.0, 90.0), "°")  # 0 is across the line of sight; robots approach and retreat as well
_COURSE = Distribution((-180.0, 180.0), "°")  # of Singer's first velocity, and of the process
_WIDTH = Distribution((0.08, 0.6), "m", True)  # half width or amplitude: eq (7) has 0.115; wider and narrower about it
_TURNS = Distribution((0.4, 4.0), "s", True)  # the paper's turn back every 0.66 s or later, some after many seconds
_NOISE = Distribution((0.3, 2.0), "m/s²", True)  # change of velocity in a second: 0.4, 1.3 m/s at 50, 90 %
_MEMORY = Distribution((0.3, 1.5), "s", True)  # Singer 1970 gives seconds for vehicles; assumed shorter

_LINE = {"speed": _SPEED, "direction": _DIRECTION}
# Irregularity 0 turns at equal times, 1 at times without memory. Assumed: 6 m/s² in the public simulator that has one.
_DRIVING = {"irregularity": Distribution((0.1, 1.0), ""), "acceleration": Distribution((3.0, 8.0), "m/s²")}
TABLE: Mapping[str, Mapping[str, Distribution]] = {
    "still": {},
    # Depth towards the gimbal between turns: 0.04 in eq (7), from none to threefold.
    "parabola": {"half width": _WIDTH, "time between turns": _TURNS, "depth": Distribution((0.0, 0.12), "m")},
    "pass": _LINE,
    "strafe": {**_LINE, "time between turns": _TURNS, **_DRIVING},
    # Mean time of each target, driving and stopped alike; assumed.
    "stop-and-go": {**_LINE, "time of a leg": Distribution((0.4, 3.0), "s", True), **_DRIVING},
    # As the parabola's turns; slower where 8 m/s² would not do.
    "sinusoid": {"amplitude": _WIDTH, "frequency": Distribution((0.25, 1.5), "Hz", True), "direction": _DIRECTION},
    # From a robot that turns about itself to a wide arc.
    "circle": {"radius": Distribution((0.15, 1.0), "m", True), "speed": _SPEED},
    "singer": {"speed": _SPEED, "direction": _COURSE, "acceleration": _NOISE, "time constant": _MEMORY},
}
"""Motion → parameter → distribution."""
VARIATION: Mapping[str, Distribution] = {
    "pace": Distribution((0.1, 1.0), "", True),  # the same path more slowly: turns are rarer and less sharp; assumed
    "amplitude": Distribution((0.02, 0.15), "m", True),  # of a sway beside the motion; assumed
    "frequency": Distribution((0.5, 2.0), "Hz", True),  # of the sway; slower where 8 m/s² would not do
    "direction": _DIRECTION,  # of the sway
}
"""Parameter → distribution, of `mixture.varied`."""
# Of the process with habits, all assumed, and wider than what robots do.
DWELL, AXIS_SPEED = Distribution((0.1, 2.0), "s", True), Distribution((0.1, 2.5), "m/s", True)
"""How long a leg of `process.random_process` lasts, and how fast it is driven along one of two axes."""
LINE_SPEED = Distribution((0.1, 0.5, 1.0, 1.7, 2.5), "m/s", True, share=(0.0, 0.25, 0.5, 0.8, 1.0))
"""How fast a leg along one line is driven: about as fast as robots are in matches. With slower ones a policy that has
seen a fast target turn back shortens its lead from then on."""
_TURN_RATE = Distribution((-1.5, 1.5), "rad/s")  # of those that turn steadily
HABITS = {"acceleration": Distribution((3.0, 15.0), "m/s²", True), "heading": _COURSE, "turn rate": _TURN_RATE}
"""Parameter → distribution, of all legs of a target of that process."""


def draw_parameters(distributions: Mapping[str, Distribution], uniforms: Array) -> tuple[Array, ...]:
    """Draw parameters, in the order of their distributions.

    Args:
      distributions: of a motion, by parameter.
      uniforms: uniform draws, shape B + (n,) with at least as many as there are parameters.

    Returns:
      Shape B each; angles in rad.
    """
    return tuple(distribution.draw(uniforms[..., index]) for index, distribution in enumerate(distributions.values()))


def along(heading: Array, distance: Array) -> Array:
    """Return the level displacement of targets that move along a line, shape B + (N,) → B + (N, 2).

    Args:
      heading: zero to the left, positive beyond the place, seen from the gimbal [rad], shape B.
      distance: how far along it [m], shape B + (N,).
    """
    xp = namespace(heading)
    unit = xp.stack([xp.sin(heading), xp.cos(heading)], axis=-1)
    return lift(unit[..., None, :], distance[..., None]) * distance[..., None]

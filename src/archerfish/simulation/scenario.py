"""How engagements are drawn: targets of eq (7), standing still or moving, at the ranges of Tables II–V."""

from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.target_motion import Parabola
from archerfish.sensing.interfaces import Engagement

UNIFORMS = 6
"""Uniform draws per engagement: range, lateral offset, speed, phase, whether it stands still, plant."""
TARGETS = {"static": 1.0, "dynamic": 0.0, "both": 0.5}
"""What moves → share of the targets that stand still."""


class Scenario(NamedTuple):
    """The distribution of engagements; arrays, so that one compiled program trains for any of them."""

    range_low: Array
    """Smallest distance of the parabola's vertex [m], shape B."""
    range_high: Array
    """Largest distance of the vertex [m], shape B."""
    lateral: Array
    """The vertex is at most this far to the side [m], shape B."""
    height: Array
    """Height of the armor above the gimbal's pivot [m], shape B."""
    max_speed: Array
    """Largest lateral speed [m/s], shape B."""
    half_width: Array
    """Distance from the vertex at which the target turns back [m], shape B."""
    curvature: Array
    """Coefficient of eq (7) [1/m], shape B."""
    static_share: Array
    """Share of the targets that stand still, 0…1, shape B."""
    start: Array
    """Pitch and yaw of the resting gimbal [rad], shape B + (2,)."""
    plants: Array
    """Number of posterior draws of the plant to choose from, shape B."""


def draw_engagement(scenario: Scenario, uniforms: Array) -> Engagement:
    """Turn uniform draws in [0, 1) into engagements.

    Args:
      scenario: the distribution.
      uniforms: shape B + (UNIFORMS,).
    """
    xp = namespace(uniforms)
    place, side, speed, phase, still, plant = (uniforms[..., index] for index in range(UNIFORMS))
    distance = scenario.range_low + (scenario.range_high - scenario.range_low) * place
    lateral = scenario.lateral * (2.0 * side - 1.0)
    moving = still >= scenario.static_share
    motion = Parabola(
        vertex=xp.stack([distance, lateral, scenario.height + 0.0 * place], axis=-1),
        speed=xp.where(moving, scenario.max_speed * speed, 0.0 * speed),
        # A target that stands still stands at the vertex: a quarter of the cycle from the turn.
        phase=xp.where(moving, phase, 0.25),
        half_width=scenario.half_width + 0.0 * place,
        curvature=scenario.curvature + 0.0 * place,
    )
    start = xp.zeros_like(uniforms[..., :2])
    start = start + lift(scenario.start, start)
    return Engagement(motion, start, xp.astype(xp.floor(plant * scenario.plants), xp.int32))

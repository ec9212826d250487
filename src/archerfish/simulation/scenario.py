"""How engagements are drawn: targets at the ranges of Tables II–V, of eq (7) or of any other motion."""

from typing import Any, NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.sensing.interfaces import Engagement
from archerfish.targets.motion import StillOrMoving, TargetMotion
from archerfish.targets.parabola import Parabola

UNIFORMS = 6
"""Uniform draws per engagement: range, lateral offset, speed, phase, whether it stands still or is short, plant."""
_STILL = 4
"""Index of the draw that says whether a target stands still, or, where every motion has its own, how long it is met."""
TARGETS = {"paper": 0.5, "static": 1.0, "dynamic": 0.0}
"""Which of the paper's targets → share of them that stand still."""
SHORT = (0.75, 1.0)
"""Share of the engagements that are short where motions are drawn, and their length [s]: so short and long ones have
as many decisions each."""
LONG_S = 3.0
"""Length of the others [s]: a target's habits show."""


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
    lengths: Array
    """Length of short and of long engagements [s], shape B + (2,)."""
    short_share: Array
    """Share of the engagements that are short, 0…1, shape B."""
    motion: Any = ()
    """How targets move: as eq (7) says, if empty; else one of `archerfish.targets.drawn`, or a user's own of
    `archerfish.targets.own_motion`."""

    @property
    def uniforms(self) -> int:
        """Uniform draws per engagement."""
        return UNIFORMS + int(getattr(self.motion, "chances", 0))


def draw_engagement(scenario: Scenario, uniforms: Array) -> Engagement:
    """Turn uniform draws in [0, 1) into engagements.

    Args:
      scenario: the distribution.
      uniforms: shape B + (scenario.uniforms,).
    """
    xp = namespace(uniforms)
    place, side, speed, phase, still, plant = (uniforms[..., index] for index in range(UNIFORMS))
    distance = scenario.range_low + (scenario.range_high - scenario.range_low) * place
    lateral = scenario.lateral * (2.0 * side - 1.0)
    moving = still >= scenario.static_share
    vertex = xp.stack([distance, lateral, scenario.height + 0.0 * place], axis=-1)
    motion: TargetMotion
    if hasattr(scenario.motion, "path"):
        motion = scenario.motion.path(vertex, uniforms[..., UNIFORMS:], engagement_length(scenario, uniforms))
    elif hasattr(scenario.motion, "draw"):
        # The paper's draws come first, so that places, speeds and plants are those of eq (7)'s targets.
        own = scenario.motion.draw(vertex, scenario.max_speed * speed, uniforms[..., UNIFORMS:])
        motion = StillOrMoving(vertex, moving, own)
    else:
        motion = _parabola(scenario, vertex, speed, phase, moving)
    start = xp.zeros_like(uniforms[..., :2])
    start = start + lift(scenario.start, start)
    return Engagement(motion, start, xp.astype(xp.floor(plant * scenario.plants), xp.int32))


def engagement_length(scenario: Scenario, uniforms: Array) -> Array:
    """Return how long engagements last [s], shape B.

    Args:
      scenario: the distribution.
      uniforms: as for `draw_engagement`.
    """
    short = uniforms[..., _STILL] < scenario.short_share
    return namespace(uniforms).where(short, scenario.lengths[..., 0], scenario.lengths[..., 1])


def _parabola(scenario: Scenario, vertex: Array, speed: Array, phase: Array, moving: Array) -> Parabola:
    xp = namespace(vertex)
    return Parabola(
        vertex=vertex,
        speed=xp.where(moving, scenario.max_speed * speed, 0.0 * speed),
        # A target that stands still stands at the vertex: a quarter of the cycle from the turn.
        phase=xp.where(moving, phase, 0.25),
        half_width=scenario.half_width + 0.0 * speed,
        curvature=scenario.curvature + 0.0 * speed,
    )

"""The target motions that the page offers, each at a distance that a person chooses, and most at a chosen speed."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import single_precision
from archerfish.paper.conditions import Conditions
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Engagement
from archerfish.targets.circle import Circle
from archerfish.targets.drawn import ANY, WAYS, drawn_motion
from archerfish.targets.motion import TargetMotion
from archerfish.targets.own_motion import CHANCES, OwnMotion, check_paths
from archerfish.targets.parabola import Parabola
from archerfish.targets.passing import Line
from archerfish.targets.sinusoid import Sinusoid
from archerfish.targets.still import Static

Floats = NDArray[np.float64]

HAND = "dragged by hand"
"""The motion that no formula gives."""
RADIUS = 0.25
"""Of the circle [m]."""
SWING = (0.0, 0.3, 0.06)
"""Amplitude of the swing [m]."""
LARGEST_LATERAL = 0.25
"""Targets are at most this share of their distance to the side: the first slew is of a robot that faces them."""


class Draw(NamedTuple):
    """What chance gives to each of n targets."""

    place: Floats
    """Middle of its way [m], shape (n, 3)."""
    speed: float
    """[m/s]."""
    phase: Floats
    """Part of the cycle gone at time zero, 0…1, shape (n,)."""
    side: Floats
    """Way of going: −1 to the right, 1 to the left, shape (n,)."""
    chance: Floats
    """Uniform draws for motions with parameters of their own, shape (n, as many as `drawn.ANY` takes)."""


def _still(draw: Draw, conditions: Conditions) -> TargetMotion:  # noqa: ARG001
    return Static(draw.place)


def _parabola(draw: Draw, conditions: Conditions) -> TargetMotion:
    ones = np.ones_like(draw.phase)
    half_width = conditions.reversal_half_width * ones
    return Parabola(draw.place, draw.speed * ones, draw.phase, half_width, conditions.parabola_curvature * ones)


def _line(draw: Draw, conditions: Conditions) -> TargetMotion:
    velocity = np.stack([0.0 * draw.side, draw.speed * draw.side, 0.0 * draw.side], axis=-1)
    # It passes its place in the middle of the engagement.
    return Line(draw.place - 0.5 * conditions.engagement_s * velocity, velocity)


def _circle(draw: Draw, conditions: Conditions) -> TargetMotion:  # noqa: ARG001
    radius = RADIUS * np.ones_like(draw.side)
    return Circle(draw.place, radius, draw.side * draw.speed / RADIUS, 2.0 * np.pi * draw.phase)


def _swing(draw: Draw, conditions: Conditions) -> TargetMotion:  # noqa: ARG001
    amplitude = np.asarray(SWING) * np.ones_like(draw.place)
    frequency = draw.speed / np.linalg.norm(SWING) * np.ones_like(draw.phase)
    return Sinusoid(draw.place, amplitude, frequency, 2.0 * np.pi * draw.phase)


def _drawn(name: str) -> Callable[[Draw, Conditions], TargetMotion]:
    def build(draw: Draw, conditions: Conditions) -> TargetMotion:
        motion: TargetMotion = drawn_motion(name).path(
            draw.place, draw.chance, np.full(len(draw.place), conditions.engagement_s)
        )
        return motion

    return build


DRAWN_MOTIONS = {
    f"drawn-{name}" if name in ("parabola", "circle") else name: name for name in (*WAYS, ANY) if name != "still"
}
"""Name on the page → name in `targets.drawn`: motions whose speeds, too, are drawn."""
MOTIONS: dict[str, Callable[[Draw, Conditions], TargetMotion]] = {
    "parabola (the paper's)": _parabola,
    "still": _still,
    "straight across": _line,
    "circle": _circle,
    "swing": _swing,
    **{shown: _drawn(name) for shown, name in DRAWN_MOTIONS.items()},
}
"""Name on the page → builder."""


def meet(
    motion: str,
    distance: float,
    speed: float,
    conditions: Conditions,
    count: int,
    plants: int,
    seed: int,
    own: Mapping[str, OwnMotion] = MappingProxyType({}),
) -> Engagement:
    """Draw the engagements of a trial; who shoots does not enter, so two controllers meet the same ones.

    Args:
      motion: one of `MOTIONS` or of `own`. It may be the word of a stranger at the page: nothing is looked up by it
        but these.
      distance: of the middle of the targets' way [m].
      speed: of the targets [m/s]; those of `DRAWN_MOTIONS` have speeds of their own.
      conditions: height, offsets, start of the gimbal.
      count: n engagements.
      plants: number of posterior draws of the world's plant.
      seed: of the draws.
      own: name → motion of the user's own, found beforehand.

    Raises:
      InputError: if the motion is unknown, or its code fails.
    """
    side, phase, way, plant = np.random.default_rng([seed, 71]).random((4, count))
    reach = min(conditions.max_lateral_offset, LARGEST_LATERAL * distance)
    place = np.stack(
        [np.full(count, distance), reach * (2.0 * side - 1.0), np.full(count, conditions.armor_height)], axis=-1
    )
    if motion in MOTIONS:
        # 72 and 73 are of the dispersion, in films and by hand.
        chance = np.random.default_rng([seed, 75]).random((count, drawn_motion(ANY).chances))
        targets = MOTIONS[motion](Draw(place, speed, phase, np.where(way < 0.5, -1.0, 1.0), chance), conditions)
    elif motion in own:
        targets = _own(own[motion], place, speed, conditions, np.random.default_rng([seed, 74]))
    else:
        raise InputError(f"motion must be one of {', '.join((*MOTIONS, *own))}, got {motion!r}")
    start = np.broadcast_to([conditions.start_pitch, conditions.start_yaw], (count, 2))
    built: Engagement = single_precision(Engagement(targets, start, np.floor(plant * plants).astype(np.int32)))
    return built


def _own(
    motion: OwnMotion, place: Floats, speed: float, conditions: Conditions, generator: np.random.Generator
) -> TargetMotion:
    count = len(place)
    chance = generator.random((count, CHANCES))
    targets: TargetMotion = motion.drawer.draw(place, np.full(count, speed), chance)
    check_paths(motion, targets, conditions.engagement_s)
    return targets

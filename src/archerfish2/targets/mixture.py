"""Paths of drawn motions, one kind alone or "any": all of them and eq (7), mixed by weights and varied.

Without variations a policy takes slow targets for those of eq (7), the only slow ones in its training, and is wrong
about targets that do two things at once.
"""

from itertools import accumulate

from archerfish2.arrays import Array, lift, namespace
from archerfish2.targets.distributions import LARGEST_SPEED, VARIATION, along, draw_parameters
from archerfish2.targets.kinds import KINDS, UNIFORMS, eq_7, sine
from archerfish2.targets.motion import BEGIN_S, FLIGHT_S, STEP_S, TIMES, Path

ANY = "any"
WEIGHTS = (3.0, 1.5, 5.0, 1.0, 5.0, 0.6, 0.6, 2.0, 6.0)
"""How often "any" draws each kind, in the table's order, and eq (7). Motions where a classical tracker is nearly best
count more, for there a policy has most to lose; with equal weights it takes every target that stops for one that turns
back. Chosen on draws that no evaluation has."""
_STARTS = tuple(accumulate((each / sum(WEIGHTS) for each in WEIGHTS), initial=0.0))[:-1]
LARGEST_LATERAL, LARGEST_FORWARD = 1.2, 0.4
"""Largest displacement to the side and towards the gimbal, as shares of the distance: 50° to either side, where the yaw
axis ends at 75°, and never nearer than 0.6 of the distance that the cell names."""
SLOWER, SWAYING = 0.15, 0.2
"""Shares of the targets that are slower, and that sway; chosen on draws that no evaluation has."""


def path_uniforms(name: str) -> int:
    """Return how many uniform draws a path takes: which kind, the kind's, the variation's; none for "paper"."""
    return {"paper": 0, ANY: 3 + UNIFORMS + len(VARIATION)}.get(name, 1 + UNIFORMS)


def drawn_path(name: str, place: Array, uniforms: Array, duration: Array, swing: tuple[Array, Array, Array]) -> Path:
    """Draw paths.

    Args:
      name: "any" or one of `kinds.KINDS`.
      place: middle or begin of the path [m], shape B + (3,).
      uniforms: shape B + (path_uniforms(name),).
      duration: of the engagement [s], shape B.
      swing: largest speed [m/s], half width [m] and rise [m] of the targets of eq (7) in "any", shape () each.
    """
    xp = namespace(place, uniforms)
    drawn = uniforms[..., 1:]
    if name != ANY:
        return path_about(place, KINDS[name](drawn, duration), duration)
    displacement: Array = 0.0
    for kind, start in zip(KINDS.values(), _STARTS, strict=False):
        displacement = xp.where((uniforms[..., 0] >= start)[..., None, None], kind(drawn, duration), displacement)
    # Eq (7) is not varied.
    displacement = varied(displacement, uniforms[..., 1 + UNIFORMS :])
    mine = (uniforms[..., 0] >= _STARTS[-1])[..., None, None]
    return path_about(place, xp.where(mine, eq_7(drawn, *swing), displacement), duration)


def varied(displacement: Array, uniforms: Array) -> Array:
    """Make some targets slower, and let others sway along a line about their path.

    Args:
      displacement: level, at `motion.TIMES` [m], shape B + (N, 2).
      uniforms: uniform draws: slower or swaying, the variation's parameters, the phase, shape B + (6,).
    """
    xp, which = namespace(displacement, uniforms), uniforms[..., 0]
    pace, amplitude, frequency, heading = draw_parameters(VARIATION, uniforms[..., 1:])
    slower = at_pace(displacement, xp.where(which < SLOWER, pace, 1.0 + 0.0 * pace))
    swaying = xp.where(which >= 1.0 - SWAYING, amplitude, 0.0 * amplitude)[..., None]
    return slower + along(heading, swaying * sine(amplitude, frequency, uniforms[..., 5]))


def at_pace(displacement: Array, pace: Array) -> Array:
    """Return displacements at a share of their speed, the same at time zero.

    Args:
      displacement: at `motion.TIMES` [m], shape B + (N, 2).
      pace: share, 0…1, shape B.
    """
    xp = namespace(displacement, pace)
    times = xp.reshape(xp.asarray(TIMES, dtype=displacement.dtype), (-1,) + (1,) * pace.ndim)
    slowed = Path(displacement, 0.0 * pace + BEGIN_S, 0.0 * pace + STEP_S)
    return xp.moveaxis(slowed.position(lift(pace, times) * times), 0, -2)


def path_about(place: Array, displacement: Array, duration: Array) -> Path:
    """Return the path of targets about their places, within the largest speed and displacement.

    A target that would be too fast, or go too far, keeps the shape of its path, which is made smaller.

    Args:
      place: middle or begin of the path [m], shape B + (3,).
      displacement: level, from there, at `motion.TIMES` [m], shape B + (N, 2).
      duration: of the engagement [s], shape B or (); what comes after it and the last flight does not count.
    """
    xp = namespace(place, displacement)
    time = lift(xp.asarray(TIMES, dtype=displacement.dtype), displacement[..., 0])
    counts = time <= xp.asarray(duration)[..., None] + FLIGHT_S
    distance = place[..., 0]
    forward, lateral = (xp.max(xp.where(counts, xp.abs(displacement[..., at]), 0.0), axis=-1) for at in (0, 1))
    moved = xp.sqrt(xp.sum((displacement[..., 1:, :] - displacement[..., :-1, :]) ** 2, axis=-1))
    speed = xp.max(xp.where(counts[..., 1:], moved, 0.0), axis=-1) / STEP_S
    excess = xp.maximum(forward / (LARGEST_FORWARD * distance), lateral / (LARGEST_LATERAL * distance))
    less = 1.0 / xp.maximum(xp.maximum(excess, speed / LARGEST_SPEED), 1.0)
    level = place[..., None, :2] + less[..., None, None] * displacement
    places = xp.astype(xp.concat([level, place[..., None, 2:] + 0.0 * level[..., :1]], axis=-1), place.dtype)
    return Path(places, 0.0 * distance + BEGIN_S, 0.0 * distance + STEP_S)

"""Paths of drawn motions: one kind alone, or a mixture of several.

In a mixture the kinds of the table are varied: without that a policy takes slow targets for those of eq (7), the only
slow ones in its training, and is wrong about targets that do two things at once.
"""

from archerfish.arrays import Array, lift, namespace
from archerfish.targets.distributions import LARGEST_SPEED, VARIATION, along, draw_parameters
from archerfish.targets.kinds import KIND_DRAWS, KINDS, eq_7, sine
from archerfish.targets.motion import BEGIN_S, FLIGHT_S, STEP_S, TIMES, Path
from archerfish.targets.process import PROCESS_UNIFORMS, random_process

_SMOOTH = {"still": 2.0, "parabola": 6.0, "pass": 5.0, "sinusoid": 4.0, "circle": 4.0, "singer": 3.0}
MIXTURES = {
    "any": {**_SMOOTH, "eq 7": 26.0, "process": 57.0},
    "kinds": {**dict(zip(KINDS, (3.0, 1.5, 5.0, 1.0, 5.0, 0.6, 0.6, 2.0), strict=True)), "eq 7": 6.0},
}
"""Mixture → kind → how often it is drawn. Those of the table come first, and are varied.

"any": whatever robots do. The process is there for motions that are not in the table: more of it costs hits on those
that are, less of it costs hits on targets that wait, dash and stagger (docs/any_motion.md has what was measured).
"kinds": the table and eq (7). Motions where a classical tracker is nearly best count more, for there a policy has most
to lose; with equal weights it takes every target that stops for one that turns back. Chosen on draws that no
evaluation has."""
LARGEST_LATERAL, LARGEST_FORWARD = 1.2, 0.4
"""Largest displacement to the side and towards the gimbal, as shares of the distance: 50° to either side, where the yaw
axis ends at 75°, and never nearer than 0.6 of the distance that the cell names."""
_VARIED = 2 + len(VARIATION)  # uniform draws of the variation
SLOWER, SWAYING = 0.15, 0.2
"""Shares of the targets that are slower, and that sway; chosen on draws that no evaluation has."""


def path_uniforms(name: str) -> int:
    """Return how many uniform draws a path takes: which kind, the kind's, the variation's; none for "paper"."""
    of_kind = PROCESS_UNIFORMS if name == "any" else KIND_DRAWS
    return 0 if name == "paper" else 1 + of_kind + _VARIED * (name in MIXTURES)


def drawn_path(name: str, place: Array, uniforms: Array, duration: Array, swing: tuple[Array, Array, Array]) -> Path:
    """Draw paths.

    Args:
      name: of `MIXTURES` or `kinds.KINDS`.
      place: middle or begin of the path [m], shape B + (3,).
      uniforms: shape B + (path_uniforms(name),).
      duration: of the engagement [s], shape B.
      swing: largest speed [m/s], half width [m] and rise [m] of the targets of eq (7) in a mixture, shape () each.
    """
    xp, drawn, mixture = namespace(place, uniforms), uniforms[..., 1:], MIXTURES.get(name, {name: 1.0})
    functions = {**KINDS, "eq 7": lambda draws, _: eq_7(draws, *swing), "process": random_process}
    start, which, displacement = 0.0, uniforms[..., 0, None, None], 0.0 * drawn[..., :1, None]
    for kind, weight in mixture.items():
        if kind == "eq 7":
            displacement = varied(displacement, uniforms[..., -_VARIED:])
        displacement = xp.where(which >= start, functions[kind](drawn, duration), displacement)
        start += weight / sum(mixture.values())
    return path_about(place, displacement, duration)


def varied(displacement: Array, uniforms: Array) -> Array:
    """Make some targets slower, and let others sway along a line about their path.

    Args:
      displacement: level, at `motion.TIMES` [m], shape B + (N, 2).
      uniforms: uniform draws: slower or swaying, the variation's parameters, the phase, shape B + (6,).
    """
    xp, which = namespace(displacement, uniforms), uniforms[..., 0]
    pace, amplitude, frequency, heading = draw_parameters(VARIATION, uniforms[..., 1:])
    pace = xp.where(which < SLOWER, pace, 1.0 + 0.0 * pace)
    times = xp.reshape(xp.asarray(TIMES, dtype=displacement.dtype), (-1,) + (1,) * pace.ndim)
    slower = Path(displacement, 0.0 * pace + BEGIN_S, 0.0 * pace + STEP_S).position(lift(pace, times) * times)
    swaying = xp.where(which >= 1.0 - SWAYING, amplitude, 0.0 * amplitude)[..., None]
    return xp.moveaxis(slower, 0, -2) + along(heading, swaying * sine(amplitude, frequency, uniforms[..., 5]))


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

"""Eq (7): to and fro on a parabola."""

from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.paper.conditions import assumed_conditions
from archerfish.targets.distributions import draw_parameters
from archerfish.targets.path import TIMES


class Parabola(NamedTuple):
    """Eq (7): to and fro on x = X₀ + c (y − Y₀)², turning back where |y − Y₀| reaches the half width.

    Eq (7) prints X₀ − 0.04 ≤ x ≤ X₀ + 0.04, but x never falls below X₀ on this parabola; only the upper bound acts
    (docs/errata.md).
    """

    vertex: Array
    """X₀, Y₀ and the constant height [m], shape B + (3,)."""
    speed: Array
    """Lateral speed |ẏ| [m/s], shape B; zero stands still."""
    phase: Array
    """Part of the cycle gone at time zero, 0…1, shape B; 0 is at the right-hand turn, moving left."""
    half_width: Array
    """Largest |y − Y₀| [m], shape B."""
    curvature: Array
    """c [1/m], shape B."""

    def position(self, time: Array) -> Array:
        """Return the position [m] at a time [s], shape B + (3,)."""
        xp = namespace(self.vertex, time)
        lateral = self.half_width * triangle_wave(self.phase + self.speed * time / (4.0 * self.half_width))
        vertex = self.vertex + 0.0 * lateral[..., None]
        forward = vertex[..., 0] + self.curvature * lateral**2
        return xp.stack([forward, vertex[..., 1] + lateral, vertex[..., 2]], axis=-1)


def triangle_wave(cycles: Array) -> Array:
    """Triangle wave of period one between −1 (at whole cycles) and 1, shape B."""
    xp = namespace(cycles)
    return 1.0 - 4.0 * xp.abs(cycles - xp.floor(cycles) - 0.5)


def paper_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw eq (7) with the paper's width and curvature, at the speeds of its tables, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    conditions = assumed_conditions()
    width, speed = conditions.reversal_half_width, conditions.max_lateral_speed * chance[..., 0, None]
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), speed)
    share = triangle_wave(chance[..., 1, None] + speed * time / (4.0 * width))
    return xp.stack([conditions.parabola_rise * share**2, width * share], axis=-1)


def parabola_way(chance: Array, duration: Array) -> Array:  # noqa: ARG001 (as every motion's)
    """Draw eq (7) with a width, a speed and a curvature of each target's own, shape B + (n,) → B + (N, 2)."""
    xp = namespace(chance)
    half_width, turns, rise = (each[..., None] for each in draw_parameters("parabola", chance))
    time = lift(xp.asarray(TIMES, dtype=chance.dtype), half_width)
    share = triangle_wave(chance[..., 3, None] + time / (2.0 * turns))
    return xp.stack([rise * share**2, half_width * share], axis=-1)

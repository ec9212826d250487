"""The eight kinds of motion, and eq (7) as level paths: displacements at `motion.TIMES` [m] of uniform draws.

Each is a function of uniform draws, shape B + (n,), and of the engagement's duration [s], shape B; it returns
displacements from the target's place, shape B + (N, 2).
"""

import itertools
import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from archerfish2.arrays import Array, lift, namespace
from archerfish2.targets.distributions import LARGEST_ACCELERATION, TABLE, along, draw_parameters
from archerfish2.targets.motion import BEGIN_S, STEP_S, TIMES, ZERO, triangle_wave

_SHORTEST_RAMP_S = 1e-3  # shortest time that a change of velocity takes
_LEGS = 12  # turns, or starts and stops, that are drawn; after the last a target continues as it moves
_KNOT_S = 0.2  # between moments at which Singer's acceleration is drawn, linear between them
_KNOTS = 1 + math.ceil((float(TIMES[-1]) - BEGIN_S) / _KNOT_S - 1e-9)
_FORWARD_SHARE = 0.5  # of Singer's acceleration towards the gimbal, to that across the line of sight
UNIFORMS = 4 + 2 * _KNOTS
"""Uniform draws of the kind that needs most."""


def _still(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001 (as every kind's)
    """No displacement."""
    return 0.0 * uniforms[..., :1, None] + lift(np.zeros((len(TIMES), 2), np.float32), uniforms[..., None])


def eq_7(uniforms: Array, speed: Array, half_width: Array, rise: Array) -> Array:
    """Eq (7) at lateral speeds from zero.

    Args:
      uniforms: of speed and phase, shape B + (2,) or more.
      speed: largest lateral speed [m/s], shape ().
      half_width: where targets turn back [m], shape ().
      rise: x − X₀ there [m], shape ().
    """
    lateral = speed * uniforms[..., 0, None]
    return _swing(uniforms[..., 1, None] + lateral * _times(lateral) / (4.0 * half_width), half_width, rise)


def _parabola(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Eq (7) with width, speed and curvature of each target."""
    half_width, turns, rise = (each[..., None] for each in draw_parameters(TABLE["parabola"], uniforms))
    return _swing(uniforms[..., 3, None] + _times(turns) / (2.0 * turns), half_width, rise)


def _straight(uniforms: Array, duration: Array) -> Array:
    """Straight lines that pass the place at some moment of the engagement."""
    xp = namespace(uniforms)
    speed, heading = draw_parameters(TABLE["pass"], uniforms)
    to_left = xp.where(uniforms[..., 2] < 0.5, 0.0, math.pi)
    time = _times(speed[..., None])
    return along(heading + to_left, speed[..., None] * (time - (duration * uniforms[..., 3])[..., None]))


def _strafe(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """To and fro at one speed, with turns at random times."""
    xp = namespace(uniforms)
    speed, heading, mean, irregularity, acceleration = draw_parameters(TABLE["strafe"], uniforms)
    to_left = xp.where(uniforms[..., 5] < 0.5, 0.0, math.pi)
    ends = leg_ends(mean, irregularity, uniforms[..., 7 : 7 + _LEGS], uniforms[..., 6])
    changes = speed[..., None] * lift(xp.asarray([-2.0, 2.0] * (_LEGS // 2), dtype=uniforms.dtype), ends)
    return along(heading + to_left, driven(speed, changes, ends, acceleration))


def _stop_and_go(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Driving and stopping in turn, each time to either side."""
    xp = namespace(uniforms)
    speed, heading, mean, irregularity, acceleration = draw_parameters(TABLE["stop-and-go"], uniforms)
    ends = leg_ends(mean, irregularity, uniforms[..., 7 : 7 + _LEGS], uniforms[..., 6])
    side = xp.where(uniforms[..., 7 + _LEGS : 8 + _LEGS + _LEGS // 2] < 0.5, -1.0, 1.0)
    # Half of the targets drive when the path begins.
    driving = uniforms[..., 5] < 0.5
    velocity = [xp.where(driving == (leg % 2 == 0), side[..., leg // 2], 0.0) for leg in range(_LEGS + 1)]
    changes = speed[..., None] * xp.stack([after - before for before, after in itertools.pairwise(velocity)], axis=-1)
    return along(heading, driven(speed * velocity[0], changes, ends, acceleration))


def _sinusoid(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Swings along a line."""
    amplitude, frequency, heading = draw_parameters(TABLE["sinusoid"], uniforms)
    return along(heading, amplitude[..., None] * sine(amplitude, frequency, uniforms[..., 3]))


def _circle(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Circles about the place."""
    xp = namespace(uniforms)
    radius, speed = draw_parameters(TABLE["circle"], uniforms)
    rate = xp.minimum(speed, xp.sqrt(LARGEST_ACCELERATION * radius)) / radius
    rate = xp.where(uniforms[..., 2] < 0.5, -rate, rate)
    angle = rate[..., None] * _times(rate[..., None]) + 2.0 * math.pi * uniforms[..., 3, None]
    return radius[..., None, None] * xp.stack([xp.cos(angle), xp.sin(angle)], axis=-1)


def _singer(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Manoeuvres of Singer's model (1970), from the place with some velocity: the acceleration is noise with a memory.

    da/dt = −a / τ + white noise, with the stationary standard deviation σ of a, along and across
    """
    xp = namespace(uniforms)
    speed, heading, sd, memory = draw_parameters(TABLE["singer"], uniforms)
    # Box and Muller: two independent normals of two uniforms, for the two directions.
    one, two = (uniforms[..., 4 + part * _KNOTS : 4 + (part + 1) * _KNOTS] for part in range(2))
    radius = xp.sqrt(-2.0 * xp.log(1.0 - xp.clip(one, 0.0, 1.0 - 1e-6)))
    kept = xp.exp(-_KNOT_S / memory)
    scale = sd * xp.sqrt(1.0 - kept**2)
    integral = xp.asarray(_INTEGRAL, dtype=uniforms.dtype)
    displacements = []
    for turn, share in ((xp.sin, _FORWARD_SHARE), (xp.cos, 1.0)):
        normal = radius * turn(2.0 * math.pi * two)
        acceleration = [sd * normal[..., 0]]
        for knot in range(1, _KNOTS):
            acceleration.append(kept * acceleration[-1] + scale * normal[..., knot])
        displacement = share * (xp.stack(acceleration, axis=-1) @ integral)
        displacements.append(displacement + (speed * turn(heading))[..., None] * _times(speed[..., None]))
    return xp.stack(displacements, axis=-1)


_FUNCTIONS = (_still, _parabola, _straight, _strafe, _stop_and_go, _sinusoid, _circle, _singer)
KINDS: Mapping[str, Callable[[Array, Array], Array]] = dict(zip(TABLE, _FUNCTIONS, strict=True))
"""In the order of the table."""


def leg_ends(mean: Array, irregularity: Array, uniforms: Array, first: Array) -> Array:
    """Draw the moments at which legs end [s], shape B + (L,).

    A leg lasts m ((1 − r) + r E) with an exponentially distributed E: at r = 1 ends come without memory (a Poisson
    process), at r = 0 at equal times.

    Args:
      mean: m, of a leg's length [s], shape B.
      irregularity: r, shape B.
      uniforms: uniform draws, shape B + (L,).
      first: uniform draw: how much of the first leg is left when the path begins, shape B.
    """
    xp = namespace(uniforms)
    exponential = -xp.log(1.0 - xp.clip(uniforms, 0.0, 1.0 - 1e-6))
    lengths = mean[..., None] * ((1.0 - irregularity[..., None]) + irregularity[..., None] * exponential)
    left = xp.concat([first[..., None] * lengths[..., :1], lengths[..., 1:]], axis=-1)
    return BEGIN_S + xp.cumulative_sum(left, axis=-1)


def driven(first: Array, change: Array, moment: Array, acceleration: Array) -> Array:
    """Return the distance along a line at a velocity that changes at some moments, zero at time zero [m], B + (N,).

    Args:
      first: velocity before the first change [m/s], shape B.
      change: of the velocity at each moment, at constant acceleration [m/s], shape B + (L,).
      moment: at which it begins [s], shape B + (L,).
      acceleration: magnitude [m/s²], shape B.
    """
    xp = namespace(change, moment)
    time = _times(first[..., None])
    distance = first[..., None] * time
    ramp = xp.maximum(xp.abs(change) / acceleration[..., None], _SHORTEST_RAMP_S)
    for leg in range(change.shape[-1]):
        begin, length, step = (each[..., leg, None] for each in (moment, ramp, change))
        since = xp.maximum(time - begin, 0.0)
        ramped = xp.minimum(since, length)
        distance = distance + step * (ramped**2 / (2.0 * length) + since - ramped)
    return distance - distance[..., ZERO, None]


def sine(amplitude: Array, frequency: Array, cycles: Array) -> Array:
    """Return sines at `motion.TIMES`, no faster than the largest acceleration allows, shape B + (N,).

    Args:
      amplitude: [m], shape B.
      frequency: [Hz], shape B.
      cycles: phase in cycles, shape B.
    """
    xp = namespace(amplitude)
    rate = xp.minimum(2.0 * math.pi * frequency, xp.sqrt(LARGEST_ACCELERATION / amplitude))[..., None]
    return xp.sin(rate * _times(rate) + 2.0 * math.pi * cycles[..., None])


def _times(array: Array) -> Array:
    """Return `TIMES` with rank and type of an array of shape B + (1,)."""
    return lift(namespace(array).asarray(TIMES, dtype=array.dtype), array)


def _swing(cycles: Array, half_width: Array, rise: Array) -> Array:
    share = triangle_wave(cycles)
    return namespace(share).stack([rise * share**2, half_width * share], axis=-1)


def _integrals() -> NDArray[np.float64]:
    """Return the matrix from accelerations at the knots to displacements at `TIMES`, (K, N), at rest at time zero."""

    def integral(values: NDArray[np.float64]) -> NDArray[np.float64]:
        summed = np.pad(np.cumsum(STEP_S * 0.5 * (values[:, 1:] + values[:, :-1]), axis=1), ((0, 0), (1, 0)))
        return summed - summed[:, ZERO, None]

    share = (TIMES - BEGIN_S) / _KNOT_S
    return integral(integral(np.maximum(1.0 - np.abs(share[None, :] - np.arange(_KNOTS)[:, None]), 0.0)))


_INTEGRAL = _integrals()

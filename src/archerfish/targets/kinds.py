"""The eight kinds of motion, and eq (7) as level paths: displacements at `motion.TIMES` [m] of uniform draws.

Each is a function of uniform draws, shape B + (n,), and of the engagement's duration [s], shape B; it returns
displacements from the target's place, shape B + (N, 2).
"""

import math
from itertools import accumulate

import numpy as np

from archerfish.arrays import Array, lift, namespace
from archerfish.targets.distributions import LARGEST_ACCELERATION, TABLE, along, draw_parameters
from archerfish.targets.motion import BEGIN_S, STEP_S, TIMES, ZERO, triangle_wave

_LEGS = 12  # turns, or starts and stops, that are drawn; after the last a target continues as it moves
_KNOT_S = 0.2  # between moments at which Singer's acceleration is drawn, linear between them
_KNOTS = 1 + math.ceil((float(TIMES[-1]) - BEGIN_S) / _KNOT_S - 1e-9)
KIND_DRAWS = 4 + 2 * _KNOTS
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
    half_width, turns, rise = draw_parameters(TABLE["parabola"], uniforms[..., None, :])
    return _swing(uniforms[..., 3, None] + _times(turns) / (2.0 * turns), half_width, rise)


def _pass(uniforms: Array, duration: Array) -> Array:
    """Straight lines that pass the place at some moment of the engagement."""
    xp = namespace(uniforms)
    speed, heading = draw_parameters(TABLE["pass"], uniforms)
    to_left = xp.where(uniforms[..., 2] < 0.5, 0.0, math.pi)
    time = _times(speed[..., None])
    return along(heading + to_left, speed[..., None] * (time - (duration * uniforms[..., 3])[..., None]))


def _strafe(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """To and fro at one speed, with turns at random times."""
    xp = namespace(uniforms)
    side = xp.asarray([(-1.0) ** leg for leg in range(_LEGS + 1)], dtype=uniforms.dtype)
    heading, distance = _driving("strafe", uniforms, lift(side, uniforms))
    return along(heading + xp.where(uniforms[..., 5] < 0.5, 0.0, math.pi), distance)


def _stop_and_go(uniforms: Array, duration: Array) -> Array:  # noqa: ARG001
    """Driving and stopping in turn, each time to either side."""
    xp, leg = namespace(uniforms), np.arange(_LEGS + 1)
    side = xp.where(uniforms[..., 7 + _LEGS + leg // 2] < 0.5, -1.0, 1.0)
    # Half of the targets drive when the path begins.
    drives = (uniforms[..., 5, None] < 0.5) == lift(xp.asarray(leg % 2 == 0), uniforms)
    return along(*_driving("stop-and-go", uniforms, xp.where(drives, side, 0.0)))


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
    sizes = [sd] + [sd * xp.sqrt(1.0 - kept**2)] * (_KNOTS - 1)
    displacements = []
    # Towards the gimbal half of the acceleration across the line of sight.
    for turn, share in ((xp.sin, 0.5), (xp.cos, 1.0)):
        normal = radius * turn(2.0 * math.pi * two)
        noise = [size * normal[..., knot] for knot, size in enumerate(sizes)]
        acceleration = xp.stack([*accumulate(noise, lambda before, new: kept * before + new)], axis=-1)
        displacement = share * (acceleration @ xp.asarray(_INTEGRAL, dtype=uniforms.dtype))
        displacements.append(displacement + (speed * turn(heading))[..., None] * _times(speed[..., None]))
    return xp.stack(displacements, axis=-1)


KINDS = dict(zip(TABLE, (_still, _parabola, _pass, _strafe, _stop_and_go, _sinusoid, _circle, _singer), strict=True))
"""Name → function, in the order of the table."""


def _driving(name: str, uniforms: Array, share: Array) -> tuple[Array, Array]:
    """Return heading and distance at velocities that are shares of the speed, shape B + (_LEGS + 1,), leg by leg.

    A leg lasts m ((1 − r) + r E) with an exponentially distributed E: at r = 1 ends come without memory (a Poisson
    process), at r = 0 at equal times.
    """
    xp = namespace(uniforms)
    speed, heading, mean, irregularity, acceleration = draw_parameters(TABLE[name], uniforms[..., None, :])
    exponential = -xp.log(1.0 - xp.clip(uniforms[..., 7 : 7 + _LEGS], 0.0, 1.0 - 1e-6))
    lengths = mean * ((1.0 - irregularity) + irregularity * exponential)
    velocity = speed * share
    ramp = xp.abs(velocity[..., 1:] - velocity[..., :-1]) / acceleration
    return heading[..., 0], driven(velocity, lengths, uniforms[..., 6, None], ramp)


def driven(velocity: Array, lengths: Array, left: Array, ramp: Array) -> Array:
    """Return displacements in one direction of targets that drive legs, zero at time zero [m], shape B + (N,).

    Changes of velocity at constant acceleration add up: a leg that is shorter than they are may brake harder.

    Args:
      velocity: of the legs [m/s], shape B + (L + 1,).
      lengths: of the legs but the last [s], shape B + (L,).
      left: share of the first leg that is left when the path begins, shape B + (1,).
      ramp: time that each change of velocity takes [s], shape B + (L,).
    """
    xp, change = namespace(velocity), velocity[..., 1:] - velocity[..., :-1]
    moment = BEGIN_S + xp.cumulative_sum(xp.concat([left * lengths[..., :1], lengths[..., 1:]], axis=-1), axis=-1)
    ramp = xp.maximum(ramp, 1e-3)[..., None]  # no change is sudden
    since = xp.maximum(_times(ramp) - moment[..., None], 0.0)
    ramped = xp.minimum(since, ramp)
    gained = change[..., None] * (ramped**2 / (2.0 * ramp) + since - ramped)
    first = velocity[..., :1, None] * _times(gained)
    # One sum: compiled, a loop over the legs takes ten times as long.
    distance = xp.sum(xp.concat([first, gained], axis=-2), axis=-2)
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


# From Singer's accelerations at the knots to displacements at `TIMES`, (K, N), at rest at time zero: what is linear
# between the knots, integrated twice.
_INTEGRAL = np.maximum(1.0 - np.abs((TIMES - BEGIN_S) / _KNOT_S - np.arange(_KNOTS)[:, None]), 0.0)
for _ in range(2):
    _INTEGRAL = np.pad(np.cumsum(STEP_S * 0.5 * (_INTEGRAL[:, 1:] + _INTEGRAL[:, :-1]), axis=1), ((0, 0), (1, 0)))
    _INTEGRAL = _INTEGRAL - _INTEGRAL[:, ZERO, None]

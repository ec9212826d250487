"""Flight of a pellet: eq (4) corrected, which is the reference, and the closed form that we use in place of eq (5).

The corrected eq (4) is 3-D quadratic drag, v̇ = −k |v| v − g ẑ. It has no closed form. Eq (5) is one, but it treats each
coordinate as if it had a drag of its own, so its result depends on how the axes lie: it changes under a rotation about
the vertical. Flat fire does not: it takes the speed along the line of departure as if gravity did not change it. For
level shots over 5 m at 18 m/s flat fire is off by 0.03 mm, eq (5) by 13 mm straight ahead and by 50 mm at a yaw of 20°.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, namespace

GRAVITY = 9.81
"""Gravity [m/s²]."""


class Crossing(NamedTuple):
    """Where a pellet crosses the vertical plane at a given x."""

    lateral: Array  # y [m], B
    height: Array  # z [m], B
    time: Array  # of flight [s], B


def drag_acceleration(velocity: Array, drag: Array, gravity: float = GRAVITY) -> Array:
    """Acceleration of a pellet with quadratic drag along its velocity: eq (4), corrected (docs/paper.md).

    Args:
      velocity: [m/s], shape B + (3,).
      drag: k [1/m], shape B.
      gravity: [m/s²].

    Returns:
      Acceleration [m/s²], shape B + (3,).
    """
    xp = namespace(velocity, drag)
    speed = xp.sqrt(xp.sum(velocity**2, axis=-1, keepdims=True))
    return -_per_vector(drag, velocity) * speed * velocity - _vertical(velocity) * gravity


def flat_fire_position(velocity: Array, drag: Array, time: Array, gravity: float = GRAVITY) -> Array:
    """Position under quadratic drag whose speed is that of the flight without gravity.

    With v(t) = v₀/(1 + a t), a = k v₀, along the line of departure, the drop below that line solves
    ẇ = −k v(t) w − g, so

        s(t) = log1p(a t)/k,    drop(t) = g [t²/4 + (a t − log1p(a t)) / (2 a²)].

    Args:
      velocity: muzzle velocity [m/s], shape B + (3,).
      drag: k [1/m], shape B.
      time: time of flight [s], shape B.
      gravity: [m/s²].

    Returns:
      Displacement from the muzzle [m], shape B + (3,).
    """
    xp = namespace(velocity, drag, time)
    time = xp.asarray(time)
    speed = xp.sqrt(xp.sum(velocity**2, axis=-1))
    along = _log1p_over(drag, speed * time)
    drop = flat_fire_drop(time, drag * speed, gravity)
    return velocity * (along / speed)[..., None] - _vertical(velocity) * drop[..., None]


def flat_fire_drop(time: Array, decay: Array, gravity: float = GRAVITY) -> Array:
    """Drop below the line of departure after a time of flight.

    Args:
      time: [s], shape B.
      decay: a = k v₀ [1/s], shape B.
      gravity: [m/s²].

    Returns:
      Drop [m], shape B; g t²/2 without drag.
    """
    return gravity * time**2 * (0.25 + 0.5 * _log_remainder(decay * time))


def flat_fire_time(distance: Array, speed: Array, drag: Array) -> Array:
    """Time to fly a distance along the line of departure, expm1(k s) / (k v₀) [s], shape B."""
    return _expm1_over(drag, distance) / speed


def flat_fire_crossing(position: Array, velocity: Array, plane_x: Array, drag: Array) -> Crossing:
    """Cross the plane x = plane_x by the flat-fire closed form: the default flight model.

    Args:
      position: muzzle position [m], shape B + (3,).
      velocity: muzzle velocity [m/s], shape B + (3,); its x must be positive for the plane to be reached.
      plane_x: x of the plane [m], shape B.
      drag: k [1/m], shape B.
    """
    xp = namespace(position, velocity, plane_x)
    speed = xp.sqrt(xp.sum(velocity**2, axis=-1))
    distance = (plane_x - position[..., 0]) * speed / velocity[..., 0]
    time = flat_fire_time(distance, speed, drag)
    end = position + velocity * (distance / speed)[..., None]
    return Crossing(end[..., 1], end[..., 2] - flat_fire_drop(time, drag * speed), time)


def runge_kutta_4(slope: Callable[[Array], Array], state: Array, stride: Array) -> Array:
    """Advance an autonomous differential equation by one classical Runge–Kutta step.

    Args:
      slope: derivative of a state, shape preserved.
      state: any shape.
      stride: step of the independent variable, broadcast against the state.
    """
    k1 = slope(state)
    k2 = slope(state + 0.5 * stride * k1)
    k3 = slope(state + 0.5 * stride * k2)
    k4 = slope(state + stride * k3)
    return state + stride / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def quadratic_crossing(position: Array, velocity: Array, plane_x: Array, drag: Array, steps: int = 24) -> Crossing:
    """Cross the plane x = plane_x by 3-D quadratic drag: Runge–Kutta 4 over x, the reference model.

    Args:
      position: muzzle position [m], shape B + (3,).
      velocity: muzzle velocity [m/s], shape B + (3,); its x must be positive.
      plane_x: x of the plane [m], shape B.
      drag: k [1/m], shape B.
      steps: Runge–Kutta steps; 24 leave less than 1e-8 m over 10 m.
    """
    xp = namespace(position, velocity, plane_x)
    stride = ((plane_x - position[..., 0]) / steps)[..., None]
    state = xp.concat([position[..., 1:], 0.0 * position[..., :1], velocity], axis=-1)  # y, z, t, v

    def slope(state: Array) -> Array:
        velocity = state[..., 3:]
        one = 0.0 * velocity[..., :1] + 1.0
        per_time = xp.concat([velocity[..., 1:], one, drag_acceleration(velocity, drag)], axis=-1)
        return per_time / velocity[..., :1]

    for _ in range(steps):
        state = runge_kutta_4(slope, state, stride)
    return Crossing(state[..., 0], state[..., 1], state[..., 2])


def _per_vector(parameter: Array, vector: Array) -> Array:
    """Give a parameter of shape B the rank and type of the vectors, shape B + (3,), that it scales."""
    xp = namespace(parameter, vector)
    return lift(xp.asarray(parameter, dtype=vector.dtype)[..., None], vector)


def _vertical(vector: Array) -> Array:
    return lift(namespace(vector).asarray([0.0, 0.0, 1.0], dtype=vector.dtype), vector)


_SERIES_BELOW, _POWERS_BELOW, _POWERS = 0.5, 0.25, 9


def _log1p_over(drag: Array, distance: Array) -> Array:
    """log1p(k x)/k for k ≥ 0, with the limit x for k → 0."""
    return distance * (1.0 - drag * distance * _log_remainder(drag * distance))


def _expm1_over(drag: Array, distance: Array) -> Array:
    """expm1(k x)/k for k ≥ 0, with the limit x for k → 0.

    A power series where z = k x is small, as it is for pellets: it is sure to the last bit, where the functions of
    libraries differ by several. What is left out is below 2e-14 of it.
    """

    def series(z: Array) -> Array:
        found = 0.0 * z + 1.0
        for power in range(_POWERS, 0, -1):
            found = 1.0 + z * found / (power + 1)
        return found

    return distance * _by_size(drag * distance, _POWERS_BELOW, series, lambda z: namespace(z).expm1(z) / z)


def _log_remainder(z: Array) -> Array:
    """(z − log1p(z)) / z², which is 1/2 at z = 0; the difference cancels there, so a series takes over.

    With s = z / (2 + z), log1p(z) = 2 (s + s³/3 + s⁵/5 + …) and z − 2 s = z² / (2 + z): what cancels is gone, and s is
    small. Six terms leave less than 1e-9 of it below z = 1/2.
    """

    def series(z: Array) -> Array:
        inverse = 1.0 / (2.0 + z)
        square = (z * inverse) ** 2
        terms = 1 / 3 + square * (1 / 5 + square * (1 / 7 + square * (1 / 9 + square * (1 / 11 + square / 13))))
        return inverse - 2.0 * z * inverse**3 * terms

    return _by_size(z, _SERIES_BELOW, series, lambda z: (z - namespace(z).log1p(z)) / z**2)


def _by_size(z: Array, bound: float, near: Callable[[Array], Array], far: Callable[[Array], Array]) -> Array:
    """Return near(z) where |z| is below a bound, else far(z); neither meets what is not its own."""
    xp = namespace(z)
    small = xp.abs(z) < bound
    if xp is np and small.all():
        return near(z)
    return xp.where(small, near(xp.where(small, z, 0.0)), far(xp.where(small, 1.0, z)))

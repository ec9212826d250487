"""What shots are expected to show by eq (6) and the simulator's flight, and how that depends on the muzzle.

With v ~ N(μ_v, σ_v²) and δ ~ N(μ_0, σ_0²) a landing distance, or the height of a hit, f(v, pitch + δ) has by the delta
method (second order in the mean, first in the variance)

    E = f + (f_vv σ_v² + f_δδ σ_0²)/2,    Var = f_v² σ_v² + f_δ² σ_0²,

with f and its derivatives at (μ_v, pitch + μ_0). Where the speed of a shot was measured, f is taken at that speed, and
the terms of σ_v vanish.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from archerfish2.dynamics.muzzle import direction
from archerfish2.dynamics.pellet import GRAVITY, flat_fire_crossing, flat_fire_position
from archerfish2.identification.statistics import Array
from archerfish2.logs.shots import Shots

RANGES = {"speed": (1.0, 35.0), "pitch_offset": (-0.35, 0.35), "height": (0.01, 3.0), "drag": (0.0, 0.3)}
SHAPING, SPREADS = tuple(RANGES), ("speed_sd", "pitch_sd")
"""Parameters of the expected measurements, and of their scatter."""
RANGES |= {"speed_sd": (0.0, 5.0), "pitch_sd": (0.0, 0.35), "length": (0.0, 2.0)}
RANGES |= {"yaw_offset": (-1.6, 1.6), "yaw_sd": (0.0, 1.6)}
"""Where each parameter is sought or may be given, in SI units; no referee system allows more than 30 m/s."""

_STEPS = np.array([2e-2, 1e-3, 1e-3, 1e-4])
"""Of the differences by the parameters in `SHAPING`, in SI units: large enough for second derivatives."""
_NEWTON_STEPS = 5
"""Leave less than 1e-6 m of height wherever parameters are sought."""


class Response(NamedTuple):
    """Expected measurements of N shots without dispersion, and their derivatives."""

    mean: Array  # f [m], (N,)
    slopes: Array  # by the parameters in `SHAPING`, (N, 4)
    scales: Array  # variance per unit variance of the c spreads, (N, c): f_v² and f_δ², or f_δ² alone
    curvatures: Array  # second derivatives, f_vv and f_δδ, or f_δδ alone, (N, c)


def linearised(shots: Shots, values: Mapping[str, float]) -> Response:
    """Return the expected measurements of N shots at given parameters, differentiated by central differences."""
    moves = np.vstack([0 * _STEPS, np.diag(_STEPS), np.diag(-_STEPS)])
    moved = {name: values[name] + moves[:, [column]] for column, name in enumerate(SHAPING)}
    mean, above, below = np.split(expected_vertical(shots, {**values, **moved}), [1, 5])
    slopes, curvatures = (above - below) / (2 * _STEPS[:, None]), (above - 2 * mean + below) / _STEPS[:, None] ** 2
    spreads = slice(shots.speed is not None, 2)
    scales = slopes[spreads].T ** 2
    # Where a measurement hardly depends on the angle (or the speed), the first order vanishes.
    return Response(mean[0], slopes.T, np.maximum(scales, 1e-6 * scales.mean(0) + 1e-12), curvatures[spreads].T)


def expected_vertical(shots: Shots, values: Mapping[str, Any]) -> Array:
    """Return the vertical measurements without dispersion [m], shape (N,), or (R, N).

    Args:
      shots: N settings, and measured speeds if there are any.
      values: parameters in SI units, those of `SHAPING` and the length, shape () or (R, 1); to measured speeds the
        value of "speed" is added.
    """
    speed = values["speed"] + (0.0 if shots.speed is None else shots.speed)
    angle = shots.pitch + values["pitch_offset"]
    if shots.hit_height is None:
        # A muzzle ahead of the pivot rises with the barrel: by 14 mm at 5° and 0.16 m, which would pass for an offset.
        return landing_distance(speed, angle, values["height"] + values["length"] * np.sin(shots.pitch), values["drag"])
    sideways = shots.yaw if shots.lateral is None else np.arctan2(shots.lateral, shots.distance)
    speed, angle, sideways = np.broadcast_arrays(speed, angle, sideways)
    velocity = speed[..., None] * direction(np.stack([angle, sideways], axis=-1))
    return np.asarray(flat_fire_crossing(0 * velocity, velocity, shots.distance, values["drag"]).height)


def landing_distance(speed: Array, angle: Array, height: Array, drag: Array) -> Array:
    """Horizontal distance from the muzzle to the landing point on level ground, by the flat-fire flight.

    The time of flight solves h + sin(angle) log1p(k v t)/k − drop(t) = 0, by Newton's method from that without drag,
    (v_z + √(v_z² + 2 g h))/g. Departs from eq (5), which has no drag in z. Against quadratic drag in three dimensions
    it is right to 1.3 mm or 0.04 % for slopes within 5°, to 0.7 % at 15° (k = 0.019 1/m, 10–30 m/s, up to 1 m high).

    Args:
      speed: muzzle speed [m/s], shape B.
      angle: elevation of departure [rad], shape B.
      height: of the muzzle above the ground [m], shape B.
      drag: k [1/m], shape B.

    Returns:
      Distance [m], shape B.
    """
    speed, angle, height, drag = np.broadcast_arrays(speed, angle, height, drag)
    velocity = speed[..., None] * direction(np.stack([angle, 0 * angle], axis=-1))
    rise = velocity[..., 2]
    time = (rise + np.sqrt(rise**2 + 2 * GRAVITY * height)) / GRAVITY
    for _ in range(_NEWTON_STEPS):
        slowing = 1 / (1 + drag * speed * time)
        # The derivative of flat_fire_drop is g t (1 + 1/(1 + k v t))/2.
        climb = rise * slowing - 0.5 * GRAVITY * time * (1 + slowing)
        time = time - (height + flat_fire_position(velocity, drag, time)[..., 2]) / climb
    return np.asarray(flat_fire_position(velocity, drag, time)[..., 0])


def measured_vertical(shots: Shots) -> Array:
    """Return what the elevation of departure decides: landing distance or height of the hit [m], shape (N,)."""
    return np.asarray(shots.distance if shots.hit_height is None else shots.hit_height)


def azimuth(shots: Shots) -> Array | None:
    """Return the azimuth of each departure against the barrel's [rad], shape (N,); None without lateral distances."""
    if shots.lateral is None or shots.hit_height is None:
        return None if shots.lateral is None else np.arcsin(np.clip(shots.lateral / shots.distance, -1.0, 1.0))
    return np.asarray(np.arctan2(shots.lateral, shots.distance) - shots.yaw)

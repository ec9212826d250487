"""What a shot is expected to show, by eq (6) and a flight model, and how that depends on the muzzle's parameters.

With v ~ N(μ_v, σ_v²) and δ₀ ~ N(μ_0, σ_0²) a landing distance (or the height of a hit) f(v, pitch + δ₀) has, by the
delta method (second order in the mean, first in the variance),

    E = f + (f_vv σ_v² + f_δδ σ_0²)/2,    Var = f_v² σ_v² + f_δ² σ_0²,

with f and its derivatives at (μ_v, pitch + μ_0). Where the speed of a shot was measured, f is taken at that speed and
the terms of σ_v vanish; measured speeds count as exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.pellet import flat_fire_crossing, printed_crossing
from archerfish.identification.muzzle.landing import landing_distance, printed_landing_distance
from archerfish.records.shots import Shots

Array = NDArray[np.float64]

Flight = Literal["flat-fire", "eq-5"]
"""The simulator's flight, or eq (5) as printed, which has no drag in z."""

SHAPING = ("speed", "pitch_offset", "height", "drag")
"""Parameters that shape the mean distances."""
SPREADS = ("speed_sd", "pitch_sd")

RANGES: dict[str, tuple[float, float]] = {
    "speed": (1.0, 35.0),
    "speed_sd": (0.0, 5.0),
    "pitch_offset": (-0.35, 0.35),
    "pitch_sd": (0.0, 0.35),
    "height": (0.01, 3.0),
    "drag": (0.0, 0.3),
    "length": (0.0, 2.0),
}
"""Where each parameter is sought or may be given, in SI units; no referee system allows more than 30 m/s."""

TYPICAL = np.array([0.5, 0.01]) ** 2
"""Variances of speed [(m/s)²] and elevation [rad²] that a search begins with; only their ratio matters."""

_STEPS = {"speed": 1e-3, "pitch_offset": 1e-3, "height": 1e-3, "drag": 1e-4}
"""Of the central differences: a share of the speed, else SI units. They are large enough for second derivatives; the
error of the first ones is of their square."""


@dataclass(frozen=True)
class MuzzleProblem:
    """Shots, and what is known of the muzzle."""

    shots: Shots
    """The shots."""
    known: Mapping[str, float]
    """Parameters that are given, in SI units; the height is always given for hits on a plane."""
    flight: Flight = "flat-fire"
    """How pellets fly."""

    @property
    def free(self) -> tuple[str, ...]:
        """Parameters of the mean distances that are estimated from them."""
        measured = {"speed"} if self.shots.speed is not None else set()
        return tuple(name for name in SHAPING if name not in measured.union(self.known))

    @property
    def spreads(self) -> tuple[str, ...]:
        """Standard deviations that are estimated from the scatter of the distances."""
        return SPREADS if self.shots.speed is None else SPREADS[1:]


class Response(NamedTuple):
    """Expected measurements without dispersion, and their derivatives; N shots, q free and c spread parameters."""

    mean: Array
    """f [m], shape (N,)."""
    design: Array
    """Derivatives by the encoded free parameters, shape (N, q)."""
    scales: Array
    """Variance per unit variance of each spread, shape (c, N): f_v² and f_δ², or f_δ² alone."""
    curvatures: Array
    """Second derivatives, f_vv and f_δδ or f_δδ alone, shape (c, N)."""

    def shift(self, variances: Array) -> Array:
        """Return what spreads of variances of shape (c,) add to the mean [m], shape (N,)."""
        return np.asarray(0.5 * variances @ self.curvatures)

    def sd(self, variances: Array) -> Array:
        """Return the standard deviations for spreads of variances of shape (c,) [m], shape (N,)."""
        return np.asarray(np.sqrt(variances @ self.scales))


def response(problem: MuzzleProblem, values: Mapping[str, float]) -> Response:
    """Return what shots are expected to show at given parameters.

    Args:
      problem: the shots and how pellets fly.
      values: speed, pitch_offset, height, drag and length (0 without it), as in a muzzle record.
    """
    names = ("speed", "pitch_offset", *(name for name in problem.free if name in ("height", "drag")))
    size = np.array([_STEPS[name] for name in names])[:, None]
    # One call for all central differences: the model is evaluated hundreds of times.
    rows = np.concatenate([np.zeros((1, len(names))), np.diag(size[:, 0]), -np.diag(size[:, 0])])
    moved = {name: rows[:, [column]] for column, name in enumerate(names)}
    base, above, below = np.split(_flown(problem, values, moved), [1, 1 + len(names)])
    mean, slopes, bends = base[0], (above - below) / (2 * size), (above - 2 * base + below) / size**2
    speed = values["speed"] if problem.shots.speed is None else problem.shots.speed
    # A share of the speed, not the speed, was moved.
    per_unit = np.stack([slopes[0] / speed, slopes[1]])[-len(problem.spreads) :]
    curvatures = np.stack([bends[0] / speed**2, bends[1]])[-len(problem.spreads) :]
    scales = per_unit**2
    # Where a measurement hardly depends on the angle (or the speed), the first order vanishes.
    scales = np.maximum(scales, 1e-6 * scales.mean(axis=1, keepdims=True) + 1e-12)
    return Response(mean, slopes[[names.index(name) for name in problem.free]].T, scales, curvatures)


def _flown(problem: MuzzleProblem, values: Mapping[str, float], moved: Mapping[str, Array]) -> Array:
    """Fly all shots with parameters moved by shape (R, 1) each; return shape (R, N)."""
    shots = problem.shots
    speed = (values["speed"] if shots.speed is None else shots.speed) * (1.0 + moved["speed"])
    pitch = shots.pitch + values["pitch_offset"] + moved["pitch_offset"]
    height, drag = (values[name] + moved.get(name, np.zeros(1)) for name in ("height", "drag"))
    if shots.on_plane:
        return _plane_height(shots, problem.flight, speed, pitch, drag)
    # A muzzle ahead of the pivot rises with the barrel: by 14 mm at 5° and 0.16 m, which would pass for an offset.
    height = height + values.get("length", 0.0) * np.sin(shots.pitch)
    if problem.flight == "eq-5":
        return printed_landing_distance(speed, pitch, shots.yaw, height, drag)
    return landing_distance(speed, pitch, height, drag)


def _plane_height(shots: Shots, flight: Flight, speed: Array, pitch: Array, drag: Array) -> Array:
    """Heights at which pellets cross the target plane above the muzzle [m], shape (R, N)."""
    yaw = shots.yaw if shots.lateral is None else np.arctan2(shots.lateral, shots.distance)
    speed, pitch, yaw, plane, drag = np.broadcast_arrays(speed, pitch, yaw, shots.distance, drag)
    departure = np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)
    cross = printed_crossing if flight == "eq-5" else flat_fire_crossing
    return np.asarray(cross(np.zeros_like(departure), speed[..., None] * departure, plane, drag).height)


def encode(name: str, value: float) -> float:
    """Return a parameter as it is sought: the speed, whose errors are shares of it, by its logarithm."""
    return float(np.log(value) if name == "speed" else value)


def decode(name: str, value: float) -> float:
    """Undo `encode`."""
    return float(np.exp(value) if name == "speed" else value)


def limits(names: tuple[str, ...]) -> tuple[Array, Array]:
    """Return where encoded parameters are sought: lowest and highest, shape (q,) each."""
    ends = np.array([[encode(name, end) for end in RANGES[name]] for name in names]).reshape(-1, 2)
    return ends[:, 0], ends[:, 1]

"""Muzzle speed, its scatter and the disturbance angles of eq (6) by maximum likelihood from landing points.

With v ~ N(μ_v, σ_v²) and δ₀ ~ N(μ_0, σ_0²) a landing distance f(v, pitch + δ₀) is, to first order (delta method),

    d ~ N(f(μ_v, pitch + μ_0), f_v² σ_v² + f_δ² σ_0²),

and where the speed of each shot was measured

    d | v ~ N(f(v, pitch + μ_0), f_δ² σ_0²),    v ~ N(μ_v, σ_v²).

The flight f is the simulator's, flat fire, and not eq (5). Speeds count as exact. Azimuth comes from lateral distances
alone, to which it is tied one to one.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import t as student

from archerfish.identification.lack_of_fit import LackOfFit, lack_of_fit
from archerfish.identification.landing import landing_distance
from archerfish.identification.profile_likelihood import Bounds, maximise_likelihood, profile_interval
from archerfish.identification.shot_checks import check_shots
from archerfish.records.errors import InputError
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.shots import Shots

Array = NDArray[np.float64]

_RANGES: dict[str, tuple[float, float]] = {
    "speed": (1.0, 35.0),
    "speed_sd": (1e-3, 30.0),
    "pitch_offset": (-0.35, 0.35),
    "pitch_sd": (1e-5, 0.35),
    "height": (0.01, 3.0),
    "drag": (1e-4, 0.3),
}
"""Where each parameter is sought, in SI units; the fastest speed that any referee system allows is 30 m/s."""

_STEP = 1e-5
"""Step of the central differences: radians in pitch, and a share of the speed."""

_LINEAR = {"pitch_offset"}
"""Sought as they are; the others, which are positive, by their logarithms."""


@dataclass(frozen=True)
class MuzzleIdentification:
    """An identified muzzle and how well it explains the shots."""

    muzzle: MuzzleRecord
    """The muzzle with its 95 % intervals."""
    estimated: tuple[str, ...]
    """Fields of the record that were estimated; the others were given."""
    distance: Array
    """Landing distance of each shot by the model [m], shape (N,)."""
    distance_sd: Array
    """Standard deviation of each by the model [m], shape (N,)."""
    log_likelihood: float
    """At the estimate."""
    lack_of_fit: LackOfFit
    """Whether the flight model itself can explain the shots."""
    remarks: tuple[str, ...]
    """What may spoil the estimate, each a sentence."""


def identify_muzzle(shots: Shots, *, drag: float | None, height: float | None = None) -> MuzzleIdentification:
    """Estimate a muzzle from landing points.

    Args:
      shots: landing points, with measured speeds or without.
      drag: k [1/m]; estimated if None.
      height: height of the muzzle above the ground [m]; estimated if None.

    Raises:
      InputError: if a given value is out of range or the shots can't separate the parameters; the message names the
        measurement that is missing.
    """
    known = {name: value for name, value in (("drag", drag), ("height", height)) if value is not None}
    _check_known(known)
    free = tuple(name for name in _RANGES if name not in known)
    check_shots(shots, free)
    bounds = [_encode(name, np.array(_RANGES[name])) for name in free]
    limits: Bounds = [(float(low), float(high)) for low, high in bounds]

    def negative(point: Array) -> float:
        return -log_likelihood(shots, {**known, **_decoded(free, point)})

    best = maximise_likelihood(negative, _starts(shots, free, known), limits)
    values = {**known, **_decoded(free, best)}
    ends = {name: profile_interval(negative, best, index, limits) for index, name in enumerate(free)}
    intervals = {name: (_decode(name, low), _decode(name, high)) for name, (low, high) in ends.items()}
    azimuth, azimuth_intervals = _azimuth(shots)
    distance, distance_sd = predicted_distance(shots, values)
    fields: dict[str, Any] = {**values, **azimuth, "intervals": intervals | azimuth_intervals}
    return MuzzleIdentification(
        muzzle=MuzzleRecord(**fields),
        estimated=(*free, *azimuth_intervals),
        distance=distance,
        distance_sd=distance_sd,
        log_likelihood=-negative(best),
        lack_of_fit=lack_of_fit(shots.pitch, shots.distance, distance, len(set(free) & _mean_parameters(shots))),
        remarks=tuple(_remarks(shots, intervals)),
    )


def predicted_distance(shots: Shots, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Mean and standard deviation of each landing distance by the delta method [m], shape (N,) each.

    Args:
      shots: the shots; where a speed was measured the prediction is for that speed.
      values: speed, speed_sd, pitch_offset, pitch_sd, height and drag, as in a muzzle record.
    """
    pitch = shots.pitch + values["pitch_offset"]
    speed = np.full_like(pitch, values["speed"]) if shots.speed is None else shots.speed

    # One call for the mean and both central differences: the likelihood is evaluated thousands of times.
    angle, share = (
        np.array([[0.0], [_STEP], [-_STEP], [0.0], [0.0]]),
        np.array([[0.0], [0.0], [0.0], [_STEP], [-_STEP]]),
    )
    mean, above, below, faster, slower = landing_distance(
        speed * (1 + share),
        pitch + angle,
        values["height"],
        values["drag"],
    )
    variance = ((above - below) / (2 * _STEP) * values["pitch_sd"]) ** 2
    if shots.speed is None:
        variance += ((faster - slower) / (2 * _STEP * speed) * values["speed_sd"]) ** 2
    return mean, np.sqrt(variance)


def log_likelihood(shots: Shots, values: Mapping[str, float]) -> float:
    """Return the log-likelihood of the distances, and of the speeds if they were measured; `values` as above."""
    mean, sd = predicted_distance(shots, values)
    # Where the distance hardly depends on the angle the first order vanishes; a millimetre stands for the rest.
    total = _log_density(shots.distance, mean, np.hypot(sd, 1e-3))
    if shots.speed is not None:
        total += _log_density(shots.speed, values["speed"], values["speed_sd"])
    return total


def _log_density(found: Array, mean: Array | float, sd: Array | float) -> float:
    """Sum the logarithms of normal densities."""
    return float(-np.sum(0.5 * ((found - mean) / sd) ** 2 + np.log(sd) + 0.5 * np.log(2 * np.pi)))


def _check_known(known: Mapping[str, float]) -> None:
    for name, value in known.items():
        low, high = (0.0, _RANGES[name][1]) if name == "drag" else _RANGES[name]
        if not low <= value <= high:
            unit = "1/m" if name == "drag" else "m"
            raise InputError(f"{name} must be from {low:g} to {high:g} {unit}, got {value:g}; give it in SI units")


def _mean_parameters(shots: Shots) -> set[str]:
    """Name the parameters that shape the mean distances."""
    return {"pitch_offset", "height", "drag"} | ({"speed"} if shots.speed is None else set())


def _starts(shots: Shots, free: tuple[str, ...], known: Mapping[str, float]) -> list[Array]:
    """Spread starts over the speed and the pitch offset, which trade against each other."""
    speeds = [float(shots.speed.mean())] if shots.speed is not None else [8.0, 15.0, 25.0]
    guesses = [
        {"speed": v, "speed_sd": 0.03 * v, "pitch_offset": a, "pitch_sd": 0.02, "height": 0.4, "drag": 0.02, **known}
        for v in speeds
        for a in (-0.1, -0.03, 0.0, 0.03)
    ]
    ranked = sorted(guesses, key=lambda guess: -log_likelihood(shots, guess))
    return [np.array([_encode(name, np.array(guess[name])) for name in free]).ravel() for guess in ranked[:3]]


def _encode(name: str, value: Array) -> Array:
    return value if name in _LINEAR else np.log(value)


def _decode(name: str, value: float) -> float:
    return float(value if name in _LINEAR else np.exp(value))


def _decoded(names: tuple[str, ...], point: Array) -> dict[str, float]:
    return {name: _decode(name, value) for name, value in zip(names, point, strict=True)}


def _azimuth(shots: Shots) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Estimate μ_1 and σ_1 with their exact normal-theory intervals; zero where no lateral distances were measured."""
    if shots.lateral is None:
        return {"yaw_offset": 0.0, "yaw_sd": 0.0}, {}
    angle = np.arcsin(np.clip(shots.lateral / shots.distance, -1, 1))
    count, mean, sd = angle.size, float(angle.mean()), float(angle.std())
    half = float(student.ppf(0.975, count - 1) * angle.std(ddof=1) / np.sqrt(count))
    low, high = (float(sd * np.sqrt(count / chi2.ppf(level, count - 1))) for level in (0.975, 0.025))
    return {"yaw_offset": mean, "yaw_sd": sd}, {"yaw_offset": (mean - half, mean + half), "yaw_sd": (low, high)}


def _remarks(shots: Shots, intervals: Mapping[str, tuple[float, float]]) -> list[str]:
    remarks = []
    if shots.lateral is None:
        remarks.append("No lateral distances were measured: the yaw offset and its scatter are unknown, recorded as 0.")
    for name, (low, high) in intervals.items():
        bottom, top = _RANGES[name]
        if np.isclose(low, bottom) or np.isclose(high, top):
            remarks.append(
                f"The shots don't bound {name.replace('_', ' ')} on both sides: "
                f"its interval ends where the search ends ({bottom:g}–{top:g})."
            )
    return remarks

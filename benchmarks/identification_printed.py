"""Identification of the printed axes, whose truth is known: what a 2–50 Hz sweep alone gives, and with a step."""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.gimbal import AxisIdentification, identify_axis
from archerfish.identification.axis.state_space import plant_poles, simulate
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.identification.validation.free_run import fit_percent
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording, make_recording

Array = NDArray[np.float64]

ORDER = 4
SWEEP_S, STEP_S = 10.0, 1.0
WHITE_SAMPLES, WHITE_SEED = 3000, 1_000_000
"""The white input is the same for all noise seeds, and not one of them."""


class SweepAlone(NamedTuple):
    """What one noisy sweep of the pitch axis gave."""

    seed: int
    """Seed of the noise."""
    noise: float
    """Its standard deviation as a share of the clean output's."""
    sweep_fit_percent: float
    """Fit to the noise-free response to the sweep, from zero state [%]."""
    step_fit_percent: float
    """Fit to the noise-free response to a step, from zero state [%]."""
    white_fit_percent: float
    """Fit to the noise-free response to white input, from zero state [%]."""
    pole_error: float
    """Distance of the dominant pole from the true one in the z plane."""
    pair_flagged: bool
    """Whether every pole but the dominant pair was flagged: the pair at 0.4 of the sampling rate left no trace."""
    seconds: float
    """Time of the identification [s]."""


class SweepAndStep(NamedTuple):
    """What a noisy sweep and a noisy step of a printed axis gave together."""

    axis: str
    """Which axis."""
    seed: int
    """Seed of the noise."""
    step_fit_percent: float
    """Fit to the noise-free response to the step, from zero state [%]."""
    seconds: float
    """Time of the identification [s]."""


def sweep_alone(noise: float, seeds: Sequence[int]) -> Iterator[SweepAlone]:
    """Identify the printed pitch axis from one sweep, once per seed."""
    true = printed_plants()["pitch"]
    period = true.sample_period_s
    signals = {
        "sweep": linear_sweep(SWEEP_S, period),
        "step": step(STEP_S, period),
        "white": np.random.default_rng(WHITE_SEED).standard_normal(WHITE_SAMPLES),
    }
    for seed in seeds:
        log = _noisy(true, signals["sweep"], noise, np.random.default_rng(seed))
        start = time.perf_counter()
        result = identify_axis([log], ORDER)
        seconds = time.perf_counter() - start
        yield SweepAlone(
            seed=seed,
            noise=noise,
            **{f"{name}_fit_percent": _truth_fit(result.plant, true, signal) for name, signal in signals.items()},
            pole_error=_pole_error(result.plant, true),
            pair_flagged=_others_flagged(result, true),
            seconds=seconds,
        )


def sweep_and_step(noise: float, seeds: Sequence[int]) -> Iterator[SweepAndStep]:
    """Identify each printed axis from a sweep and a step, once per seed."""
    for axis, true in printed_plants().items():
        signals = linear_sweep(SWEEP_S, true.sample_period_s), step(STEP_S, true.sample_period_s)
        for seed in seeds:
            rng = np.random.default_rng(seed)
            logs = [_noisy(true, signal, noise, rng) for signal in signals]
            start = time.perf_counter()
            result = identify_axis(logs, ORDER)
            seconds = time.perf_counter() - start
            yield SweepAndStep(axis, seed, _truth_fit(result.plant, true, signals[1]), seconds)


def _noisy(true: PlantRecord, signal: Array, noise: float, rng: np.random.Generator) -> Recording:
    clean = simulate(true, signal[:, None])
    measured = clean + noise * clean.std() * rng.standard_normal(clean.shape)
    return make_recording(signal, measured, true.sample_period_s)


def _truth_fit(plant: PlantRecord, true: PlantRecord, signal: Array) -> float:
    return float(fit_percent(simulate(true, signal[:, None]), simulate(plant, signal[:, None])).item())


def _dominant(true: PlantRecord) -> complex:
    return complex(plant_poles(true)[0])


def _pole_error(plant: PlantRecord, true: PlantRecord) -> float:
    return float(np.abs(plant_poles(plant) - _dominant(true)).min())


def _others_flagged(result: AxisIdentification, true: PlantRecord) -> bool:
    """Tell whether the poles that are not the dominant pair are all named as unsupported by the recording."""
    away = np.abs(np.stack([result.poles, result.poles.conjugate()]) - _dominant(true)).min(axis=0)
    return not np.any(result.determined[np.argsort(away)[2:]])

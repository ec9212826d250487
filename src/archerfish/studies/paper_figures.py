"""Fig. 4 and Table I: the printed gimbal identified from logs of its own, and a muzzle fitted to the landing points."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.identify import identify_axis
from archerfish.identification.muzzle.identify import identify_muzzle
from archerfish.identification.simulation import fit_percent, simulate
from archerfish.logs.log import read_log
from archerfish.logs.recording import Recording
from archerfish.logs.shots import Shots
from archerfish.paper.gimbal import printed_plants
from archerfish.paper.tables import landing_table
from archerfish.records.plant import PlantRecord
from archerfish.studies.study import Axis, LandingPoint, Origin, StepResponse

Array = NDArray[Any]
LOGGED_SWEEP_S, LOGGED_SWEEP_HZ, LOGGED_STEP_S = 10.0, (2.0, 50.0), 1.5
"""The paper prints the band alone; a step lasts several time constants of the slow yaw axis."""
AMPLITUDE = np.radians(5.0)
"""Of sweep and step [rad]."""
NOISE = 0.01
"""Measurement noise, as a share of the standard deviation of the clean output."""
ORDER = 4
"""Of the printed models."""
SHOWN_DEG, SHOWN_S, REST_BEFORE_S = 10.0, 0.5, 0.05
"""Of Fig. 4: size of the step, time after it, rest before it."""
EVERY = 5
"""Samples of a recorded step of which one is stored."""


def figure_4(axis: Axis, folder: Path, seed: int) -> StepResponse:
    """Log a sweep and a step of a printed axis with noise, identify the axis from the logs, and return its response.

    Args:
      axis: "pitch" or "yaw".
      folder: for the logs and the record of the identified axis.
      seed: of the noise.
    """
    plant = printed_plants()[axis]
    period, draws = plant.sample_period_s, np.random.default_rng((seed, ("pitch", "yaw").index(axis)))
    time = period * np.arange(round(LOGGED_SWEEP_S / period))
    low_hz, high_hz = LOGGED_SWEEP_HZ
    cycles = low_hz * time + (high_hz - low_hz) * time**2 / (2.0 * LOGGED_SWEEP_S)
    signals = {
        "sweep": AMPLITUDE * np.sin(2.0 * np.pi * cycles),
        "step": _step(LOGGED_STEP_S, period, AMPLITUDE),
        "step_validation": _step(LOGGED_STEP_S, period, -2.0 * AMPLITUDE),
    }
    paths = {}
    for name, signal in signals.items():
        clean = simulate(plant, signal[:, None])
        noisy = clean + NOISE * clean.std() * draws.standard_normal(clean.shape)
        paths[name] = folder / f"{axis}_{name}.csv"
        Recording.from_arrays(signal, noisy, period).write_csv(paths[name])
    fitted, held_back = [paths["sweep"], paths["step"]], [paths["step_validation"]]
    found = identify_axis(fitted, validate=held_back, axis=axis, order=ORDER, seed=seed)
    found.save(folder)
    signal = _step(REST_BEFORE_S + SHOWN_S, period, np.radians(SHOWN_DEG))
    true, model = (simulate(plant, signal[:, None])[:, 0] for plant in (plant, found.record))
    return _response("paper", axis, signal, true, model, period)


def recorded_step(axis: Axis, log: Path, plant: PlantRecord) -> StepResponse:
    """Return a recorded step, and what an identified axis makes of its command from rest.

    Nothing is fitted: an offset that is fitted to the whole step would hide a part of what a saturated motor lacks.

    Args:
      axis: "pitch" or "yaw".
      log: rest, then one step.
      plant: the identified axis.
    """
    recording = read_log(log).recordings[0]
    signal = recording.inputs[:, 0] - recording.inputs[0, 0]
    begin = int(np.argmax(signal != 0.0))
    measured = recording.outputs[:, 0] - float(np.mean(recording.outputs[:begin, 0]))
    model = simulate(plant, signal[:, None])[:, 0]
    return _response("robot", axis, signal, measured, model, recording.period_s, EVERY)


def table_1() -> tuple[tuple[LandingPoint, ...], dict[str, float]]:
    """Fit a muzzle to the measured landing points of Table I; return its rows, and what was fitted."""
    rows = landing_table().rows
    pitch = np.radians([row.pitch_deg for row in rows])
    yaw = -np.radians([row.yaw_deg for row in rows])  # the paper's yaw is to the right
    found = identify_muzzle(Shots(pitch, yaw, np.array([row.real_m for row in rows])))
    points = []
    for row, model_m in zip(rows, found.expected.tolist(), strict=True):
        angles = {"pitch_deg": row.pitch_deg, "yaw_deg": row.yaw_deg}
        points.append(LandingPoint(**angles, printed_model_m=row.simulated_m, measured_m=row.real_m, model_m=model_m))
    muzzle = found.record
    fitted = {"speed_m_s": muzzle.speed, "height_m": muzzle.height, "drag_per_m": muzzle.drag}
    return tuple(points), {**fitted, "pitch_offset_deg": float(np.degrees(muzzle.pitch_offset))}


def _step(duration_s: float, period_s: float, size: float) -> Array:
    """Return zeros, and after `REST_BEFORE_S` a step, shape (N,)."""
    time = period_s * np.arange(round(duration_s / period_s))
    return np.where(time >= REST_BEFORE_S - 0.5 * period_s, size, 0.0)  # half a period for the rounding of a time


def _response(
    source: Origin, axis: Axis, signal: Array, measured: Array, model: Array, period_s: float, every: int = 1
) -> StepResponse:
    begin = int(np.argmax(signal != 0.0))
    shown = slice(begin, None, every)
    curves: dict[str, Any] = {"measured_deg": np.degrees(measured[shown]), "model_deg": np.degrees(model[shown])}
    time = period_s * np.arange(len(signal) - begin)[::every]
    fit = float(fit_percent(measured[begin:, None], model[begin:, None])[0])
    size = round(float(np.degrees(signal[-1])), 3)
    numbers = {name: tuple(np.round(values, 5).tolist()) for name, values in {"time_s": time, **curves}.items()}
    return StepResponse(source=source, axis=axis, size_deg=size, fit_percent=fit, **numbers)

"""The identification part of `reproduce`: logs of the printed plants, plants from the logs (Fig. 4), and Table I."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.axis_picture import axis_picture, simulated_run
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.paper_results import LackOfFit, StepResponse, Table1, Table1Row
from archerfish.figures.style import save_figure
from archerfish.identification.axis.gimbal import AxisIdentification, identify_axis
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.identification.muzzle.likelihood import identify_muzzle
from archerfish.identification.validation.free_run import fit_percent
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.tables import landing_table
from archerfish.records.plant import PlantRecord, dc_gain, write_plant
from archerfish.records.provenance import provenance
from archerfish.records.recording import make_recording, read_recording_csv, write_recording_csv
from archerfish.records.shots import Shots

Floats = NDArray[np.float64]

SWEEP_S = 10.0
"""Length of the sweep [s]; the paper prints its band, 2–50 Hz, alone."""
STEP_S = 1.5
"""Length of the step logs [s]: several time constants of the slow yaw axis."""
AMPLITUDE = np.deg2rad(5.0)
"""Of sweep and step [rad]."""
NOISE = 0.01
"""Measurement noise over the standard deviation of the clean output."""


@dataclass(frozen=True)
class AxisTask:
    """An identification, as data: it can be handed to another process."""

    axis: str
    """"pitch" or "yaw"."""
    plant: PlantRecord
    """The printed plant, which is logged and then forgotten."""
    folder: Path
    """For logs, plant record and pictures."""
    seed: tuple[int, int]
    """Of the measurement noise."""


@dataclass(frozen=True)
class Identified:
    """What the identification part leaves."""

    facts: dict[str, dict[str, Any]]
    """Axis → facts about its identification."""
    responses: dict[str, StepResponse]
    """Fig. 4: axis → step response beside the true one."""
    table1: Table1
    """Table I with the fitted muzzle beside it."""


def identify_all(plants: dict[str, PlantRecord], folder: Path, seed: int, workers: int) -> Identified:
    """Log sweeps and steps of the printed plants, identify both axes from the logs alone, and fit Table I.

    Args:
      plants: "pitch" and "yaw".
      folder: for logs, plant records and pictures.
      seed: of the measurement noise.
      workers: processes.
    """
    jobs: list[Task] = [
        (identify_logged, AxisTask(axis, plant, folder, (seed, index)), 1.0)
        for index, (axis, plant) in enumerate(plants.items())
    ]
    *axes, table1 = run_tasks("identifying", "models", [*jobs, (_landing, None, 1.0)], workers)
    found = dict(zip(plants, axes, strict=True))
    return Identified(
        facts={axis: facts for axis, (facts, _) in found.items()},
        responses={axis: response for axis, (_, response) in found.items()},
        table1=table1,
    )


def identify_logged(
    task: AxisTask, advance: Callable[[float, str], None] = lambda *_: None
) -> tuple[dict[str, Any], StepResponse]:
    """Log a printed plant and identify it from the logs alone; write logs, plant record and pictures.

    Args:
      task: what, and where to.
      advance: hears when it is done.

    Returns:
      Facts about the axis, and its step response beside the true one.
    """
    logs = _write_logs(task.plant, task.folder / "logs" / task.axis, np.random.default_rng(task.seed))
    sweep, stepped, held_back = (read_recording_csv(path, "time_s", ("u",), ("y",)) for path in logs.values())
    result = identify_axis([sweep, stepped], axis=task.axis)
    record = replace(result.plant, provenance=provenance(task.seed[0], logs.values()))
    write_plant(task.folder / "plants" / f"{task.axis}.json", record)
    run = simulated_run(result, held_back, "validation")
    picture = axis_picture(result, run, [sweep, stepped], output="angle [rad]")
    for ending in (".svg", ".png"):
        save_figure(task.folder / "figures" / f"fig4_{task.axis}{ending}", picture)
    response = _step_response(task.plant, result)
    advance(1.0, task.axis)
    return _facts(task.plant, result, run.fit_percent, logs["validation"], response), response


def _landing(_: None, advance: Callable[[float, str], None]) -> Table1:
    table = landing_of_table1()
    advance(1.0, "muzzle")
    return table


def _write_logs(plant: PlantRecord, folder: Path, generator: np.random.Generator) -> dict[str, Path]:
    period = plant.sample_period_s
    signals = {
        "sweep": linear_sweep(SWEEP_S, period, amplitude=AMPLITUDE),
        "step": step(STEP_S, period, amplitude=AMPLITUDE),
        "validation": step(STEP_S, period, amplitude=-2.0 * AMPLITUDE),
    }
    paths = {}
    for name, signal in signals.items():
        clean = simulate(plant, signal[:, None])
        noisy = clean + NOISE * clean.std() * generator.standard_normal(clean.shape)
        paths[name] = folder / f"{name}.csv"
        write_recording_csv(paths[name], make_recording(signal, noisy, period, input_names=("u",), output_names=("y",)))
    return paths


def _step_response(plant: PlantRecord, result: AxisIdentification) -> StepResponse:
    """Fig. 4: a step of 10° of the identified plant beside the true one, both without noise."""
    period = plant.sample_period_s
    # From rest: without it the first command would count as held before, and hide a delay.
    signal = step(0.55, period, start_s=0.05, amplitude=np.deg2rad(10.0))[:, None]
    rest = int(np.argmax(signal[:, 0] > 0))
    true, identified = (simulate(each, signal)[rest:] for each in (plant, result.plant))
    return StepResponse(
        time_s=tuple(np.round(period * np.arange(len(true)), 6).tolist()),
        true_deg=tuple(np.rad2deg(true[:, 0]).tolist()),
        identified_deg=tuple(np.rad2deg(identified[:, 0]).tolist()),
        fit_percent=fit_percent(true, identified).item(),
    )


def _facts(
    plant: PlantRecord, result: AxisIdentification, validation_percent: float, path: Path, response: StepResponse
) -> dict[str, Any]:
    return {
        "order": len(result.plant.A),
        "delay_samples": result.plant.delay_samples,
        "dc_gain": dc_gain(result.plant).item(),
        "true_dc_gain": dc_gain(plant).item(),
        "step_fit_percent": response.fit_percent,
        "noise_percent": 100 * NOISE,
        "validation": [{"file": path.name, "fit_percent": validation_percent}],
        "remarks": list(result.remarks),
    }


def landing_of_table1() -> Table1:
    """Fit the muzzle to Table I by maximum likelihood, and lay its distances beside the paper's."""
    table = landing_table()
    shots = Shots(
        pitch=np.deg2rad([row.pitch_deg for row in table.rows]),
        yaw=-np.deg2rad([row.yaw_deg for row in table.rows]),  # the paper's yaw is positive to the right
        distance=np.array([row.real_m for row in table.rows]),
    )
    result = identify_muzzle(shots, drag=assumed_conditions().drag)
    rows = tuple(
        Table1Row(
            alpha_deg=row.pitch_deg,
            beta_deg=row.yaw_deg,
            d1_m=row.simulated_m,
            d2_m=row.real_m,
            model_m=float(model),
            error_percent=100 * (float(model) / row.real_m - 1),
        )
        for row, model in zip(table.rows, result.expected, strict=True)
    )
    errors = [abs(row.error_percent) for row in rows]
    muzzle = result.muzzle
    return Table1(
        rows=rows,
        parameters={
            "speed_m_s": muzzle.speed,
            "height_m": muzzle.height,
            "pitch_offset_deg": float(np.rad2deg(muzzle.pitch_offset)),
            "pitch_sd_deg": float(np.rad2deg(muzzle.pitch_sd)),
            "drag_per_m": muzzle.drag,
        },
        lack_of_fit=LackOfFit(
            rms_percent=float(np.sqrt(np.mean(np.square(errors)))),
            worst_percent=max(errors),
            statement=" ".join([result.lack_of_fit.statement, *result.remarks]),
        ),
    )

"""The identification part of a rehearsal: from a robot's logs to the records that training and shooting start from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.axis_log import read_axis_log
from archerfish.cli.lab_files import LARGE_STEPS_DEG, read_tape
from archerfish.cli.setting import Setting, with_muzzle
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.robot_results import LandingRow, RobotIdentification, RobotStep
from archerfish.identification.axis.gimbal import AxisIdentification
from archerfish.identification.axis.order_choice import choose_order
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.axis.steady_gain import PlateauGain, plateau_gain
from archerfish.identification.muzzle.landing import landing_distance
from archerfish.identification.muzzle.likelihood import identify_muzzle
from archerfish.identification.sensing.estimate import identify_sensing
from archerfish.identification.validation.free_run import fit_percent, free_run
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.limits import read_limits
from archerfish.records.message_times import read_message_times_csv
from archerfish.records.muzzle import MuzzleRecord, write_muzzle
from archerfish.records.plant import PlantRecord, dc_gain, write_plant
from archerfish.records.provenance import provenance
from archerfish.records.recording import Recording
from archerfish.records.sensing import SensingRecord, sensing_values, write_sensing
from archerfish.records.sensing_logs import read_detections_csv, read_gimbal_log_csv, read_target_steps_csv
from archerfish.records.shots import Shots
from archerfish.records.shots_csv import read_shots_csv

Floats = NDArray[np.float64]
Advance = Callable[[float, str], None]

Z95 = 1.96
STEP_EVERY = 5
"""Samples of Fig. 4's steps that are kept: every fifth millisecond."""


@dataclass(frozen=True)
class IdentifyTask:
    """One identification, as data: it can be handed to another process."""

    logs: Path
    """Folder of the logs."""
    folder: Path
    """For the records."""
    seed: int
    """Of the posterior draws."""
    axis: str = ""
    """Of a gimbal axis."""


@dataclass(frozen=True)
class Identified:
    """What the logs of a robot told."""

    setting: Setting
    """Everything that a simulator is built from."""
    report: RobotIdentification
    """How well it was told."""


def identify_robot(name: str, logs: Path, folder: Path, seed: int, workers: int) -> Identified:
    """Identify axes, sensing and muzzle of a robot from its logs alone, and write their records.

    Args:
      name: of the robot; the setting is called identified-NAME.
      logs: folder that `record_robot` wrote, or a team.
      folder: for the records.
      seed: of the posterior draws.
      workers: processes.
    """
    tasks = [IdentifyTask(logs, folder, seed, axis) for axis in ("yaw", "pitch", "")]
    jobs: list[Task] = [(run_axis if task.axis else run_sensing_and_muzzle, task, 1.0) for task in tasks]
    (yaw, yaw_told), (pitch, pitch_told), (sensing, muzzle, landings) = run_tasks(
        "identifying", "models", jobs, workers
    )
    setting = Setting(
        name=f"identified-{name}",
        pitch=pitch,
        yaw=yaw,
        muzzle=muzzle,
        sensing=sensing,
        limits=read_limits(logs / "limits.json"),
        conditions=with_muzzle(assumed_conditions(), muzzle),
        inputs=tuple(sorted(logs.glob("*.csv"))),
    )
    steps = (*pitch_told["steps"], *yaw_told["steps"])
    axes = {"pitch": pitch_told["facts"], "yaw": yaw_told["facts"]}
    facts = {"sensing": _sensing_facts(sensing), "muzzle": _muzzle_facts(muzzle)}
    return Identified(setting, RobotIdentification(name, axes, facts, landings, steps))


def run_axis(task: IdentifyTask, advance: Advance = lambda *_: None) -> tuple[PlantRecord, dict[str, Any]]:
    """Identify an axis from its sweep and steps; the order is the one that foretells the held-back logs best."""
    axis = task.axis
    fitted = [_read(task, f"{axis}_{kind}.csv") for kind in ("sweep", "step")]
    held_back = [_read(task, f"{axis}_{kind}_validation.csv") for kind in ("sweep", "step")]
    gain = plateau_gain(fitted[1])
    # An axis has inertia: its angle never jumps. A plant that might would make up for a rise that it lacks the states
    # for by a longer delay and a jump at its end.
    held = None if gain is None else [gain.gain]
    choice = choose_order(fitted, held_back, axis=axis, seed=task.seed, dc_gain=held, feedthrough=False)
    result = choice.result
    files = [task.logs / f"{axis}_{kind}.csv" for kind in ("sweep", "step")]
    plant = replace(result.plant, provenance=provenance(task.seed, files))
    write_plant(task.folder / f"{axis}.json", plant)
    fits = [float(free_run(plant, each, result.offset).fit_percent.mean()) for each in held_back]
    facts = _axis_facts(result, fits, gain)
    advance(1.0, axis)
    return plant, {"facts": facts, "steps": [_large_step(task, plant, size) for size in LARGE_STEPS_DEG[axis]]}


def _read(task: IdentifyTask, name: str) -> Recording:
    return read_axis_log(task.logs / name, assumed_conditions().control_period_s)


def _axis_facts(result: AxisIdentification, fits: list[float], gain: PlateauGain | None) -> dict[str, Any]:
    plant = result.plant
    return {
        "order": len(plant.A),
        "delay_ms": 1e3 * plant.delay_samples * plant.sample_period_s,
        "dc_gain": dc_gain(plant).item(),
        "dc_gain_interval": list(result.dc_gain_interval[0] if gain is None else gain[1:]),
        "held_back_sweep_fit_percent": fits[0],
        "held_back_step_fit_percent": fits[1],
    }


def _large_step(task: IdentifyTask, plant: PlantRecord, size: float) -> RobotStep:
    return step_beside_model(task.axis, _read(task, f"{task.axis}_step_{abs(size):g}deg.csv"), plant)


def step_beside_model(axis: str, log: Recording, plant: PlantRecord) -> RobotStep:
    """Lay a step of a robot beside that of its model; both begin at rest, at zero.

    Nothing is fitted: an offset that were fitted to the whole step would hide a part of what a saturated motor lacks.
    The fit is the NRMSE from the step on, of the measured angle less its mean before the step.

    Args:
      axis: of the log.
      log: rest, then one step.
      plant: the identified model.
    """
    begin = int(np.argmax(log.inputs[:, 0] != log.inputs[0, 0]))
    measured = log.outputs[:, 0] - float(np.mean(log.outputs[:begin, 0]))
    model = simulate(plant, log.inputs - log.inputs[0])[:, 0]
    shown = slice(begin, None, STEP_EVERY)
    time = log.sample_period_s * (np.arange(len(model)) - begin)
    return RobotStep(
        axis=axis,
        size_deg=float(np.round(np.degrees(log.inputs[-1, 0] - log.inputs[0, 0]), 3)),
        time_s=tuple(np.round(time[shown], 4).tolist()),
        measured_deg=tuple(np.degrees(measured[shown]).tolist()),
        model_deg=tuple(np.degrees(model[shown]).tolist()),
        fit_percent=fit_percent(measured[begin:, None], model[begin:, None]).item(),
    )


def run_sensing_and_muzzle(
    task: IdentifyTask, advance: Advance = lambda *_: None
) -> tuple[SensingRecord, MuzzleRecord, tuple[LandingRow, ...]]:
    """Identify camera, link and muzzle, and foretell where pellets fall."""
    logs = task.logs
    sensing = identify_sensing(
        [read_gimbal_log_csv(logs / f"timing_{name}.csv") for name in ("sweep", "steps")],
        [read_detections_csv(logs / f"timing_{name}.csv") for name in ("plate", "target")],
        read_target_steps_csv(logs / "timing_moments.csv"),
        commands=read_message_times_csv(logs / "timing_commands.csv"),
        feedback=read_message_times_csv(logs / "timing_reports.csv"),
    ).sensing
    sensing = replace(sensing, provenance=provenance(task.seed, sorted(logs.glob("timing_*.csv"))))
    write_sensing(task.folder / "sensing.json", sensing)
    muzzle = muzzle_from_shots(logs / "shots.csv", read_tape(logs / "tape.json").muzzle_length_m)
    write_muzzle(task.folder / "muzzle.json", muzzle)
    advance(1.0, "sensing and muzzle")
    return sensing, muzzle, landing_rows(logs, muzzle)


def muzzle_from_shots(path: Path, length: float, drag: float | None = None) -> MuzzleRecord:
    """Identify a muzzle from hits on plates with measured speeds.

    Args:
      path: shots.csv.
      length: from the pivot to the muzzle, by tape [m].
      drag: k [1/m]; a pellet's usual one if not given.
    """
    found = identify_muzzle(read_shots_csv(path), drag=assumed_conditions().drag if drag is None else drag)
    return replace(found.muzzle, length=length, provenance=provenance(0, [path]))


def landing_rows(logs: Path, muzzle: MuzzleRecord) -> tuple[LandingRow, ...]:
    """Lay the falling points that the muzzle foretells beside those of the robot, at the angles of Table I."""
    shots, tape = read_shots_csv(logs / "landings.csv"), read_tape(logs / "tape.json")
    assert shots.distance is not None  # landings, not hits on a plane
    aims = [(round(float(a), 2), round(float(b), 2)) for a, b in np.degrees(np.stack([shots.pitch, shots.yaw], axis=1))]
    rows = []
    for aim in dict.fromkeys(aims):
        mine = np.array([each == aim for each in aims])
        distances = shots.distance[mine]
        half = Z95 * float(distances.std(ddof=1)) / np.sqrt(len(distances))
        mean = float(distances.mean())
        model = _foretold(muzzle, float(np.radians(aim[0])), tape.muzzle_height_m)
        rows.append(
            LandingRow(
                pitch_deg=aim[0],
                yaw_deg=aim[1],
                shots=len(distances),
                robot_m=mean,
                robot_low_m=mean - half,
                robot_high_m=mean + half,
                model_m=model,
                error_percent=100 * (model / mean - 1),
            )
        )
    return tuple(rows)


def _foretold(muzzle: MuzzleRecord, pitch: float, pivot_height: float) -> float:
    height = pivot_height + muzzle.length * np.sin(pitch)
    return float(
        landing_distance(np.asarray(muzzle.speed), np.asarray(pitch + muzzle.pitch_offset), height, muzzle.drag)
    )


def trimmed(setting: Setting, first_shots: Path) -> Setting:
    """Correct a setting's muzzle by the first shots of a robot that has changed since it was identified.

    Speed and boresight are taken from the shots, the scatter too; all else stays.

    Args:
      setting: as identified.
      first_shots: a burst at a plate.
    """
    found: Shots = read_shots_csv(first_shots)
    measured = identify_muzzle(found, drag=setting.muzzle.drag).muzzle
    names = ("speed", "speed_sd", "pitch_offset", "pitch_sd", "yaw_offset", "yaw_sd")
    muzzle = replace(setting.muzzle, **{name: getattr(measured, name) for name in names})
    return replace(setting, muzzle=muzzle, conditions=with_muzzle(setting.conditions, muzzle))


def _sensing_facts(sensing: SensingRecord) -> dict[str, Any]:
    milli = {
        "camera_time_offset_ms": "camera.time_offset",
        "camera_latency_ms": "camera.latency",
        "command_latency_ms": "link.command_latency",
        "command_latency_jitter_ms": "link.command_latency_jitter",
        "feedback_latency_ms": "link.feedback_latency",
        "bearing_sd_mrad": "camera.bearing_sd",
    }
    values = sensing_values(sensing)
    scaled = {name: None if values.get(field) is None else 1e3 * values[field] for name, field in milli.items()}
    return {**scaled, **_intervals(sensing.intervals, {name: (field, 1e3) for name, field in milli.items()})}


def _intervals(
    found: Mapping[str, tuple[float, float]], wanted: Mapping[str, tuple[str, float]]
) -> dict[str, list[float]]:
    """Return the intervals of facts, as NAME_interval, from the fields and scales that the facts come from."""
    return {
        f"{name}_interval": [scale * end for end in found[field]]
        for name, (field, scale) in wanted.items()
        if field in found
    }


def _muzzle_facts(muzzle: MuzzleRecord) -> dict[str, Any]:
    angles = ("pitch_offset", "yaw_offset", "pitch_sd", "yaw_sd")
    wanted = {f"{name}_m_s": (name, 1.0) for name in ("speed", "speed_sd")}
    wanted |= {f"{name}_deg": (name, float(np.degrees(1.0))) for name in angles}
    values = {name: scale * float(getattr(muzzle, field)) for name, (field, scale) in wanted.items()}
    return {**values, **_intervals(muzzle.intervals, wanted)}

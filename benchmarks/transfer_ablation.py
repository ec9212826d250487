"""What each ingredient of the way onto the robot is worth: each removed in turn, trained anew, shot on the robot.

All variants start from the same logs of the robot `infantry`, train with the same seed and number of decisions, and
meet the same engagements with the same dispersion draws, of a seed of their own. Differences are paired,
with 95 % intervals by engagement; one training each, so a difference smaller than that between two seeds of the whole
(the row "another seed") means little. Writes benchmarks/results/transfer_ablation.json and docs/ablation.svg.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from archerfish.cli import training_run
from archerfish.cli.evaluation_run import EvaluationTask, run_evaluation
from archerfish.cli.lab_stage import LabTask, record_robot, run_recording
from archerfish.cli.robot_identification import identify_robot, trimmed
from archerfish.cli.setting import Setting
from archerfish.cli.training_run import TrainingTask, run_task
from archerfish.cli.transfer import ROBOT_DISCOUNT
from archerfish.cli.transfer_stage import COMMAND_LIMIT
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.hit_rate import paired_difference
from archerfish.figures.ablation import Bar, ablation_figure
from archerfish.figures.style import save_figure
from archerfish.learning.config import PpoConfig
from archerfish.records import storage
from archerfish.records.policy import PolicyRecord
from archerfish.sensing import tracked_observation
from archerfish.simulation.reward import EQ_8
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "transfer_ablation.json"
PICTURE = Path(__file__).parents[1] / "docs" / "ablation.svg"
STEPS, ENGAGEMENTS, SEED = 3_000_000, 200, 1_000
"""Of each training; per cell; of engagements and noise, used nowhere else."""


@dataclass(frozen=True)
class Variant:
    """One way of training."""

    name: str
    """What is removed or added."""
    seed: int = 0
    """Of the training."""
    asymmetric: bool = True
    """Whether the critic sees where the target really is and will be."""
    redraw: bool = True
    """Whether axes, latencies, muzzle and time offset are redrawn per engagement."""
    latency: bool = True
    """Whether camera, link and feedback are late in training."""
    history: bool = True
    """Whether the policy remembers more than the last two sights."""
    bonus: bool = True
    """Whether a hit counts beside the distance of eq (8)."""


VARIANTS = (
    Variant("all"),
    Variant("another seed", seed=1),
    Variant("without posterior redraw", redraw=False),
    Variant("without delays and latencies", latency=False),
    Variant("without history", history=False),
    Variant("without the bonus of a hit", bonus=False),
    Variant("without asymmetric critic", asymmetric=False),
)


@dataclass(frozen=True)
class Shoot:
    """A variant to be trained and shot, as data."""

    variant: Variant
    """How."""
    setting: Setting
    """As identified."""
    changed: Setting
    """The same with the muzzle trimmed for `worn`."""
    steps: int
    """Of the training."""
    engagements: int
    """Per cell."""


def changed_setting(setting: Setting, variant: Variant) -> Setting:
    """Return what a variant trains in."""
    if not variant.redraw:
        plants = {
            axis: replace(getattr(setting, axis), draws={}, draw_delays=np.zeros(0, np.int64))
            for axis in ("pitch", "yaw")
        }
        assert setting.sensing is not None
        sensing, muzzle = replace(setting.sensing, intervals={}), replace(setting.muzzle, intervals={})
        setting = replace(setting, **plants, sensing=sensing, muzzle=muzzle)
    if not variant.latency:
        assert setting.sensing is not None
        camera = replace(setting.sensing.camera, latency=0.0, latency_jitter=0.0)
        names = ("command_latency", "command_latency_jitter", "feedback_latency", "feedback_latency_jitter")
        link = replace(setting.sensing.link, **dict.fromkeys(names, 0.0))
        plants = {axis: replace(getattr(setting, axis), delay_samples=0) for axis in ("pitch", "yaw")}
        plants = {axis: replace(plant, draw_delays=0 * plant.draw_delays) for axis, plant in plants.items()}
        setting = replace(setting, sensing=replace(setting.sensing, camera=camera, link=link, intervals={}), **plants)
    return setting


def run_variant(task: Shoot, advance: Callable[[float, str], None] = lambda *_: None) -> dict[str, NDArray[np.bool_]]:
    """Train a variant and shoot with the robot, and with the worn one before and after trimming."""
    variant = task.variant
    if not variant.history:
        tracked_observation.SIGHTS, tracked_observation.ORDER = 2, 1  # this process does nothing else
    if not variant.bonus:
        training_run.REWARDS["ppo"]["tracked"] = EQ_8
    ppo = PpoConfig(steps=task.steps, discount=ROBOT_DISCOUNT)
    training = TrainingTask(
        changed_setting(task.setting, variant), 0.5, "tracked", 0, COMMAND_LIMIT, ppo, variant.seed, variant.asymmetric
    )
    policy = run_task(training).policy
    places = {"infantry": task.setting}
    if variant == VARIANTS[0]:
        places |= {"worn": task.changed, "worn, not trimmed": task.setting}
    shot = {place: _shot(task, setting, place.split(",")[0], policy) for place, setting in places.items()}
    advance(1.0, variant.name)
    return shot


def _shot(task: Shoot, setting: Setting, robot: str, policy: PolicyRecord) -> NDArray[np.bool_]:
    names = ("speed", "drag", "length", "pitch_offset", "yaw_offset")
    policy = replace(policy, muzzle={name: float(getattr(setting.muzzle, name)) for name in names})
    evaluation = EvaluationTask(setting, COMMAND_LIMIT, task.engagements, SEED, policies=(policy,), robot=robot)
    return run_evaluation(evaluation)[0].hit


def row(name: str, hit: NDArray[np.bool_], whole: NDArray[np.bool_]) -> dict[str, Any]:
    """Compare a variant with the whole: over all cells, and over the moving targets alone."""
    halves = {"all": slice(None), "moving": slice(4, None), "moving 4–5 m": slice(7, None)}
    found = {}
    for half, cells in halves.items():
        pair = [each[cells].reshape(-1, each.shape[-1]) for each in (hit, whole)]
        found[half] = {"rate": float(pair[0].mean()), **paired_difference(*pair)._asdict()}
    return {"name": name, **found, "cells_percent": np.round(100 * hit.mean(axis=(1, 2)), 1).tolist()}


def main() -> None:
    """Record, identify, train and shoot all variants; `--quick` does so with too little to be quoted."""
    quick = "--quick" in sys.argv[1:]
    steps, engagements = (100_000, 4) if quick else (STEPS, ENGAGEMENTS)
    workers = min(os.cpu_count() or 1, 4)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record_robot("infantry", folder, SEED, workers)
        setting = identify_robot("infantry", folder, folder / "records", SEED, workers).setting
        run_recording(LabTask("trim", "worn", folder / "worn", SEED))
        changed = trimmed(setting, folder / "worn" / "first_shots.csv")
        jobs: list[Task] = [(run_variant, Shoot(each, setting, changed, steps, engagements), 1.0) for each in VARIANTS]
        shots = run_tasks("training and shooting", "variants", jobs, workers)
    whole = shots[0]
    rows = [row(each.name, hit["infantry"], whole["infantry"]) for each, hit in zip(VARIANTS, shots, strict=True)]
    trim = row("worn, not trimmed", whole["worn, not trimmed"], whole["worn"])
    table = Table("variant", "all cells %", "less than all", "moving %", "less than all", title="ablation on infantry")
    for each in (*rows, trim):
        cells = [each["name"]]
        for half in ("all", "moving"):
            found = each[half]
            span = f"{100 * found['difference']:+.1f} ({100 * found['low']:+.1f}…{100 * found['high']:+.1f})"
            cells += [f"{100 * found['rate']:.1f}", span]
        table.add_row(*cells)
    Console().print(table)
    if quick:
        return
    conditions = {**describe_machine(), "steps": steps, "engagements_per_cell": engagements, "seed": SEED}
    variants = [asdict(each) for each in VARIANTS]
    storage.write_json(RESULT, {"conditions": conditions, "variants": variants, "rows": rows, "trim": trim})
    ends = [(half, end) for half in ("all", "moving") for end in ("difference", "low", "high")]
    bars = [Bar(each["name"], *(100 * each[half][end] for half, end in ends)) for each in (*rows[1:], trim)]
    save_figure(PICTURE, ablation_figure(bars))


if __name__ == "__main__":
    main()

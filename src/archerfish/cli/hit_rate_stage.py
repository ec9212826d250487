"""The training and shooting parts of `reproduce`: Figs 5 and 6, Tables II and III."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_bounds, run_evaluations
from archerfish.cli.setting import Setting
from archerfish.cli.training_run import TrainingResult, TrainingTask, run_task, write_run
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.evaluate import Outcome, accelerations, cells, comparisons
from archerfish.evaluation.paper_results import LearningCurves, TrainingRun
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.policy import PolicyRecord
from archerfish.sensing.observation import DEFAULT_FRAMES

CURVE_STEPS = 0.4
"""Share of a training after which the curves of Figs 5 and 6 have flattened."""

COMMAND_LIMITS = ("gate", "box", "los-2deg")
"""Policies are trained under each."""
TRAINERS = {"history": "gradient", "paper": "ppo"}
"""Kind of observation → how its policies are trained: the paper's six numbers as the paper does."""
CONTROLLERS = {
    ("oracle", "perfect"): ("gate", "box", "los-2deg"),
    ("imm-lq",): ("gate", "box", "los-2deg"),
    ("kalman-lq",): ("gate", "box", "los-2deg"),
    ("parabola-lq",): ("gate", "box", "los-2deg"),
    ("vertex",): ("gate",),
    ("no-lead",): ("gate", "box"),
    ("kalman", "kalman-tuned"): ("gate", "box", "los-2deg"),
}
"""Classical controllers → command limits; a group is one task, the one with the most work first."""
NOT_QUICK = (("vertex",), ("no-lead",))
"""Groups that a quick run leaves out: each costs seconds of compiling."""
AGAINST = ("kalman", "kalman-tuned", "kalman-lq", "imm-lq", "parabola-lq", "oracle")
"""Whom the policies are compared with, paired."""


@dataclass(frozen=True)
class TrainedPolicies:
    """What the training part leaves."""

    policies: dict[str, tuple[PolicyRecord, ...]]
    """Command limit → policies that were trained under it for both kinds of target."""
    static_curves: LearningCurves
    """Fig. 5."""
    dynamic_curves: LearningCurves
    """Fig. 6."""


def train_all(
    setting: Setting,
    gradient: GradientConfig,
    ppo: PpoConfig,
    seed: int,
    curve_seeds: int,
    folder: Path,
    workers: int,
) -> TrainedPolicies:
    """Train the policies of the tables and the curves of the figures.

    Args:
      setting: the robot.
      gradient: settings of training by gradients, for the history policies.
      ppo: settings of PPO, for the six-number policies and the curves.
      seed: of the policies, and of the first curve.
      curve_seeds: curves per figure.
      folder: of the run; each training writes a folder below it.
      workers: processes.
    """
    tasks = _training_tasks(setting, gradient, ppo, seed, curve_seeds)
    jobs = [(run_task, task, float(task.decisions)) for task in tasks.values()]
    done = dict(zip(tasks, run_tasks("training", "decisions", jobs, workers), strict=True))
    for name, result in done.items():
        write_run(folder / "policies" / name, result, tasks[name].facts())
    return TrainedPolicies(
        policies={
            limit: tuple(done[f"{limit}-{observation}"].policy for observation in TRAINERS) for limit in COMMAND_LIMITS
        },
        static_curves=_curves(done, "static"),
        dynamic_curves=_curves(done, "dynamic"),
    )


def _training_tasks(
    setting: Setting, gradient: GradientConfig, ppo: PpoConfig, seed: int, curve_seeds: int
) -> dict[str, TrainingTask]:
    both = TrainingTask(setting, 0.5, "history", DEFAULT_FRAMES, "gate", ppo, seed, gradient=gradient)
    shorter = replace(ppo, steps=max(1, round(CURVE_STEPS * ppo.steps)))
    tasks = {
        f"{limit}-{observation}": replace(both, command_limit=limit, observation=observation, trainer=trainer)
        for limit in COMMAND_LIMITS
        for observation, trainer in TRAINERS.items()
    }
    for target, share in (("static", 1.0), ("dynamic", 0.0)):
        for curve in range(seed, seed + curve_seeds):
            tasks[f"box-{target}-{curve}"] = replace(
                both, static_share=share, command_limit="box", ppo=shorter, seed=curve
            )
    return tasks


def _curves(done: dict[str, TrainingResult], target: str) -> LearningCurves:
    results = [result for name, result in done.items() if name.startswith(f"box-{target}-")]
    return LearningCurves(
        steps=tuple(int(step) for step in results[0].curve.steps),
        runs=tuple(
            TrainingRun(int(result.policy.training["seed"]), tuple(np.round(result.mean_return, 4).tolist()))
            for result in results
        ),
    )


def evaluate_all(
    setting: Setting,
    policies: dict[str, tuple[PolicyRecord, ...]],
    engagements: int,
    seed: int,
    workers: int,
    *,
    quick: bool = False,
) -> dict[str, Any]:
    """Shoot Tables II and III under every command limit.

    Args:
      setting: the robot.
      policies: command limit → policies.
      engagements: per cell.
      seed: of engagements and dispersion.
      workers: processes.
      quick: leave out the controllers that the report shows in its folded tables alone.

    Returns:
      `cells`, `comparisons` and `accelerations` of the results.
    """
    shown = {names: limits for names, limits in CONTROLLERS.items() if not (quick and names in NOT_QUICK)}
    groups = _evaluation_tasks(setting, policies, engagements, seed, shown)
    jobs: list[Task] = [(run_evaluations, group, _work(group)) for group in groups]
    jobs += [(run_bounds, EvaluationTask(setting, limit, engagements, seed), 1.0) for limit in policies]
    done = run_tasks("evaluating", "controllers", jobs, workers)
    bounds = dict(zip(policies, done[len(groups) :], strict=True))
    outcomes: dict[str, list[Outcome]] = {limit: [] for limit in policies}
    for group, found in zip(groups, done[: len(groups)], strict=True):
        for task, shot in zip(group, found, strict=True):
            outcomes[task.command_limit] += shot
    grounds = {limit: make_ground(EvaluationTask(setting, limit, 2, seed)) for limit in outcomes}
    return {
        "cells": tuple(each for limit in outcomes for each in cells(grounds[limit], outcomes[limit], bounds[limit])),
        "comparisons": tuple(
            each
            for limit in outcomes
            for name in AGAINST
            for each in comparisons(grounds[limit], outcomes[limit], name)
        ),
        "accelerations": tuple(each for limit in outcomes for each in accelerations(grounds[limit], outcomes[limit])),
    }


def _work(group: Sequence[EvaluationTask]) -> float:
    return float(sum(len(task.controllers) + len(task.policies) for task in group))


def _evaluation_tasks(
    setting: Setting,
    policies: dict[str, tuple[PolicyRecord, ...]],
    engagements: int,
    seed: int,
    controllers: Mapping[tuple[str, ...], tuple[str, ...]],
) -> list[list[EvaluationTask]]:
    classical = [
        [EvaluationTask(setting, limit, engagements, seed, controllers=names) for limit in limits]
        for names, limits in controllers.items()
    ]
    trained = [
        EvaluationTask(setting, limit, engagements, seed, policies=records) for limit, records in policies.items()
    ]
    return [*classical, trained]

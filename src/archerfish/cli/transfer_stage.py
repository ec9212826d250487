"""The robot's part of `reproduce`, and all of `transfer`: record, identify, train, and shoot Tables IV and V."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from archerfish.cli.evaluation_run import (
    EvaluationTask,
    make_ground,
    run_evaluation,
    tune_controllers,
)
from archerfish.cli.lab_stage import LabTask, record_robot, run_recording
from archerfish.cli.robot_identification import Identified, identify_robot, trimmed
from archerfish.cli.setting import Setting
from archerfish.cli.training_run import TrainingTask, run_task, write_run
from archerfish.cli.workers import Task, run_tasks
from archerfish.controllers.roster import Tuning
from archerfish.evaluation.evaluate import Ground, Outcome, accelerations, cells, comparisons, ground_bounds
from archerfish.evaluation.robot_results import RobotIdentification
from archerfish.evaluation.transfer import drops
from archerfish.evaluation.tuning import GRIDS, Tuned
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.policy import PolicyRecord
from archerfish.virtual_robot.description_file import load_robot

COMMAND_LIMIT = "gate"
TABLES = ("IV", "V")
CONTROLLERS = ("oracle", "parabola-lq", "imm-lq", "kalman-lq", "kalman")
"""Classical controllers, the one with the most work first."""
STILL_SHARE = 0.35
"""Share of the targets in training that stand still: where a moving one will be is what takes long to learn."""
TUNED_DECISIONS = 600_000.0
"""About so many decisions does it take to tune a controller: some two dozen settings, 512 engagements each."""
AGAINST = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "oracle")
"""Whom the policies are compared with, paired."""


@dataclass(frozen=True)
class Rehearsal:
    """Whom to rehearse with, and how thoroughly."""

    robot: str
    """Robot that is recorded and identified: name or file."""
    changed: tuple[str, ...]
    """Robots that the same policies shoot with as well, after first shots to trim by: names or files."""
    gradient: GradientConfig
    """Settings of training the history policies."""
    ppo: PpoConfig
    """Settings of training the six-number policy."""
    seeds: tuple[int, ...]
    """Of the history policies; the first one's is that of everything else."""
    engagements: int
    """Per cell."""
    folder: Path
    """For logs, records and policies."""
    workers: int
    """Processes."""


def robot_name(robot: str) -> str:
    """Return the name of a robot that is given by name or file."""
    return load_robot(robot).schema.name


def record_and_identify(rehearsal: Rehearsal) -> Identified:
    """Record a robot and identify it from the logs alone."""
    logs = rehearsal.folder / "logs"
    record_robot(rehearsal.robot, logs, rehearsal.seeds[0], rehearsal.workers)
    return identify_robot(
        robot_name(rehearsal.robot), logs, rehearsal.folder / "records", rehearsal.seeds[0], rehearsal.workers
    )


def train_and_tune(rehearsal: Rehearsal, setting: Setting) -> tuple[tuple[PolicyRecord, ...], dict[str, Tuning]]:
    """Train policies and tune the classical controllers in the identified simulator, each on draws of its own.

    Returns:
      The policies, history first and the one of six numbers last; controller → its settings.
    """
    six_numbers = TrainingTask(
        setting, STILL_SHARE, "paper", 0, COMMAND_LIMIT, rehearsal.ppo, rehearsal.seeds[0], asymmetric=True
    )
    history = replace(
        six_numbers, observation="tracked", trainer="gradient", gradient=rehearsal.gradient, asymmetric=False
    )
    trainings = [*(replace(history, seed=seed) for seed in rehearsal.seeds), six_numbers]
    tunings = [
        EvaluationTask(setting, COMMAND_LIMIT, 2, rehearsal.seeds[0], (name,)) for name in CONTROLLERS if name in GRIDS
    ]
    # The trainings come first: a process that has computed anything has no more say in its number of devices.
    jobs: list[Task] = [(run_task, task, float(task.decisions)) for task in trainings]
    jobs += [(_tune, task, TUNED_DECISIONS) for task in tunings]
    done = run_tasks("training, tuning", "decisions", jobs, rehearsal.workers)
    trained, tuned = done[: len(trainings)], done[len(trainings) :]
    for task, result in zip(trainings, trained, strict=True):
        name = f"{setting.name}-{'history' if task.observation == 'tracked' else task.observation}-{task.seed}"
        write_run(rehearsal.folder / "policies" / name, result, task.facts())
    policies = tuple(result.policy for result in trained)
    return policies, {each.controller: each.tuning for found in tuned for each in found}


def _tune(task: EvaluationTask, advance: Callable[[float, str], None]) -> list[Tuned]:
    advance(0.0, f"tuning {task.controllers[0]}")
    return tune_controllers(task)


def shoot_tables(
    rehearsal: Rehearsal, identified: Identified, policies: Sequence[PolicyRecord], tuning: Mapping[str, Tuning]
) -> dict[str, Any]:
    """Shoot Tables IV and V in the identified simulator, with the robot, and with those that have changed.

    Returns:
      `cells`, `comparisons`, `accelerations` and `drops` of the results.
    """
    grounds = _grounds(rehearsal, identified.setting, tuning)
    entrants = [*CONTROLLERS, *policies]
    jobs: list[Task] = []
    for task in grounds:
        known = _with_muzzle_of(task.setting, policies)
        jobs += [(run_evaluation, replace(task, controllers=(name,)), 1.0) for name in CONTROLLERS]
        jobs += [(run_evaluation, replace(task, policies=(policy,)), 1.0) for policy in known]
    found = run_tasks("shooting", "controllers", jobs, rehearsal.workers)
    outcomes: list[list[Outcome]] = [
        list(chain.from_iterable(found[first : first + len(entrants)])) for first in range(0, len(found), len(entrants))
    ]
    return _parts([make_ground(task) for task in grounds], outcomes, rehearsal.seeds[0])


def _grounds(rehearsal: Rehearsal, setting: Setting, tuning: Mapping[str, Tuning]) -> list[EvaluationTask]:
    simulated = EvaluationTask(
        setting, COMMAND_LIMIT, rehearsal.engagements, rehearsal.seeds[0], tables=TABLES, tuning=tuning
    )
    changed = [replace(simulated, robot=each, setting=_trimmed(rehearsal, setting, each)) for each in rehearsal.changed]
    return [simulated, replace(simulated, robot=rehearsal.robot), *changed]


def _trimmed(rehearsal: Rehearsal, setting: Setting, robot: str) -> Setting:
    folder = rehearsal.folder / "logs" / robot_name(robot)
    run_recording(LabTask("trim", robot, folder, rehearsal.seeds[0] + 1))
    return trimmed(setting, folder / "first_shots.csv")


def _with_muzzle_of(setting: Setting, policies: Iterable[PolicyRecord]) -> list[PolicyRecord]:
    """Let policies aim with the muzzle of a setting."""
    names = ("speed", "drag", "length", "pitch_offset", "yaw_offset")
    muzzle = {name: float(getattr(setting.muzzle, name)) for name in names}
    return [replace(policy, muzzle=muzzle) for policy in policies]


def _parts(grounds: Sequence[Ground], outcomes: Sequence[list[Outcome]], seed: int) -> dict[str, Any]:
    pairs = list(zip(grounds, outcomes, strict=True))
    simulated = outcomes[0]
    return {
        "cells": tuple(each for ground, shot in pairs for each in cells(ground, shot, ground_bounds(ground, seed))),
        "comparisons": tuple(
            each for ground, shot in pairs for name in AGAINST for each in comparisons(ground, shot, name)
        ),
        "accelerations": tuple(each for ground, shot in pairs for each in accelerations(ground, shot)),
        "drops": tuple(each for ground, shot in pairs[1:] for each in drops(ground, shot, simulated)),
    }


def rehearse(rehearsal: Rehearsal) -> tuple[Identified, dict[str, Any]]:
    """Do all of it.

    Returns:
      What the logs told, and the parts of the results.
    """
    identified = record_and_identify(rehearsal)
    policies, tuning = train_and_tune(rehearsal, identified.setting)
    report: RobotIdentification = replace(
        identified.report,
        facts=identified.report.facts | {name: _tuned_values(name, each) for name, each in tuning.items()},
    )
    return identified, {"robot": report, **shoot_tables(rehearsal, identified, policies, tuning)}


_UNITS = {"acceleration_sd": "_m_s2", "initial_speed": "_m_s", "turn_rate": "_1_s"}
"""Setting → unit that its name doesn't carry."""


def _tuned_values(controller: str, tuning: Tuning) -> dict[str, float]:
    """Return what was tuned of a controller by name."""
    return {f"{name}{_UNITS.get(name, '')}": getattr(tuning, name) for name in GRIDS[controller]}

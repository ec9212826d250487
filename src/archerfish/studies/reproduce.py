"""The whole paper: Fig. 4, Table I, Figs 5 and 6, Tables II and III, and on a virtual robot Tables IV and V."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import json
from pathlib import Path
from typing import Any, get_args

from archerfish.evaluation.results import Cell
from archerfish.studies.paper_figures import figure_4, table_1
from archerfish.studies.study import OURS, SIX_NUMBERS, Axis, LearningCurve, Study
from archerfish.studies.transfer import QUICK_STEPS, evaluation, timed, training, transfer
from archerfish.studies.workers import Job, run_jobs
from archerfish.task import Task

LIMITS = ("gate", "box", "los-2deg")
"""Command limits that policies are trained under; classical controllers are evaluated under the first two."""
BASELINES = ("oracle", "parabola-lq", "imm-lq", "kalman-lq", "no-lead", "kalman", "kalman-paper", "perfect")
"""Classical controllers and perfect aim, the one with the most work first."""
CURVE_STEPS = 800_000
"""Decisions after which the curves of Figs 5 and 6 have flattened."""
CURVES = 3
"""Trainings of each curve."""
QUICK_PAPER_ENGAGEMENTS, QUICK_ROBOT_ENGAGEMENTS = 40, 10


def reproduce(
    folder: Path, *, robot: str | Path, seed: int, engagements: int, robot_engagements: int, workers: int, quick: bool
) -> Study:
    """Do the whole paper: identify the printed gimbal, train, evaluate, and take a virtual robot through `transfer`.

    Args:
      folder: for logs, records and policies; those of the robot in robot/.
      robot: the virtual robot of Tables IV and V: "infantry", "worn", or a TOML file.
      seed: of everything random.
      engagements: per cell of Tables II and III.
      robot_engagements: per cell of Tables IV and V.
      workers: number of processes.
      quick: whether trainings are short and engagements few: the figures are not to be quoted then.

    Raises:
      InputError: if an argument, or the robot's file, can't be used.
    """
    durations, policies = dict[str, float](), folder / "policies"
    with timed(durations, "the paper: identification and training"):
        axes = [Job(figure_4, {"axis": axis, "folder": folder / "gimbal", "seed": seed}) for axis in get_args(Axis)]
        trainings = paper_trainings(policies, seed, quick=quick)
        # The trainings come first, as they take longest.
        done = run_jobs("training", [*trainings, *axes], workers)
    with timed(durations, "the paper: evaluation"):
        count = min(engagements, QUICK_PAPER_ENGAGEMENTS) if quick else engagements
        first, *others = run_jobs("evaluating", paper_evaluations(policies, count, seed), workers)
        results = first.join(others)
    count = min(robot_engagements, QUICK_ROBOT_ENGAGEMENTS) if quick else robot_engagements
    own = transfer(robot, folder / "robot", seeds=(seed,), engagements=count, workers=workers, quick=quick)
    durations |= {f"the robot: {stage}": seconds for stage, seconds in own.durations.items()}
    landings, muzzle = table_1()
    return own.replace(
        results=results.join(own.results.replace(cells=[_in_table(cell, own.virtual) for cell in own.results.cells])),
        steps=(*done[len(trainings) :], *own.steps),
        landings=landings,
        muzzle=muzzle,
        curves=learning_curves(policies),
        durations=durations,
    )


def _in_table(cell: Cell, virtual: str) -> Cell:
    """Return a cell of the virtual robot as one of Table IV or V."""
    return cell.replace(table="IV" if cell.motion == "static" else "V") if cell.world == virtual else cell


def paper_trainings(folder: Path, seed: int, *, quick: bool) -> list[Job]:
    """Return the trainings of Tables II and III, and of the curves of Figs 5 and 6.

    Args:
      folder: for the policies.
      seed: of the policies, and of the first of the curves.
      quick: whether all are short.
    """
    steps, jobs = QUICK_STEPS if quick else None, list[Job]()
    for limit in LIMITS:
        task = Task.load("paper").replace(command_limit=limit)
        jobs.append(training(task, folder / f"{limit}-{OURS}", seed=seed, steps=steps))
        jobs.append(training(task, folder / f"{limit}-{SIX_NUMBERS}", seed=seed, observation="paper", steps=steps))
    for targets in ("static", "dynamic"):
        task = Task.load(targets).replace(command_limit="box")
        for curve in range(seed, seed + (1 if quick else CURVES)):
            out, length = folder / curve_name(targets, curve), steps or CURVE_STEPS
            jobs.append(training(task, out, seed=curve, observation="history", trainer="ppo", steps=length))
    return jobs


def curve_name(targets: str, seed: int) -> str:
    """Return the name of a curve's training."""
    return f"{targets}-curve-{seed}"


def paper_evaluations(policies: Path, engagements: int, seed: int) -> list[Job]:
    """Return the evaluations of Tables II and III.

    Args:
      policies: folder of the trainings.
      engagements: per cell.
      seed: of engagements and dispersion.
    """
    jobs = list[Job]()
    for limit in LIMITS:
        task = Task.load("paper").replace(command_limit=limit)
        contenders: list[tuple[str, Any]] = [(name, name) for name in BASELINES if limit != "los-2deg"]
        contenders += [(name, policies / f"{limit}-{name}") for name in (OURS, SIX_NUMBERS)]
        jobs += [evaluation(name, given, task, engagements=engagements, seed=seed) for name, given in contenders]
    return jobs


def learning_curves(policies: Path) -> tuple[LearningCurve, ...]:
    """Return Figs 5 and 6 from the logs of their trainings.

    Args:
      policies: folder of the trainings.
    """
    curves = list[LearningCurve]()
    for path in sorted(policies.glob("*-curve-*")):
        targets: Any = path.name.partition("-")[0]
        rows = [json.loads(line) for line in (path / "log.jsonl").read_text("utf-8").splitlines()]
        seed = int(path.name.rpartition("-")[2])
        columns = {name: tuple(row[name] for row in rows) for name in ("decisions", "mean_reward")}
        curves.append(LearningCurve(targets=targets, seed=seed, **columns))
    return tuple(curves)

"""The whole paper: Fig. 4, Table I, Figs 5 and 6, Tables II and III, and on a virtual robot Tables IV and V."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from pathlib import Path
from typing import Any

from archerfish2.evaluation.results import Results
from archerfish2.studies.transfer import POLICY, QUICK_STEPS, SIX_NUMBERS, evaluation, training
from archerfish2.studies.workers import Job
from archerfish2.task import Task

LIMITS = ("gate", "box", "los-2deg")
"""Command limits that policies are trained under; classical controllers are evaluated under the first two."""
BASELINES = ("oracle", "parabola-lq", "imm-lq", "kalman-lq", "no-lead", "kalman", "kalman-paper", "perfect")
"""Classical controllers and perfect aim, the one with the most work first."""
CURVE_STEPS = 800_000
"""Decisions after which the curves of Figs 5 and 6 have flattened."""
CURVES = 3
"""Trainings of each curve."""
QUICK_ENGAGEMENTS = 40


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
        jobs.append(training(task, folder / f"{limit}-{POLICY}", seed=seed, steps=steps))
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
        contenders += [(name, policies / f"{limit}-{name}") for name in (POLICY, SIX_NUMBERS)]
        jobs += [evaluation(name, given, task, engagements=engagements, seed=seed) for name, given in contenders]
    return jobs


def joined(parts: list[Results]) -> Results:
    """Return the results of several evaluations as one."""
    first, *others = parts
    return first.join(others)

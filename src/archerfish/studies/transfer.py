"""From a robot's logs to a policy on the robot, and what the step from the simulator to the robot costs.

A script of the public functions: `VirtualRobot.record`, `identify_robot`, `train`, `tune` and `evaluate`, each with its
defaults, so that a robot of one's own that goes through the same commands gets the same records and rates.
"""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, get_args

from archerfish.controllers.tuning import GRIDS
from archerfish.errors import InputError
from archerfish.evaluation.evaluate import evaluate
from archerfish.evaluation.results import Results
from archerfish.evaluation.tuning_search import tune
from archerfish.identification.robot import identify_robot
from archerfish.learning.config import TrainConfig
from archerfish.learning.train import train
from archerfish.robot import Robot
from archerfish.studies.paper_figures import recorded_step
from archerfish.studies.study import OURS, SIX_NUMBERS, Axis, StepResponse, Study
from archerfish.studies.workers import Job, run_jobs
from archerfish.task import Task
from archerfish.virtual_robot.virtual_robot import VirtualRobot

COMPARED = ("oracle", "parabola-lq", "imm-lq", "kalman-lq", "kalman")
"""Classical controllers, the one with the most work first."""
QUICK_STEPS, QUICK_ENGAGEMENTS = 300_000, 20


def transfer(
    robot: str | Path, folder: Path, *, seeds: Sequence[int], engagements: int, workers: int, quick: bool = False
) -> Study:
    """Record a virtual robot, identify it, train and tune in its simulator, and evaluate there and on the robot.

    Parts of the robot that their identification finds not usable are used all the same; the result names them.

    Args:
      robot: "infantry", "worn", or a TOML file.
      folder: for logs, the robot's records, and policies.
      seeds: of the trainings; the first one also of noise, identification and engagements.
      engagements: per cell.
      workers: number of processes.
      quick: whether trainings are short and engagements few: the rates are not to be quoted then.

    Raises:
      InputError: if an argument, or the robot's file, can't be used.
    """
    virtual, seed, durations = VirtualRobot.load(robot), seeds[0], dict[str, float]()
    logs, records, policies = folder / "logs", folder / "robot", folder / "policies"
    with timed(durations, "recording"):
        virtual.record(logs, seed=seed)
    with timed(durations, "identification"):
        identified = identify_robot(logs, out=records, name=virtual.name, seed=seed)
    task, decisions = Task.load("paper"), QUICK_STEPS if quick else None
    with timed(durations, "training"):
        trainings = [
            training(task, policies / f"{OURS}-{own}", seed=own, robot=records, steps=decisions) for own in seeds
        ]
        trainings += [
            training(task, policies / SIX_NUMBERS, seed=seed, robot=records, observation="paper", steps=decisions)
        ]
        tunings = [Job(_tune, {"name": name, "robot": records}, 1.0, f"tuning {name}") for name in GRIDS]
        run_jobs("training", [*trainings, *tunings], workers)
    with timed(durations, "evaluation"):
        contenders: list[tuple[str, Any]] = [(name, name) for name in COMPARED]
        contenders += [(OURS, policies / f"{OURS}-{own}") for own in seeds]
        contenders += [(SIX_NUMBERS, policies / SIX_NUMBERS)]
        count = min(engagements, QUICK_ENGAGEMENTS) if quick else engagements
        jobs = [
            evaluation(name, given, task, engagements=count, seed=seed, robot=records, world=world)
            for world in (None, virtual)
            for name, given in contenders
        ]
        first, *others = run_jobs("evaluating", jobs, workers)
        results = first.join(others)
    steps = tuple(step for axis in get_args(Axis) for step in _recorded_steps(axis, logs, identified.record))
    return Study(
        quick=quick,
        results=results,
        robot=identified.record.name,
        virtual=virtual.world(identified, task).name,
        parts=identified.record.parts,
        steps=steps,
        durations=durations,
    )


def _recorded_steps(axis: Axis, logs: Path, robot: Robot) -> list[StepResponse]:
    """Return the steps that no fit has used, the smallest first."""
    steps = [recorded_step(axis, log, getattr(robot, axis)) for log in logs.glob(f"{axis}_step_*deg.csv")]
    return sorted(steps, key=lambda step: abs(step.size_deg))


def training(
    task: Task,
    out: Path,
    *,
    seed: int,
    robot: Path | None = None,
    observation: str | None = None,
    trainer: Literal["gradient", "ppo"] | None = None,
    steps: int | None = None,
) -> Job:
    """Return the job of a training; arguments as of `train`, with the observation of its settings.

    Raises:
      InputError: if a setting can't be used.
    """
    found = TrainConfig(trainer=trainer, observation=observation).resolved(_read(robot), task)
    work = (steps or found.settings.steps) / 1e6 * (1.0 if found.trainer == "gradient" else 0.3)
    arguments: dict[str, Any] = {"robot": robot, "task": task, "out": out, "seed": seed, "steps": steps}
    arguments |= {"observation": observation, "trainer": trainer}
    return Job(_train, arguments, work, f"{out.name}")


def evaluation(
    name: str,
    given: Any,
    task: Task,
    *,
    engagements: int,
    seed: int,
    robot: Path | None = None,
    world: VirtualRobot | None = None,
) -> Job:
    """Return the job of the evaluation of one controller, under a name; the other arguments are those of `evaluate`."""
    arguments = {"name": name, "given": given, "task": task, "robot": robot, "world": world}
    return Job(_evaluate, {**arguments, "engagements": engagements, "seed": seed}, name=name)


@contextmanager
def timed(durations: dict[str, float], stage: str) -> Iterator[None]:
    """Add how long a block takes to the duration of a stage [s]."""
    begun = time.monotonic()
    yield
    durations[stage] = round(durations.get(stage, 0.0) + time.monotonic() - begun, 2)


def check_settings(seeds: Sequence[int], engagements: int, workers: int) -> None:
    """Refuse numbers of a study that can't be used.

    Raises:
      InputError: naming the option.
    """
    if not seeds or len(set(seeds)) < len(seeds) or min(seeds) < 0:
        raise InputError(f"seeds must be one or more different whole numbers from 0 on, got {[*seeds]}; choose others")
    if engagements < 2:
        raise InputError(f"engagements must be at least 2, got {engagements}; choose more")
    if workers < 1:
        raise InputError(f"workers must be at least 1, got {workers}; choose more")


def _train(
    robot: Path | None, task: Task, out: Path, seed: int, steps: int | None, observation: str | None, trainer: Any
) -> None:
    train(_read(robot), task, config={"observation": observation}, trainer=trainer, seed=seed, steps=steps, out=out)


def _tune(name: str, robot: Path) -> None:
    tune(name, _read(robot), "paper")


def _evaluate(
    name: str, given: Any, task: Task, robot: Path | None, world: VirtualRobot | None, engagements: int, seed: int
) -> Results:
    return evaluate({name: given}, _read(robot), task, world=world, engagements=engagements, seed=seed)


def _read(robot: Path | None) -> Robot:
    return Robot.load(robot, accept_unusable=True) if robot else Robot.paper()

"""One trial: a training, then shots on the tuning's own engagements. Runs in any process, on any machine."""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.cli.setting import setting_world
from archerfish.cli.training_run import TrainingTask, run_task, write_run
from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.evaluation.evaluate import Entrant, Ground, compete
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.evaluation.suites import draw_trials, table_suites
from archerfish.learning.shards import claim_devices
from archerfish.records.errors import InputError
from archerfish.records.policy import PolicyRecord

STREAM = "tuning"
"""Engagements that score a trial are never those of an evaluation: what was chosen on them may still be judged."""


@dataclass(frozen=True)
class TrialJob:
    """A trial, as data: it can be handed to another machine, which needs none of our files."""

    task: TrainingTask
    """The training; its setting names no files."""
    inputs: Mapping[str, str]
    """Files that its setting was read from: name → SHA-256."""
    engagements: int
    """Per cell, to score it."""
    engagement_seed: int
    """Of these engagements; the same for all trials, so that they compare."""
    configuration: Mapping[str, Any]
    """What config.json of the trial is to say."""


@dataclass(frozen=True)
class CellHits:
    """One cell of the tables: k hits of n decisions."""

    target: str
    """"static" or "dynamic"."""
    range_m: tuple[float, float]
    """Smallest and largest distance [m]."""
    hits: int
    """Shots that hit, k."""
    shots: int
    """Decisions, n; one that withholds its shot counts as a miss."""
    low: float
    """Lower end of the 95 % interval of the hit rate by engagement, 0 to 1."""
    high: float
    """Upper end, 0 to 1."""
    hits_by_engagement: tuple[int, ...]
    """Hits in each engagement, in the order in which all trials meet them."""


@dataclass(frozen=True)
class TrialDone:
    """What comes back from a trial."""

    problem: str | None
    """Why it came to nothing, for instance a training that diverged; None if it did not."""
    cells: tuple[CellHits, ...] = ()
    """Cells of Tables II and III."""
    mean_return: float | None = None
    """Mean return of an engagement at the end of the training [m]."""
    weights_sha256: str = ""
    """Hash of the final weights."""
    seconds: float = 0.0
    """Wall time, compilation included."""
    files: Mapping[str, bytes] | None = None
    """What a run folder holds: name → content; None if it came to nothing."""


def run_trial(job: TrialJob) -> TrialDone:
    """Train and shoot; a training that can't be done is an outcome too."""
    begun = time.monotonic()
    # A worker that has computed once keeps its devices: whatever it trains first, they suffice for all of the sweep.
    claim_devices(max(job.task.ppo.shards, job.task.gradient.shards))
    try:
        result = run_task(job.task)
    except InputError as error:
        return TrialDone(str(error), seconds=time.monotonic() - begun)
    policy = replace(result.policy, provenance={**result.policy.provenance, "inputs": dict(job.inputs)})
    with tempfile.TemporaryDirectory() as folder:
        write_run(Path(folder), replace(result, policy=policy), dict(job.configuration))
        files = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
    return TrialDone(
        problem=None,
        cells=_shoot(job, policy),
        mean_return=float(result.mean_return[-1]),
        weights_sha256=result.weights_sha256,
        seconds=time.monotonic() - begun,
        files=files,
    )


def _shoot(job: TrialJob, policy: PolicyRecord) -> tuple[CellHits, ...]:
    setting, conditions = job.task.setting, job.task.setting.conditions
    world = setting_world(setting, job.task.command_limit)
    suites = table_suites(conditions, world.plants)
    trials = draw_trials(suites, job.engagements, conditions.decisions, job.engagement_seed, STREAM, world.normals)
    ground = Ground(world, trials, job.task.command_limit, setting.name, conditions)
    (outcome,) = compete(ground, [Entrant("policy", controller_from_record(policy), job.task.seed)])
    return tuple(_cell(suite.target, suite.range_m, hit) for suite, hit in zip(suites, outcome.hit, strict=True))


def _cell(target: str, range_m: tuple[float, float], hit: Any) -> CellHits:
    counted = hit_rate(hit)
    by_engagement = tuple(int(each) for each in np.sum(hit, axis=1))
    low, high = (float(each) for each in (counted.low, counted.high))
    return CellHits(
        target, (float(range_m[0]), float(range_m[1])), counted.hits, counted.shots, low, high, by_engagement
    )


def job_configuration(task: TrainingTask, engagements: int, engagement_seed: int) -> dict[str, Any]:
    """Return what config.json of a trial says."""
    names = ("static_share", "observation", "frames", "command_limit", "seed", "trainer")
    return {
        "setting": task.setting.name,
        **{name: getattr(task, name) for name in names},
        task.trainer: asdict(task.config),
        "conditions": asdict(task.setting.conditions),
        "scored_on": {"stream": STREAM, "seed": engagement_seed, "engagements": engagements},
    }

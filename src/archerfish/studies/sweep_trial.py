"""A training of a sweep: the policy of some settings and a seed, and how often it hits."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta

from archerfish import storage
from archerfish.controllers.policy.policy import Policy
from archerfish.errors import InputError
from archerfish.evaluation.draws import draw
from archerfish.evaluation.run import count
from archerfish.learning.config import TrainConfig
from archerfish.learning.run_folder import CHECKPOINT, FAULT, POLICY, PREVIOUS, read_run
from archerfish.learning.train import resume, train
from archerfish.records.record import Record
from archerfish.robot import Robot
from archerfish.simulation.world import make_world
from archerfish.task import Task

HITS = "hits.json"
"""File of a training's hits, in its folder."""
_Counts = tuple[Annotated[int, Meta(ge=0)], ...]


class TrialHits(Record, frozen=True, kw_only=True):
    """What the policy of a training hit; nothing where the training came to none."""

    schema: ClassVar[str] = "archerfish.hits/1"
    remedy: ClassVar[str] = "remove its folder, and sweep again"
    hits: tuple[_Counts, ...] = ()
    """Of each engagement, by cell."""
    decisions: _Counts = ()
    """Of an engagement, by cell."""
    problem: str = ""
    """Why the training came to nothing."""

    @property
    def total(self) -> tuple[int, int]:
        """Hits, and decisions, of all cells."""
        pairs = list(zip(self.hits, self.decisions, strict=True))
        return sum(sum(cell) for cell, _ in pairs), sum(len(cell) * decisions for cell, decisions in pairs)

    @property
    def rate(self) -> float:
        """Hits per decision, 0 to 1."""
        hits, decisions = self.total
        return hits / max(decisions, 1)


def with_parameters(config: TrainConfig, parameters: Mapping[str, Any]) -> TrainConfig:
    """Return settings with some fields changed, by names as "trainer" or "gradient.learning_rate".

    Raises:
      InputError: if a value can't be used.
    """
    changes: dict[str, Any] = {}
    for name, value in parameters.items():
        part, _, field = name.rpartition(".")
        place = changes.setdefault(part, {}) if part else changes
        place[field] = value
    parts = {
        part: getattr(config, part).replace(**changes.pop(part)) for part in ("gradient", "ppo") if part in changes
    }
    return config.replace(**changes, **parts)


def train_and_count(
    robot: Robot, task: Task, config: TrainConfig, engagements: int, parameters: dict[str, Any], seed: int, folder: Path
) -> None:
    """Train a policy, or continue its training, count its hits and write them; settings that come to nothing, too.

    Args:
      robot: that is trained for.
      task: that is trained and measured on.
      config: of the training.
      engagements: per cell.
      parameters: in the place of the settings'.
      seed: of the training.
      folder: of the training.

    Raises:
      InputError: if a file can't be written or read.
    """
    try:
        policy = _trained(robot, task, with_parameters(config, parameters), seed, folder)
    except InputError as error:
        if (folder / storage.RUN).exists() and not (folder / FAULT).exists():
            raise
        TrialHits(problem=str(error).partition(";")[0]).save(folder / HITS)
    else:
        _counted(policy, robot, task, engagements).save(folder / HITS)


def _trained(robot: Robot, task: Task, config: TrainConfig, seed: int, folder: Path) -> Policy:
    if (folder / POLICY).exists():
        return Policy.load(folder, blocks=config.names[1:])
    # A process that is killed while it writes a checkpoint leaves the one before alone.
    if (folder / CHECKPOINT).exists() or (folder / PREVIOUS).exists():
        if not read_run(folder).code:
            return resume(folder)
        shutil.rmtree(folder)
    return train(robot, task, config=config, seed=seed, out=folder)


def _counted(policy: Policy, robot: Robot, task: Task, engagements: int) -> TrialHits:
    """Return the hits of a policy, in the same engagements for every policy."""
    world, hits, decisions = make_world(robot, task), list[list[int]](), list[int]()
    for length in task.lengths:
        cells = task.replace(lengths_s=(length,)).cells()
        drawn = draw(cells, engagements, 0, "tuning", world.normals, world.plants)
        hit = count(world, policy, *drawn).hit
        hits += np.asarray(hit).reshape(len(cells), engagements, -1).sum(axis=2).tolist()
        decisions += [cell.decisions for cell in cells]
    return TrialHits(hits=tuple(map(tuple, hits)), decisions=tuple(decisions))

"""Configurations in order: the best is the one whose hit rate is at least the highest, with 95 % confidence."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.sweeping.results import TrialResult
from archerfish.evaluation.pooling import Estimate
from archerfish.evaluation.seed_pooling import SeedSpread, pooled_trainings, seed_spread


@dataclass(frozen=True)
class Standing:
    """How one configuration did in one world."""

    world: str
    """What was trained and shot in."""
    configuration: int
    """Number of the configuration."""
    parameters: dict[str, Any]
    """What is varied: name → value."""
    seeds: tuple[int, ...]
    """Of its trainings that came to something."""
    failed: int
    """Trainings that came to nothing."""
    hits: int
    """Shots that hit, all its trainings together."""
    shots: int
    """Decisions; one that withholds its shot counts as a miss."""
    rate: float
    """Hits per decision, 0 to 1."""
    low: float
    """Lower end of the 95 % interval, by which configurations are ranked; engagements, and seeds where several were
    trained."""
    high: float
    """Upper end."""
    lowest: float
    """Hit rate of the worst training."""
    highest: float
    """Hit rate of the best one."""
    problem: str | None
    """Why the first of the failed ones came to nothing."""


def rank(results: Iterable[TrialResult]) -> list[Standing]:
    """Rank configurations within each world: those that never failed first, by the lower end of their interval.

    Args:
      results: finished trials.
    """
    ordered = sorted(results, key=lambda each: each.trial)
    standings: list[Standing] = []
    for world in dict.fromkeys(each.world for each in ordered):
        here = [each for each in ordered if each.world == world]
        groups = [[each for each in here if each.configuration == k] for k in sorted({e.configuration for e in here})]
        spread = seed_spread([[each.rate for each in group if each.problem is None] for group in groups])
        found = [_standing(group, spread) for group in groups]
        standings += sorted(found, key=lambda each: (each.failed > 0, -each.low, -each.rate, each.configuration))
    return standings


def _standing(group: Sequence[TrialResult], spread: SeedSpread | None) -> Standing:
    done = [each for each in group if each.problem is None]
    problems = [each.problem for each in group if each.problem is not None]
    rates = [each.rate for each in done] or [0.0]
    pooled = pooled_trainings(*_hits(done), spread) if done else Estimate(0.0, 0.0, 0.0)
    return Standing(
        world=group[0].world,
        configuration=group[0].configuration,
        parameters=group[0].parameters,
        seeds=tuple(each.seed for each in done),
        failed=len(problems),
        hits=sum(each.hits for each in done),
        shots=sum(each.shots for each in done),
        rate=pooled.value,
        low=pooled.low,
        high=pooled.high,
        lowest=min(rates),
        highest=max(rates),
        problem=problems[0] if problems else None,
    )


def _hits(done: Sequence[TrialResult]) -> tuple[NDArray[np.int64], int]:
    cell = done[0].cells[0]
    hits = [[cell.hits_by_engagement for cell in each.cells] for each in done]
    return np.array(hits, np.int64), cell.shots // len(cell.hits_by_engagement)


def score(results: Sequence[TrialResult]) -> float:
    """Return what a sampler is told of a configuration: its mean hit rate, a trial that failed hitting nothing."""
    return sum(each.rate for each in results) / len(results)

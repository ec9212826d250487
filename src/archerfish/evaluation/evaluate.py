"""Suite × controller → trials → counts; no controller is known here by name."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from archerfish.evaluation.bounds.cell_bounds import CellBounds, cell_bounds
from archerfish.evaluation.hit_rate import hit_rate, paired_difference, split_misses
from archerfish.evaluation.results import Acceleration, Cell, Comparison, Label
from archerfish.evaluation.suites import Suite, Trials
from archerfish.evaluation.trial import Shots, check_finite, fight, largest_acceleration, perfect_shots
from archerfish.paper.conditions import Conditions
from archerfish.paper.tables import printed_rate
from archerfish.sensing.interfaces import Controller, World
from archerfish.simulation.environment import PureWorld


@dataclass(frozen=True)
class Entrant:
    """A controller under the name that results give it."""

    name: str
    """Name of the controller in the results."""
    controller: Controller
    """Who decides."""
    policy_seed: int | None = None
    """Seed of its training, if it was trained."""


@dataclass(frozen=True)
class Outcome:
    """What one entrant did in all suites."""

    name: str
    """Name of the controller in the results."""
    policy_seed: int | None
    """Seed of its training, if it was trained."""
    hit: NDArray[np.bool_]
    """Whether each shot hit, shape (suites, engagements, decisions)."""
    yaw_acceleration: float | None
    """Largest acceleration of the yaw axis, by command or by motion, mean over a decision period [rad/s²]; None
    where nothing moved the gimbal."""
    needs_truth: bool = False
    """Whether the controller is given the target's path beforehand."""


@dataclass(frozen=True)
class Ground:
    """Where an evaluation takes place."""

    world: World
    """The world."""
    trials: Trials
    """Engagements and draws, the same for all entrants."""
    command_limit: str
    """Name of the command limit."""
    setting: str
    """"paper", "identified-<robot>" or "<robot>"."""
    conditions: Conditions
    """Hit radius and when an engagement counts as settled."""


def compete(
    ground: Ground, entrants: Iterable[Entrant], progress: Callable[[str], None] = lambda _: None
) -> list[Outcome]:
    """Let every entrant fight the same engagements with the same dispersion draws.

    Args:
      ground: where.
      entrants: who.
      progress: hears the name of each entrant that is done.
    """
    outcomes = []
    for entrant in entrants:
        shots = fight(ground.world, entrant.controller, ground.trials)
        needs_truth = bool(getattr(entrant.controller, "needs_truth", False))
        outcomes.append(replace(_outcome(ground, entrant.name, entrant.policy_seed, shots), needs_truth=needs_truth))
        progress(entrant.name)
    return outcomes


def perfect_aim(ground: Ground) -> Outcome:
    """Score perfect aim, "perfect": what the dispersion alone leaves."""
    world = cast(PureWorld, ground.world)  # a robot knows no perfect aim
    shots = perfect_shots(world, ground.trials)
    return Outcome("perfect", None, _hits(ground, shots), None)


def _outcome(ground: Ground, name: str, policy_seed: int | None, shots: Shots) -> Outcome:
    check_finite(name, shots.command)
    period = ground.world.period_s
    asked = max(largest_acceleration(angles, period, axis=1) for angles in (shots.command, shots.angle))
    return Outcome(name, policy_seed, _hits(ground, shots), asked)


def _hits(ground: Ground, shots: Shots) -> NDArray[np.bool_]:
    hit = shots.hits(ground.conditions.hit_radius)
    return hit.reshape(len(ground.trials.suites), -1, hit.shape[-1])


def ground_bounds(ground: Ground, seed: int) -> list[CellBounds] | None:
    """Bound what can be hit in every suite; None on a robot.

    Args:
      ground: where.
      seed: of its engagements.
    """
    radius = ground.conditions.hit_radius
    return cell_bounds(ground.world, ground.trials, radius, ground.setting, ground.command_limit, seed)


def cells(ground: Ground, outcomes: Iterable[Outcome], bounds: Sequence[CellBounds] | None = None) -> list[Cell]:
    """Count hits: one cell per suite and entrant.

    Args:
      ground: where.
      outcomes: of all entrants.
      bounds: one per suite, from `ground_bounds`; none where there are none.
    """
    return [
        _bounded(_cell(ground, suite, outcome, outcome.hit[index]), outcome, bounds[index] if bounds else None)
        for outcome in outcomes
        for index, suite in enumerate(ground.trials.suites)
    ]


def _cell(ground: Ground, suite: Suite, outcome: Outcome, hit: NDArray[np.bool_]) -> Cell:
    fired = ground.world.period_s * np.arange(1, hit.shape[-1] + 1)
    misses = split_misses(hit, fired, ground.conditions.settled_after_s)
    return Cell(
        **vars(_label(ground, suite, outcome)),
        **hit_rate(hit)._asdict(),
        misses_slewing=misses.slewing,
        misses_settled=misses.settled,
        paper=None if suite.motion else printed_rate(suite.table, suite.range_m, outcome.name),
    )


def _bounded(cell: Cell, outcome: Outcome, bounds: CellBounds | None) -> Cell:
    """Add the bound that holds of a controller; perfect aim moves no gimbal, so none does."""
    if bounds is None or outcome.yaw_acceleration is None:
        return cell
    bound = bounds.hindsight if outcome.needs_truth else bounds.causal
    return replace(cell, bound=bound.value, bound_error=bound.error, bound_kind=bound.kind)


def _label(ground: Ground, suite: Suite, outcome: Outcome) -> Label:
    return Label(
        table=suite.table,
        setting=ground.setting,
        target=suite.target,
        range_m=suite.range_m,
        command_limit=ground.command_limit,
        controller=outcome.name,
        policy_seed=outcome.policy_seed,
        motion=suite.motion,
    )


def accelerations(ground: Ground, outcomes: Iterable[Outcome]) -> list[Acceleration]:
    """Say how hard each entrant drove the yaw axis at most."""
    return [
        Acceleration(ground.setting, ground.command_limit, each.name, each.policy_seed, each.yaw_acceleration)
        for each in outcomes
        if each.yaw_acceleration is not None
    ]


def comparisons(ground: Ground, outcomes: list[Outcome], against: str) -> list[Comparison]:
    """Compare every trained entrant with another one, paired by engagement and dispersion draw.

    Args:
      ground: where it took place.
      outcomes: of all entrants.
      against: name of the other.
    """
    others = [outcome for outcome in outcomes if outcome.name == against]
    return [
        Comparison(
            **vars(_label(ground, suite, outcome)),
            against=against,
            **paired_difference(outcome.hit[index], other.hit[index])._asdict(),
        )
        for other in others
        for outcome in outcomes
        if outcome.policy_seed is not None
        for index, suite in enumerate(ground.trials.suites)
    ]

"""Suite × controller → trials → counts; no controller is known here by name."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from archerfish.evaluation.bounds.cell_bounds import CellBounds, cell_bounds
from archerfish.evaluation.hit_rate import Difference, hit_rate, paired_difference, split_misses
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
    """Whether each decision hit, shape (suites, engagements, decisions)."""
    fired: NDArray[np.bool_]
    """Whether each decision fired a shot, shape (suites, engagements, decisions)."""
    yaw_acceleration: float | None
    """Largest acceleration of the yaw axis, by command or by motion, mean over a decision period [rad/s²]; None
    where nothing moved the gimbal."""
    fallback: NDArray[np.bool_] | None = None
    """Whether it fell back on a simpler controller, shape (suites, engagements, decisions); None if never."""
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
      progress: receives the name of each entrant that is done.
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
    return Outcome("perfect", None, *_by_suite(ground, shots), None)


def _outcome(ground: Ground, name: str, policy_seed: int | None, shots: Shots) -> Outcome:
    check_finite(name, shots.command)
    period = ground.world.period_s
    asked = max(largest_acceleration(angles, period, axis=1) for angles in (shots.command, shots.angle))
    fallback = shots.fallback.reshape((len(ground.trials.suites), -1, shots.fired.shape[-1]))
    return Outcome(name, policy_seed, *_by_suite(ground, shots), asked, fallback if fallback.any() else None)


def _by_suite(ground: Ground, shots: Shots) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which decisions hit, and which fired."""
    shape = (len(ground.trials.suites), -1, shots.fired.shape[-1])
    return shots.hits(ground.conditions.hit_radius).reshape(shape), shots.fired.reshape(shape)


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
        _bounded(_cell(ground, suite, outcome, index), outcome, bounds[index] if bounds else None)
        for outcome in outcomes
        for index, suite in enumerate(ground.trials.suites)
    ]


def _cell(ground: Ground, suite: Suite, outcome: Outcome, index: int) -> Cell:
    hit, fired = outcome.hit[index], outcome.fired[index]
    fired_at = ground.world.period_s * np.arange(1, hit.shape[-1] + 1)
    misses = split_misses(hit, fired_at, ground.conditions.settled_after_s, suite.counted(fired))
    printed = suite.motion is None and suite.counts == "decisions"
    return Cell(
        **vars(suite_label(ground, suite, outcome)),
        **hit_rate(hit, suite.counted(fired))._asdict() | {"shots": int(fired.sum())},
        misses_slewing=misses.slewing,
        misses_settled=misses.settled,
        paper=printed_rate(suite.table, suite.range_m, outcome.name) if printed else None,
        withheld=int((~fired).sum()),
        fallbacks=0 if outcome.fallback is None else int(outcome.fallback[index].sum()),
        hits_per_s=float(hit.sum() / (ground.conditions.control_period_s * hit.size)),
    )


def _bounded(cell: Cell, outcome: Outcome, bounds: CellBounds | None) -> Cell:
    """Add the bound that holds of a controller.

    None does of perfect aim, which moves no gimbal, nor of a rate of fired shots alone.
    """
    if bounds is None or outcome.yaw_acceleration is None or cell.counts != "decisions":
        return cell
    bound = bounds.hindsight if outcome.needs_truth else bounds.causal
    return replace(cell, bound=bound.value, bound_error=bound.error, bound_kind=bound.kind)


def suite_label(ground: Ground, suite: Suite, outcome: Outcome) -> Label:
    """Return which controller met which targets where."""
    return Label(
        table=suite.table,
        setting=ground.setting,
        target=suite.target,
        range_m=suite.range_m,
        command_limit=ground.command_limit,
        controller=outcome.name,
        policy_seed=outcome.policy_seed,
        motion=suite.motion,
        counts=suite.counts,
    )


def accelerations(ground: Ground, outcomes: Iterable[Outcome]) -> list[Acceleration]:
    """Say how hard each entrant drove the yaw axis at most."""
    return [
        Acceleration(ground.setting, ground.command_limit, each.name, each.policy_seed, each.yaw_acceleration)
        for each in outcomes
        if each.yaw_acceleration is not None
    ]


def hardest(found: Iterable[Acceleration]) -> tuple[Acceleration, ...]:
    """Keep of each entrant the largest acceleration, where several evaluations tell one each."""
    largest: dict[tuple[str, str, str, int | None], Acceleration] = {}
    for each in found:
        key = (each.setting, each.command_limit, each.controller, each.policy_seed)
        if key not in largest or each.yaw_rad_s2 > largest[key].yaw_rad_s2:
            largest[key] = each
    return tuple(largest.values())


def comparisons(ground: Ground, outcomes: list[Outcome], against: str) -> list[Comparison]:
    """Compare every trained entrant with another one, paired by engagement and dispersion draw.

    Where fired shots count and either fired none, there is nothing to compare.

    Args:
      ground: where it took place.
      outcomes: of all entrants.
      against: name of the other.
    """
    others = [outcome for outcome in outcomes if outcome.name == against]
    found = [
        (suite_label(ground, suite, outcome), suite_difference(suite, outcome, other, index))
        for other in others
        for outcome in outcomes
        if outcome.policy_seed is not None
        for index, suite in enumerate(ground.trials.suites)
    ]
    return [
        Comparison(**vars(label), against=against, **difference._asdict())
        for label, difference in found
        if math.isfinite(difference.difference)
    ]


def suite_difference(
    suite: Suite, outcome: Outcome, other: Outcome, index: int, decisions: slice = slice(None)
) -> Difference:
    """Compare two outcomes in one suite, by what it counts.

    Args:
      suite: which.
      outcome: of the one.
      other: of the other, in the same engagements.
      index: of the suite in both.
      decisions: those of each engagement that are looked at; all if not given.
    """
    (hit, fired), (theirs, fired_theirs) = (
        (each.hit[index][:, decisions], each.fired[index][:, decisions]) for each in (outcome, other)
    )
    return paired_difference(hit, theirs, suite.counted(fired), suite.counted(fired_theirs))

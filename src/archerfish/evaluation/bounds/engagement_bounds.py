"""All bounds of the engagements of a suite: the work behind benchmarks/bounds.py, some 0.2 s per engagement."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.evaluation.bounds.aim_problem import AimProblem, Array, aim_problem, suite_parts
from archerfish.evaluation.bounds.combined import combined_bound
from archerfish.evaluation.bounds.hindsight import hindsight_bound
from archerfish.evaluation.bounds.information import Prior, aim_chances, make_prior
from archerfish.evaluation.bounds.reach import Interval, best_chance, reach, reach_chances
from archerfish.evaluation.bounds.sights import Sights, sights
from archerfish.evaluation.suites import Suite, Trials
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.environment import PureWorld
from archerfish.targets.parabola import Parabola


class EngagementBounds(NamedTuple):
    """Bounds on the hit rate of n engagements, of which m were chosen for the costly ones; 0 to 1."""

    reach: Array
    """Every shot by itself, shape (n,)."""
    chosen: NDArray[np.int64]
    """Indices of those with the costly bounds, shape (m,)."""
    hindsight: Array
    """One trajectory for all shots, with the path known, shape (m,)."""
    information: Array
    """Every shot by what is seen before it, shape (m,); NaN where that is no bound of its own."""
    achieved: Array
    """What the aims behind `information` hit, a check of its filter, shape (m,)."""
    combined: Array
    """One trajectory for all shots, by what is seen before each, shape (m,); NaN likewise."""
    unsolved: int
    """Programmes without a dual bound, where the sum of the largest chances stands in."""


def engagement_bounds(
    world: PureWorld,
    trials: Trials,
    index: int,
    radius: float,
    shots: int,
    stride: int = 1,
    advance: Callable[[int], None] = lambda _: None,
) -> EngagementBounds:
    """Bound the engagements of one suite.

    Args:
      world: the simulator.
      trials: engagements of several suites.
      index: of the suite.
      radius: largest miss that hits [m].
      shots: the first ones, which share a trajectory.
      stride: every how many-th engagement gets the costly bounds.
      advance: receives how many of these are done.
    """
    engagements, draws = suite_parts(trials, index)
    problem = aim_problem(world, engagements, draws, radius)
    interval = reach(problem)
    best = np.sum(reach_chances(problem, interval), axis=-1)
    known = _known(world, trials.suites[index], engagements, draws)
    chosen, rows = range(0, len(best), stride), []
    for engagement in chosen:
        one = problem.pick(slice(engagement, engagement + 1))
        within = interval if len(interval.low) == 1 else Interval(*(each[engagement, None] for each in interval))
        hindsight, solved = hindsight_bound(one, within, shots)
        # Both are of one known path, so the smaller one bounds this very engagement.
        row = min(hindsight, best[engagement]), float(not solved)
        rows.append((*row, *_informed(one, within, shots, known, engagement)))
        advance(len(rows))
    hindsight, unsolved, information, achieved, combined, lost = np.array(rows).T
    count = draws.shape[1]
    return EngagementBounds(
        reach=best / count,
        chosen=np.array(chosen),
        hindsight=hindsight / count,
        information=information / count,
        achieved=achieved / count,
        combined=combined / count,
        unsolved=int(np.sum(unsolved) + np.sum(lost)),
    )


def _known(
    world: PureWorld, suite: Suite, engagements: Engagement, draws: NDArray[np.float32]
) -> tuple[Sights, Prior] | None:
    """Return what is seen and what is known beforehand; None where the filter of eq (7) says nothing more."""
    seen = sights(world, engagements, draws)
    # At another height than the pivot's, the elevation would show the distance too.
    if seen is None or not isinstance(engagements.motion, Parabola) or float(suite.scenario.height) != 0.0:
        return None
    prior = make_prior(suite.scenario)
    # One exact sight of a target that stands still shows all there is to know.
    return None if len(prior.speed) == 1 and seen.fresh.shape[1] == 1 else (seen, prior)


def _informed(
    problem: AimProblem, interval: Interval, shots: int, known: tuple[Sights, Prior] | None, engagement: int
) -> tuple[float, float, float, float]:
    """Information bound, hits of its aims, combined bound, and whether that is without a dual bound."""
    if known is None:
        return np.nan, np.nan, np.nan, 0.0
    seen, prior = known
    chances = aim_chances(problem, seen.pick(engagement), prior)
    aim = np.take_along_axis(chances.offset, np.argmax(chances.chance, axis=-1)[:, None], axis=-1)[:, 0]
    achieved = best_chance(problem, np.stack([0.0 * aim, aim])[None])
    combined, solved = combined_bound(problem, interval, chances, shots, prior.x[1] - prior.x[0] + prior.rise)
    information = float(np.sum(np.max(chances.chance, axis=-1)))
    # Both are of what is seen in this engagement.
    return information, float(np.sum(achieved)), min(combined, information), float(not solved)

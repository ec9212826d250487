"""The bounds that stand beside hit rates: the cheap reach bound, or the tighter ones where these are published."""

from typing import NamedTuple

import numpy as np

from archerfish.evaluation.bounds.aim_problem import Array, aim_problem, suite_parts
from archerfish.evaluation.bounds.published import PublishedBounds, applies, read_published
from archerfish.evaluation.bounds.reach import reach, reach_chances
from archerfish.evaluation.suites import Trials
from archerfish.sensing.interfaces import World
from archerfish.simulation.identified import IdentifiedWorld
from archerfish.simulation.shooting import ShootingWorld


class Bound(NamedTuple):
    """What no hit rate of a cell can exceed, but by chance."""

    value: float
    """The bound, 0 to 1."""
    error: float
    """Its standard error, for the engagements of this very cell."""
    kind: str
    """"reach", "hindsight" or "combined"."""


class CellBounds(NamedTuple):
    """Bounds of one cell."""

    hindsight: Bound
    """For a controller that is given the target's path, as the oracle is."""
    causal: Bound
    """For a controller that knows what it has seen."""


def cell_bounds(
    world: World, trials: Trials, radius: float, setting: str, command_limit: str, seed: int
) -> list[CellBounds] | None:
    """Bound the hit rates of every suite.

    Args:
      world: where the shots are fired.
      trials: the engagements.
      radius: largest miss that hits [m].
      setting: its name in the results.
      command_limit: "box", "gate" or "los-2deg".
      seed: of the engagements.

    Returns:
      One entry per suite; None for a world whose axes are not linear, such as a virtual robot.
    """
    if not isinstance(world, IdentifiedWorld | ShootingWorld):
        return None
    rates = reach_rates(world, trials, radius)
    for each in read_published():
        if (each.setting, each.command_limit, each.seed) == (setting, command_limit, seed) and applies(
            each, world, trials, rates
        ):
            return _published(each)
    alike = [Bound(float(rate), 0.0, "reach") for rate in rates]
    return [CellBounds(each, each) for each in alike]


def reach_rates(world: IdentifiedWorld | ShootingWorld, trials: Trials, radius: float) -> Array:
    """Return the reach bound of every suite, shape (S,)."""
    if isinstance(world, ShootingWorld):
        # Where all start alike, the programmes are solved once.
        problem = aim_problem(world, trials.engagements, trials.draws, radius)
        chances = reach_chances(problem, reach(problem))
        return np.asarray(chances.reshape(len(trials.suites), -1).mean(axis=-1))
    rates = []
    for index in range(len(trials.suites)):
        problem = aim_problem(world, *suite_parts(trials, index), radius)
        rates.append(np.mean(reach_chances(problem, reach(problem))))
    return np.array(rates)


def _published(found: PublishedBounds) -> list[CellBounds]:
    bounds = []
    for cell in found.cells:
        hindsight = causal = Bound(cell.hindsight, cell.hindsight_error, "hindsight")
        # Both hold of the mean of a cell, so the smaller one does.
        if cell.combined is not None and cell.combined_error is not None and cell.combined < cell.hindsight:
            causal = Bound(cell.combined, cell.combined_error, "combined")
        bounds.append(CellBounds(hindsight, causal))
    return bounds

"""Tuning of the classical controllers on draws that no evaluation uses: each the best of a grid.

What a tracker should believe of its target, how far a controller that doesn't know the gimbal should lead for its lag,
and how smooth the commands of one that does should be, depends on camera, link and gimbal. The paper's conditions hold
values for the paper's gimbal; an identified robot gets its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

from archerfish.controllers.roster import Tuning
from archerfish.evaluation.suites import Trials
from archerfish.evaluation.trial import fight
from archerfish.sensing.interfaces import Controller, World

ACCELERATIONS = (0.3, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Process noises of the tracker that are tried [m/s²]."""
LEADS = (0.0, 0.02, 0.04, 0.06, 0.08)
"""Extra leads that are tried with each [s], for a controller that doesn't know the gimbal; longer ones too
while the longest is the best, as over a slow link."""
SMOOTHINGS = (1e-4, 1e-2, 1e-1, 1.0, 10.0)
"""Weights of the command's changes that are tried with each, for one that does."""
GRIDS: dict[str, tuple[Tuning, ...]] = {
    "kalman": tuple(Tuning(q, extra_lead_s=lead) for q, lead in product(ACCELERATIONS, LEADS)),
    "kalman-lq": tuple(Tuning(q, smoothing=weight) for q, weight in product(ACCELERATIONS, SMOOTHINGS)),
    "parabola-lq": tuple(Tuning(0.0, smoothing=weight) for weight in SMOOTHINGS),
}
"""Controller → settings that are tried; the parabola's filter has no process noise."""


@dataclass(frozen=True)
class Tuned:
    """Settings of one controller, and how they were found."""

    controller: str
    """Its name."""
    tuning: Tuning
    """The best settings."""
    tried: int
    """Settings tried."""
    hit_rate: float
    """Hits per shot with the best ones, over all cells of the tuning draws, 0…1."""


def tune(
    world: World,
    trials: Trials,
    name: str,
    build: Callable[[Tuning], Controller],
    hit_radius: float,
    grid: Sequence[Tuning] | None = None,
) -> Tuned:
    """Choose the settings that hit most, with longer leads than the grid's while these hit more.

    Args:
      world: to shoot in.
      trials: of the stream "tuning".
      name: of the controller.
      build: makes the controller.
      hit_radius: largest miss that hits [m].
      grid: settings to try; those of `GRIDS` if not given.
    """
    grid = GRIDS[name] if grid is None else grid

    def rate(tuning: Tuning) -> float:
        return float(fight(world, build(tuning), trials).hits(hit_radius).mean())

    rates = {tuning: rate(tuning) for tuning in grid}
    best = max(rates, key=lambda tuning: rates[tuning])
    while 0.0 < best.extra_lead_s == max(each.extra_lead_s for each in rates):
        longer = best._replace(extra_lead_s=best.extra_lead_s + LEADS[1])
        rates[longer] = rate(longer)
        best = max(best, longer, key=lambda tuning: rates[tuning])
    return Tuned(name, best, len(rates), rates[best])

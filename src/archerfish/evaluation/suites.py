"""Who is shot at: the cells of the paper's tables, and of targets that move in other ways, as suites of engagements."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.evaluation.results import MOTION_TABLES, check_counts
from archerfish.paper.conditions import Conditions
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.scenario import UNIFORMS, Scenario, draw_engagement
from archerfish.simulation.setting import make_scenario
from archerfish.simulation.shooting import DRAWS
from archerfish.targets.drawn import WAYS, drawn_motion
from archerfish.targets.own_motion import OwnMotion

PURPOSES = {"evaluation": 0, "tuning": 1, "calibration": 2, "stopping": 3}
"""Streams of random numbers that never meet: what is tuned or calibrated is judged on draws it has not seen."""


@dataclass(frozen=True)
class Suite:
    """One cell: engagements of one kind at one range."""

    table: str
    """Of the paper: "II" or "IV" for static targets, "III" or "V" for dynamic ones; else one of `MOTION_TABLES`."""
    target: str
    """"static" or "dynamic"."""
    range_m: tuple[float, float]
    """Smallest and largest distance [m]."""
    scenario: Scenario
    """How its engagements are drawn."""
    motion: str | None = None
    """Name of the motion, where it is not eq (7) as the paper has it."""
    counts: str = "decisions"
    """What the hit rate is counted over, one of `COUNTS`: a withheld shot is a miss, or is no shot."""
    stream: int | None = None
    """Of random numbers: the same engagements whichever suites are beside it; its place among them if not given."""

    def __post_init__(self) -> None:
        check_counts(self.counts)

    def counted(self, fired: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """Return which decisions count, as `hit_rate` takes it: None for all.

        Args:
          fired: which of them fired, shape (engagements, decisions).
        """
        return fired if self.counts == "shots" else None


@dataclass(frozen=True)
class Trials:
    """Engagements of several suites, side by side, with all their dispersion draws."""

    suites: tuple[Suite, ...]
    """S suites."""
    engagements: Engagement
    """Shape (S n): the engagements of the first suite, then those of the second, and so on."""
    draws: NDArray[np.float32]
    """Standard normals, shape (S n, T, normals)."""


def table_suites(
    conditions: Conditions,
    plants: int = 1,
    tables: tuple[str, str] = ("II", "III"),
    motion: OwnMotion | None = None,
) -> tuple[Suite, ...]:
    """Return the eight cells of Tables II and III, or IV and V.

    Args:
      conditions: ranges, speeds and offsets.
      plants: number of posterior draws of the world's plant.
      tables: that of still and that of moving targets.
      motion: of the moving targets, in the place of eq (7).
    """
    drawer, name = (motion.drawer, motion.name) if motion else ((), None)
    return tuple(
        Suite(
            table,
            target,
            range_m,
            make_scenario(conditions, range_m, share, plants, drawer),
            name if target == "dynamic" else None,
        )
        for table, target, share in ((tables[0], "static", 1.0), (tables[1], "dynamic", 0.0))
        for range_m in conditions.range_bins
    )


def motion_suites(
    conditions: Conditions, seconds: float, plants: int = 1, names: Sequence[str] = tuple(WAYS)
) -> tuple[Suite, ...]:
    """Return the cells of motions of `archerfish.targets`, each at the tables' ranges.

    Args:
      conditions: ranges and offsets.
      seconds: length of the engagements [s], one of `MOTION_TABLES`.
      plants: number of posterior draws of the world's plant.
      names: of the motions; all if not given.
    """
    lasting = replace(conditions, engagement_s=seconds)
    bins = conditions.range_bins
    return tuple(
        Suite(
            MOTION_TABLES[seconds],
            "static" if name == "still" else "dynamic",
            range_m,
            make_scenario(lasting, range_m, plants=plants, motion=drawn_motion(name)),
            name,
            stream=len(bins) * list(WAYS).index(name) + index,
        )
        for name in names
        for index, range_m in enumerate(bins)
    )


def draw_trials(
    suites: tuple[Suite, ...],
    engagements: int,
    decisions: int,
    seed: int,
    purpose: str = "evaluation",
    normals: int = DRAWS,
) -> Trials:
    """Draw engagements and dispersion once, for all controllers.

    Args:
      suites: the cells.
      engagements: number per suite.
      decisions: number per engagement.
      seed: of the draws.
      purpose: one of `PURPOSES`.
      normals: standard normals that the world takes per decision.
    """
    drawn, noise = [], []
    for place, suite in enumerate(suites):
        index = place if suite.stream is None else suite.stream
        generator = np.random.default_rng([seed, PURPOSES[purpose], index])
        uniforms = generator.random((engagements, UNIFORMS), dtype=np.float32)
        # Of a stream of their own: with them or without, the pellets scatter alike.
        more = np.random.default_rng([seed, PURPOSES[purpose], index, 1])
        chances = more.random((engagements, suite.scenario.uniforms - UNIFORMS), dtype=np.float32)
        drawn.append(draw_engagement(suite.scenario, np.concatenate([uniforms, chances], axis=-1)))
        noise.append(generator.standard_normal((engagements, decisions, normals), dtype=np.float32))
    joined: Any = map_arrays(lambda *parts: np.concatenate(parts), *drawn)
    return Trials(suites, joined, np.concatenate(noise))

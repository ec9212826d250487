"""Bounds that took long to compute, published with the library for the engagements of `archerfish reproduce`.

benchmarks/bounds.py --publish writes them. They apply to exactly those engagements: same setting, command limit, seed
and number, and a world that is the same to four digits: evidence is the reach bound of every cell, which depends on
plants, latencies, muzzle, limits and conditions, and what the camera does.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from archerfish.evaluation.bounds.aim_problem import Array
from archerfish.evaluation.suites import Trials
from archerfish.evaluation.typed_json import from_json
from archerfish.records import storage
from archerfish.simulation.environment import PureWorld

PUBLISHED = Path(__file__).with_name("published.json")
SCHEMA = "archerfish.bounds/1"
_TOLERANCE = 2e-5
"""Reach bounds of the same engagements agree to this, a five-hundredth of a point."""


@dataclass(frozen=True)
class PublishedCell:
    """Bounds on the hit rate in one cell, 0 to 1."""

    target: str
    """"static" or "dynamic"."""
    range_m: tuple[float, float]
    """Smallest and largest distance [m]."""
    reach: float
    """Every shot by itself."""
    hindsight: float
    """One trajectory, with the path known."""
    hindsight_error: float
    """Its standard error, from the engagements that were left out."""
    combined: float | None
    """One trajectory, by what is seen before each shot; None where that is not known."""
    combined_error: float | None
    """Its standard error, from the luck of the sights, and the engagements that were left out."""


@dataclass(frozen=True)
class PublishedBounds:
    """Bounds on the cells of one setting under one command limit."""

    setting: str
    """As in results.json."""
    command_limit: str
    """"box", "gate" or "los-2deg"."""
    seed: int
    """Of the engagements."""
    engagements: int
    """Per cell."""
    camera: dict[str, float] = field(default_factory=dict)
    """What the camera does, see `camera_means`; empty where sight is perfect."""
    cells: tuple[PublishedCell, ...] = ()
    """In the order of the suites."""


def applies(published: PublishedBounds, world: PureWorld, trials: Trials, reach: Array) -> bool:
    """Return whether published bounds are of these very engagements in this very world.

    Args:
      published: of the same setting, command limit and seed.
      world: where the shots are fired.
      trials: the engagements.
      reach: their reach bound in every suite, shape (S,).
    """
    suites = [(suite.target, suite.range_m, suite.motion) for suite in trials.suites]
    camera = camera_means(world)
    here, there = ([each.get(name, np.inf) for name in camera] for each in (camera, published.camera))
    return (
        suites == [(cell.target, cell.range_m, None) for cell in published.cells]
        and len(trials.draws) == len(suites) * published.engagements
        and np.allclose(reach, [cell.reach for cell in published.cells], rtol=0.0, atol=_TOLERANCE)
        and camera.keys() == published.camera.keys()
        and np.allclose(here, there, rtol=1e-3, atol=1e-5)
    )


def camera_means(world: PureWorld) -> dict[str, float]:
    """Return what camera and link do, mean over the draws; empty where they are immediate and perfect."""
    sensing = getattr(world, "sensing", None)
    return {} if sensing is None else {name: float(np.mean(each)) for name, each in sensing._asdict().items()}


def read_published(path: Path = PUBLISHED) -> tuple[PublishedBounds, ...]:
    """Read the published bounds.

    Raises:
      InputError: if the file is damaged.
    """
    facts: dict[str, Any] = storage.read_facts(path, SCHEMA)
    return tuple(from_json(PublishedBounds, each) for each in facts["bounds"])


def write_published(found: Sequence[PublishedBounds], path: Path = PUBLISHED) -> None:
    """Publish bounds, in the place of those for the same engagements."""

    def key(each: PublishedBounds) -> tuple[Any, ...]:
        return each.setting, each.command_limit, each.seed, each.engagements

    kept = {key(each): each for each in (*(read_published(path) if path.exists() else ()), *found)}
    storage.write_json(path, {"schema": SCHEMA, "bounds": [asdict(kept[each]) for each in sorted(kept)]})

"""The engagements of an evaluation's cells, drawn once for all controllers."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.arrays import map_arrays
from archerfish.errors import InputError, one_line
from archerfish.protocols import Engagement
from archerfish.task import TaskCell

PURPOSES = {"evaluation": 0, "tuning": 1, "calibration": 2, "stopping": 3}
"""Streams of random numbers that never meet: what is tuned or calibrated is judged on other draws."""
MOST_NUMBERS = 1_000_000_000
"""Of float32 that are held at once: 4 GB."""
MOST_COUNTS = 10_000_000
"""Of engagements in results: their file is read up to 64 MB, and a count takes up to six characters."""
_PATH = 24  # numbers of a target's path, and of its copy while cells are joined, for each uniform one, at most
_FIRST = 6  # uniform draws whose stream the normals continue


def check_counts(
    engagements: Any, seed: Any, least: int, cells: Sequence[TaskCell], numbers: int, counts: int = 1
) -> None:
    """Refuse what is no number of engagements, more of them than fit into memory or a file, and what is no seed.

    Args:
      engagements: as given.
      seed: as given.
      least: engagements of a cell.
      cells: that are drawn together.
      numbers: that are held for each decision.
      counts: that results have for each engagement.

    Raises:
      InputError: saying what is expected.
    """
    in_memory = MOST_NUMBERS // sum(cell.decisions * numbers + _PATH * cell.scenario.uniforms for cell in cells)
    most = min(in_memory, MOST_COUNTS // counts)
    room = "results.json has" if most < in_memory else "4 GB have"
    for name, value, low, high, expected in (
        ("engagements", engagements, least, most, f"{least}…{most}, which {room} room for"),
        ("seed", seed, 0, math.inf, "at least 0"),
    ):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
            given = one_line(repr(value))[:100]
            raise InputError(f"{name} must be a whole number, {expected}, got {given}; choose another")


def draw(
    cells: Sequence[TaskCell], engagements: int, seed: int, purpose: str, normals: int = 6, plants: int = 1
) -> tuple[Engagement, NDArray[np.float32]]:
    """Draw engagements of cells of one length, and the standard normals of all their decisions.

    Args:
      cells: S of them.
      engagements: n, per cell.
      seed: of the draws.
      purpose: one of `PURPOSES`.
      normals: standard normals that the world takes per decision.
      plants: number of posterior draws of the world's plant.

    Returns:
      Engagements of shape (S·n,), those of the first cell first, and normals of shape (S·n, T, normals).

    Raises:
      InputError: if a user's motion fails, or its targets are not before the gimbal.
    """
    drawn, noise = [], np.empty((len(cells), engagements, cells[0].decisions, normals), np.float32)
    for place, cell in enumerate(cells):
        stream = [seed, PURPOSES[purpose], cell.stream]
        generator = np.random.default_rng(stream)
        uniforms = generator.random((engagements, _FIRST), dtype=np.float32)
        # Of a stream of their own: with them or without, the pellets scatter alike.
        more = np.random.default_rng([*stream, 1]).random((engagements, cell.scenario.uniforms - _FIRST), np.float32)
        scenario = dataclasses.replace(cell.scenario, plants=np.float32(plants))
        drawn.append(scenario.draw(np.concatenate([uniforms, more], axis=-1)))
        generator.standard_normal(dtype=np.float32, out=noise[place])  # in its place: two copies may be too many
    joined: Engagement = map_arrays(lambda *parts: np.concatenate(parts), *drawn)
    return joined, noise.reshape(-1, *noise.shape[2:])

"""The engagements of an evaluation's cells, drawn once for all controllers."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from archerfish2.arrays import map_arrays
from archerfish2.protocols import Engagement
from archerfish2.task import Suite

PURPOSES = {"evaluation": 0, "tuning": 1, "calibration": 2, "stopping": 3}
"""Streams of random numbers that never meet: what is tuned or calibrated is judged on other draws."""
_FIRST = 6  # uniform draws whose stream the normals continue


def draw(
    cells: Sequence[Suite], engagements: int, seed: int, purpose: str = "evaluation", normals: int = 6, plants: int = 1
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
    drawn, noise = [], []
    for cell in cells:
        stream = [seed, PURPOSES[purpose], cell.stream]
        generator = np.random.default_rng(stream)
        uniforms = generator.random((engagements, _FIRST), dtype=np.float32)
        # Of a stream of their own: with them or without, the pellets scatter alike.
        more = np.random.default_rng([*stream, 1]).random((engagements, cell.scenario.uniforms - _FIRST), np.float32)
        scenario = dataclasses.replace(cell.scenario, plants=np.float32(plants))
        drawn.append(scenario.draw(np.concatenate([uniforms, more], axis=-1)))
        noise.append(generator.standard_normal((engagements, cell.decisions, normals), dtype=np.float32))
    joined: Engagement = map_arrays(lambda *parts: np.concatenate(parts), *drawn)
    return joined, np.concatenate(noise)

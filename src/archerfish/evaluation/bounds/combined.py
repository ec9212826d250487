"""The combined bound: the best single trajectory for chances that know no more than what was seen by then."""

import numpy as np
from scipy.ndimage import maximum_filter1d

from archerfish.evaluation.bounds.aim_problem import AimProblem, Array
from archerfish.evaluation.bounds.hindsight import pitch_profile
from archerfish.evaluation.bounds.hit_chance import SLACK
from archerfish.evaluation.bounds.information import AimChances
from archerfish.evaluation.bounds.reach import Interval
from archerfish.evaluation.bounds.trajectory import profile, trajectory_bound

CERTAIN = 6.0
"""Standard deviations of the armor's distance within which a pitch may be right for it."""


def combined_bound(
    problem: AimProblem, interval: Interval, chances: AimChances, shots: int, max_distance: float
) -> tuple[float, bool]:
    """Bound the expected hits of one engagement.

    The trajectory may know later sights beforehand, and the true axes, muzzle, latencies and height: each of these
    only raises the bound.

    Args:
      problem: of one engagement.
      interval: aims that can be reached, of one engagement.
      chances: what its sights leave open.
      shots: n, the first shots that share a trajectory; later ones get the largest chance that is left open.
      max_distance: by how much the armor's distance can differ at most [m].

    Returns:
      The bound, and whether the solver found one for the first shots.
    """
    geometry, wanted = problem.geometry, problem.wanted[0, 1, :shots, None]
    near = np.array([_nearby(*each) for each in zip(chances.offset[:shots], chances.chance[:shots], strict=True)])
    reached = (chances.offset[:shots] + SLACK >= interval.low[0, 1, :shots, None] - wanted) & (
        chances.offset[:shots] - SLACK <= interval.high[0, 1, :shots, None] - wanted
    )
    # With the distance of the armor unknown, a pitch is right for some distance within this of the true one.
    distance = np.minimum(CERTAIN * chances.level_sd[:shots], max_distance)
    level = geometry.x[0, :shots] / np.cos(geometry.bearing[0, :shots])
    pitch = pitch_profile(problem, shots, distance * geometry.drop[0, :shots] / level**2)
    most = np.max(np.where(reached, near, 0.0), axis=-1)
    found, solved = trajectory_bound(problem, interval, (pitch, profile(chances.offset[:shots], near)), most)
    return found + float(np.max(chances.chance[shots:], axis=-1).sum()), solved


def _nearby(offset: Array, chance: Array) -> Array:
    """Give every aim the best chance within `SLACK` of it."""
    return np.asarray(maximum_filter1d(chance, 2 * int(np.ceil(SLACK / (offset[1] - offset[0]))) + 1, mode="nearest"))

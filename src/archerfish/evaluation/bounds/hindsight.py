"""The hindsight bound: the best single trajectory for an engagement whose target's path is known from the beginning."""

import numpy as np

from archerfish.evaluation.bounds.aim_problem import AimProblem, Array
from archerfish.evaluation.bounds.hit_chance import SLACK, hit_chance
from archerfish.evaluation.bounds.reach import Interval, reach_chances
from archerfish.evaluation.bounds.trajectory import Profile, profile, trajectory_bound

SAMPLES = 241
"""Of each chance along an axis: what lies between two of them is less than what `SLACK` adds."""


def hindsight_bound(problem: AimProblem, interval: Interval, shots: int) -> tuple[float, bool]:
    """Bound the expected hits of one engagement.

    Args:
      problem: of one engagement.
      interval: aims that can be reached, of one engagement.
      shots: n, the first shots that share a trajectory; later ones get what each can reach by itself.

    Returns:
      The bound, and whether the solver found one for the first shots.
    """
    best = reach_chances(problem, interval)[0]
    profiles = pitch_profile(problem, shots, np.zeros(shots)), yaw_profile(problem, shots)
    found, solved = trajectory_bound(problem, interval, profiles, best[:shots])
    return found + float(best[shots:].sum()), solved


def pitch_profile(problem: AimProblem, shots: int, unknown: Array) -> Profile:
    """Return what bounds the chance along the pitch with the best yaw.

    Args:
      problem: of one engagement.
      shots: n, the first of its shots.
      unknown: by how much the pitch that meets the armor may differ [rad], shape (n,).
    """
    scale, sd = problem.geometry.height_per_pitch[0, :shots, None], problem.geometry.sd[0, :shots, None, :]
    near = SLACK + unknown[:, None]
    offset = _grid((problem.radius + 5.0 * sd[..., 0]) / scale + near)
    missed = scale * np.maximum(np.abs(offset) - near, 0.0)
    return profile(offset, hit_chance(np.stack([missed, 0.0 * missed], axis=-1), sd, problem.radius))


def yaw_profile(problem: AimProblem, shots: int) -> Profile:
    """Return what bounds the chance along the yaw with the best pitch, for the first n shots of one engagement."""
    geometry = problem.geometry
    x, bearing, sd = geometry.x[0, :shots, None], geometry.bearing[0, :shots, None], geometry.sd[0, :shots, None, :]
    # The inner side is where an angle moves the aim least.
    farthest = np.abs(bearing) - np.arctan(np.tan(np.abs(bearing)) - (problem.radius + 5.0 * sd[..., 1]) / x)
    offset = _grid(farthest + SLACK)
    near = np.sign(offset) * np.maximum(np.abs(offset) - SLACK, 0.0)
    missed = x * (np.tan(bearing + near) - np.tan(bearing))
    return profile(offset, hit_chance(np.stack([0.0 * missed, missed], axis=-1), sd, problem.radius))


def _grid(farthest: Array) -> Array:
    return np.asarray(farthest * np.linspace(-1.0, 1.0, SAMPLES))

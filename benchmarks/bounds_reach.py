"""The reach bound: every shot by itself, with the commands that serve it best.

For each shot and axis the limits leave an interval of aims; the best chance within it bounds that shot, and their sum
the engagement. It allows each shot a trajectory of its own, which makes it cheap and somewhat loose.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array

from bounds_problem import SLACK, AimProblem, Array, hit_chance


class Interval(NamedTuple):
    """Aims that can be reached, each axis by itself, as changes against the start; index 0 is pitch, 1 is yaw."""

    low: Array  # smallest [rad], shape (E, 2, T)
    high: Array  # largest [rad], shape (E, 2, T)


def reach(problem: AimProblem) -> Interval:
    """Return the interval of aims of every shot.

    Exact, by linear programmes, where one response and one range of commands serve all engagements. Elsewhere the
    limits on angle, rate and acceleration are each taken by themselves, in closed form, and the intervals intersected.
    """
    found = _each_limit(problem)
    if len(problem.response) == 1 and np.all(np.isfinite(problem.bend)) and _alike(problem):
        return _programmes(problem, found)
    return found


def reach_chances(problem: AimProblem, interval: Interval) -> Array:
    """Return the best chance of every shot within what can be reached, shape (E, T)."""
    wanted = problem.wanted
    nearest = np.clip(wanted, interval.low, interval.high)
    return best_chance(problem, shrink(nearest - wanted))


def best_chance(problem: AimProblem, off: Array) -> Array:
    """Return the chance of aims that are off by so much [rad], shape (E, 2, T) → (E, T)."""
    geometry = problem.geometry
    offset = np.stack([geometry.height_per_pitch * off[:, 0], geometry.lateral(off[:, 1])], axis=-1)
    return hit_chance(offset, geometry.sd, problem.radius)


def shrink(off: Array) -> Array:
    """Bring aims that are off by so much [rad] nearer to the armor by `SLACK`, shape B."""
    return np.sign(off) * np.maximum(np.abs(off) - SLACK, 0.0)


def _alike(problem: AimProblem) -> bool:
    return bool(np.all(problem.low == problem.low[:1, :, :1]) and np.all(problem.high == problem.high[:1, :, :1]))


def _each_limit(problem: AimProblem) -> Interval:
    response = problem.response
    least = np.sum(np.minimum(response * problem.low[:, :, None], response * problem.high[:, :, None]), axis=-1)
    most = np.sum(np.maximum(response * problem.low[:, :, None], response * problem.high[:, :, None]), axis=-1)
    # Σ_s M_ts u_s over the steps of the command, and over the changes of these.
    by_step = _sum_from(response)
    for size, share in ((problem.step, by_step), (problem.bend, _sum_from(by_step))):
        bounded = np.isfinite(size)
        farthest = np.where(bounded, size, 0.0)[:, None] * np.sum(np.abs(share), axis=-1)
        least = np.where(bounded[:, None], np.maximum(least, -farthest), least)
        most = np.where(bounded[:, None], np.minimum(most, farthest), most)
    return Interval(least, most)


def _sum_from(array: Array) -> Array:
    """Sum from each index of the last axis to its end."""
    return np.asarray(np.cumsum(array[..., ::-1], axis=-1)[..., ::-1])


def _programmes(problem: AimProblem, known: Interval) -> Interval:
    """Minimise and maximise the aims over the commands, shape (1, 2, T).

    Once the farthest aim that is still wanted can be reached, a programme would gain nothing: what is known is kept.
    """
    ends = Interval(known.low[:1].copy(), known.high[:1].copy())
    for axis in range(2):
        wanted = problem.wanted[:, axis]
        for sign, end in ((-1.0, ends.low[0, axis]), (1.0, ends.high[0, axis])):
            farthest = np.max(sign * wanted, axis=0)
            for shot in range(len(end)):
                end[shot] = sign * min(_extreme(problem, axis, shot, sign), sign * end[shot])
                if sign * end[shot] >= np.max(farthest[shot:]):
                    break
    return ends


def _extreme(problem: AimProblem, axis: int, shot: int, sign: float) -> float:
    """Return the largest change of an aim in the direction of a sign."""
    # Of all commands: one that can't be kept within the range afterwards is not allowed.
    rows, limit = command_rows(problem, axis, problem.response.shape[-1])
    bounds = (problem.low[0, axis, 0], problem.high[0, axis, 0])
    weights = sign * problem.response[0, axis, shot]
    solved = linprog(-weights, rows, limit, bounds=bounds, method="highs")
    # A programme without a solution bounds nothing.
    return -float(solved.fun) if solved.success else np.inf


def command_rows(problem: AimProblem, axis: int, shots: int) -> tuple[csr_array, Array]:
    """Return the limits on steps and bends of the first commands as rows A u ≤ b, from rest at the start."""
    first = np.eye(shots) - np.eye(shots, k=-1)
    kept = [(size[axis], row) for size, row in ((problem.step, first), (problem.bend, first @ first))]
    kept = [(size, row) for size, row in kept if np.isfinite(size)]
    rows = [sign * row for _, row in kept for sign in (1.0, -1.0)]
    limit = [np.full(shots, size) for size, _ in kept for _ in range(2)]
    return csr_array(np.vstack(rows) if rows else np.zeros((0, shots))), np.concatenate([np.zeros(0), *limit])

"""The best single trajectory for the shots of an engagement: a mixed-integer linear programme.

    max Σ_t (v_t − ε b_t) + n ε   over the commands u, the chances v and the binary b

b_t = 1 puts both aims of shot t inside the windows where its chance exceeds ε; elsewhere the shot counts ε. Within the
windows the chance is bounded by supporting lines of its profile along either axis. So the optimum is at least the
expected hits of any trajectory. What counts is the solver's dual bound, which is not below the optimum, and never the
trajectory that it found.

The hindsight bound is that of an engagement whose target's path is known from the beginning; the combined bound that
for chances which know no more than what was seen by then.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import block_array, csr_array, vstack

from bounds_information import AimChances
from bounds_problem import SLACK, AimProblem, Array, hit_chance
from bounds_reach import Interval, command_rows, reach_chances

SAMPLES = 241
"""Of each chance along an axis: what lies between two of them is less than what `SLACK` adds."""
CERTAIN = 6.0
"""Standard deviations of the armor's distance within which a pitch may be right for it."""
NEGLIGIBLE = 0.004
"""ε: chances below it count as this much."""
SLOPES = (0.06, 0.25, 0.6, 1.0)
"""Of the supporting lines on either side, as shares of the steepest."""
TIME_LIMIT_S = 20.0
"""For one engagement; the dual bound that the solver has by then is a bound too."""
GAP = 5e-4
"""Relative gap between trajectory and dual bound at which the solver may stop."""


class Profile(NamedTuple):
    """What bounds the chance of n shots along one axis; offsets count from the aim that meets the armor's centre."""

    low: Array  # lower end of the window [rad], shape (n,)
    high: Array  # upper end [rad], shape (n,)
    slope: Array  # of the supporting lines [1/rad], shape (n, L)
    level: Array  # their values where the offset is zero, shape (n, L)


def profile(offset: Array, chance: Array) -> Profile:
    """Take windows and supporting lines from sampled chances.

    Args:
      offset: rising, reaching beyond the window at both ends [rad], shape (n, G).
      chance: at these, shape (n, G).
    """
    inside = chance > NEGLIGIBLE
    last = inside.shape[-1] - 1
    # One sample farther: between two samples the chance may exceed ε already.
    first = np.maximum(np.argmax(inside, axis=-1) - 1, 0)
    final = np.minimum(last - np.argmax(inside[:, ::-1], axis=-1) + 1, last)
    index, peak = np.arange(last + 1), np.argmax(chance, axis=-1)
    slopes, within = [], (index >= first[:, None]) & (index <= final[:, None])
    for end, side in ((first, index <= peak[:, None]), (final, index >= peak[:, None])):
        at, value = (np.take_along_axis(each, end[:, None], axis=-1) for each in (offset, chance))
        run, rise = offset - at, chance - value
        chord = np.where(within & side & (run != 0.0), rise / np.where(run == 0.0, 1.0, run), 0.0)
        steepest = np.take_along_axis(chord, np.argmax(np.abs(chord), axis=-1)[:, None], axis=-1)
        slopes.append(steepest * np.array(SLOPES))
    slope = np.concatenate(slopes, axis=-1)
    above = np.where(within[:, None], chance[:, None] - slope[..., None] * offset[:, None], -np.inf)
    low, high = (np.take_along_axis(offset, each[:, None], axis=-1)[:, 0] for each in (first, final))
    return Profile(low, high, slope, np.max(above, axis=-1))


def trajectory_bound(
    problem: AimProblem, interval: Interval, profiles: tuple[Profile, Profile], most: Array
) -> tuple[float, bool]:
    """Bound the expected hits of the first n shots of one engagement.

    Args:
      problem: of one engagement.
      interval: aims that can be reached, of one engagement.
      profiles: of pitch and yaw, n shots each.
      most: largest chance of each shot, shape (n,).

    Returns:
      The bound, and whether the solver found it; else it is the sum of the largest chances.
    """
    count = len(most)
    wanted = problem.wanted[0, :, :count]
    ends = Interval(interval.low[0, :, :count] - wanted, interval.high[0, :, :count] - wanted)
    possible = most > NEGLIGIBLE
    for axis, each in enumerate(profiles):
        possible &= (ends.low[axis] <= each.high) & (ends.high[axis] >= each.low)
    shots = np.flatnonzero(possible)
    rest = NEGLIGIBLE * (count - len(shots))
    if not len(shots):
        return rest, True
    parts = [_axis_rows(problem, axis, shots, ends, each, most) for axis, each in enumerate(profiles)]
    found = _solve(problem, shots, parts, most[shots])
    loose = float(most[shots].sum())
    return (rest + loose, False) if found is None else (rest + min(found, loose), True)


class _Rows(NamedTuple):
    """Rows of one axis, A_u u + A_v v + A_b b ≤ limit."""

    command: csr_array
    chance: csr_array
    binary: csr_array
    limit: Array


def _axis_rows(
    problem: AimProblem, axis: int, shots: NDArray[np.int64], ends: Interval, bounds: Profile, most: Array
) -> _Rows:
    size, n = int(shots[-1]) + 1, len(shots)
    response = problem.response[0, axis][shots][:, :size]
    wanted = problem.wanted[0, axis, shots]
    least, largest = ends.low[axis, shots], ends.high[axis, shots]
    limits, limit = command_rows(problem, axis, size)
    nothing = csr_array((limits.shape[0], n))
    blocks = [_Rows(limits, nothing, nothing, limit)]
    eye = np.eye(n)
    # Where b is zero, the aim need only be one that can be reached.
    for sign, window, end in ((1.0, bounds.high[shots], largest), (-1.0, -bounds.low[shots], -least)):
        free = np.maximum(end - window, 0.0)
        blocks.append(_picked(sign * response, 0.0 * eye, np.diag(free), window + free + sign * wanted, free > 0.0))
    for slope, level in zip(bounds.slope[shots].T, bounds.level[shots].T, strict=True):
        lowest = level + np.minimum(slope * least, slope * largest)
        free = np.maximum(-lowest, 0.0)
        blocks.append(
            _picked(-slope[:, None] * response, eye, np.diag(free), level + free - slope * wanted, lowest < most[shots])
        )
    command, chance, binary = (vstack([each[part] for each in blocks]) for part in range(3))
    return _Rows(command, chance, binary, np.concatenate([each.limit for each in blocks]))


def _picked(command: Array, chance: Array, binary: Array, limit: Array, kept: NDArray[np.bool_]) -> _Rows:
    """Keep the rows that can act."""
    return _Rows(csr_array(command[kept]), csr_array(chance[kept]), csr_array(binary[kept]), limit[kept])


def _solve(problem: AimProblem, shots: NDArray[np.int64], parts: list[_Rows], most: Array) -> float | None:
    """Return the dual bound of the programme, None if the solver gives none."""
    size, n = int(shots[-1]) + 1, len(shots)
    pitch, yaw = parts
    rows = block_array(
        [
            [pitch.command, None, pitch.chance, pitch.binary],
            [None, yaw.command, yaw.chance, yaw.binary],
            # No chance without being inside.
            [None, None, csr_array(np.eye(n)), csr_array(-np.diag(most))],
        ],
        format="csr",
    )
    limit = np.concatenate([pitch.limit, yaw.limit, np.zeros(n)])
    solved = milp(
        np.concatenate([np.zeros(2 * size), -np.ones(n), np.full(n, NEGLIGIBLE)]),
        constraints=LinearConstraint(rows, -np.inf, limit),
        bounds=Bounds(
            np.concatenate([problem.low[0, 0, :size], problem.low[0, 1, :size], np.zeros(2 * n)]),
            np.concatenate([problem.high[0, 0, :size], problem.high[0, 1, :size], most, np.ones(n)]),
        ),
        integrality=np.concatenate([np.zeros(2 * size + n), np.ones(n)]),
        options={"time_limit": TIME_LIMIT_S, "mip_rel_gap": GAP},
    )
    bound = solved.get("mip_dual_bound")
    if bound is None or not np.isfinite(bound):
        return None
    return float(-bound) + n * NEGLIGIBLE


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


def combined_bound(
    problem: AimProblem, interval: Interval, chances: AimChances, shots: int, max_distance: float
) -> tuple[float, bool]:
    """Bound the expected hits of one engagement.

    The trajectory may know later detections beforehand, and the true axes, muzzle, latencies and height: each of these
    only raises the bound.

    Args:
      problem: of one engagement.
      interval: aims that can be reached, of one engagement.
      chances: what its detections leave open.
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

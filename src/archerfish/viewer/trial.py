"""One trial: some engagements of a controller, with what there is to see at any moment."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.aiming import intercept
from archerfish.dynamics.muzzle import Muzzle, direction
from archerfish.dynamics.pellet import flat_fire_drop, flat_fire_position
from archerfish.evaluation.hit_rate import HitRate, hit_rate, paired_difference
from archerfish.evaluation.rollout import draw_in_turn, run_engagements
from archerfish.protocols import Shot
from archerfish.simulation.world import make_world
from archerfish.viewer.choice import Setup, TrialChoice, chosen_controller, chosen_robot, chosen_task
from archerfish.viewer.motions import FloatArray

AFTER_S = 0.3
"""Shown of an engagement after its last shot: pellets land [s]."""


class Trial(NamedTuple):
    """N engagements of T decisions; the pellet of decision i leaves at (i + 1) periods, if it fires one."""

    period_s: float  # between decisions [s]
    hit_radius: float  # largest miss that hits [m]
    muzzle: Muzzle  # best estimate, ()
    motions: tuple[str, ...]  # of the engagements' targets
    angle: FloatArray  # pitch and yaw at the decisions and after the last [rad], (N, T + 1, 2)
    command: FloatArray  # in force then [rad], (N, T + 1, 2)
    place: FloatArray  # plate at multiples of the period [m], (N, M, 3) with M > T
    hit: NDArray[np.bool_]  # (N, T)
    flight_time: FloatArray  # [s], NaN of a pellet that was not fired or crosses no plate, (N, T)
    miss: FloatArray  # left and up of the plate's centre [m], (N, T, 2)
    start: FloatArray  # of the pellets [m], (N, T, 3)
    velocity: FloatArray  # of the pellets there [m/s], (N, T, 3)
    error: FloatArray  # gimbal less the angles of perfect aim [rad], NaN where not yet known, (N, T, 2)

    @property
    def fired_at(self) -> FloatArray:
        """When the pellets leave [s], shape (T,)."""
        return self.period_s * np.arange(1, self.hit.shape[1] + 1)

    @property
    def shown_s(self) -> float:
        """How long one engagement is shown [s]."""
        return float(self.period_s * (self.place.shape[1] - 1))

    @property
    def hits(self) -> NDArray[np.int_]:
        """Hits of each engagement, shape (N,)."""
        return np.asarray(self.hit.sum(axis=1))


class Moment(NamedTuple):
    """What is to be seen at one moment of one engagement."""

    angle: FloatArray  # pitch and yaw of the gimbal [rad], (2,)
    command: FloatArray  # in force [rad], (2,)
    place: FloatArray  # plate [m], (3,)
    pellets: FloatArray  # in flight [m], (k, 3)
    misses: FloatArray  # of those that have crossed the plate's plane, left and up [m], (j, 2)
    hit: NDArray[np.bool_]  # of those, (j,)


def run_trial(setup: Setup, choice: TrialChoice) -> Trial:
    """Let a controller shoot in the engagements of a choice, in NumPy, so that another choice compiles nothing.

    Raises:
      InputError: if the choice can't be simulated.
    """
    task, count = chosen_task(setup, choice), choice.engagements
    world, cells = make_world(chosen_robot(setup, choice), task), task.cells()
    engagement, normals = draw_in_turn(cells, count, choice.seed, world)
    played = run_engagements(world, chosen_controller(setup, choice), engagement, normals, may_compile=False)

    def plate(times: Any) -> FloatArray:
        """Return the plates at times [s] of shape (K, N) or (K, 1), shape (K, N, 3)."""
        times = np.broadcast_to(times, (len(times), count)).astype(np.float32)
        return np.asarray(engagement.target.at(times).position[..., 0, :])

    steps, begun, shot = played.hit.shape[1], engagement.start[:, None], played.shot
    shown_at = task.period_s * np.arange(steps + 1 + round(AFTER_S / task.period_s))[:, None]
    fired_at = np.broadcast_to(shown_at[1 : steps + 1], (steps, count))
    crossed = np.moveaxis(plate(fired_at + np.nan_to_num(shot.flight_time.T)), 0, 1)
    start, velocity = pellets_of(shot, crossed, world.muzzle)
    return Trial(
        period_s=task.period_s,
        hit_radius=task.hit_radius_m,
        muzzle=world.muzzle,
        motions=tuple(cells[number % len(cells)].motion for number in range(count)),
        angle=np.concatenate([begun, shot.angle], axis=1),
        command=np.concatenate([begun, played.in_force], axis=1),
        place=np.moveaxis(plate(shown_at), 0, 1),
        hit=played.hit,
        flight_time=shot.flight_time,
        miss=shot.miss,
        start=start,
        velocity=velocity,
        error=shot.angle - np.moveaxis(np.asarray(intercept(plate, fired_at, world.muzzle).angle), 0, 1),
    )


def pellets_of(shot: Shot, plate: FloatArray, muzzle: Muzzle) -> tuple[FloatArray, FloatArray]:
    """Return where pellets start and how fast: flat fire through the muzzle and the point where they cross the plate.

    Args:
      shot: of shape B.
      plate: its centre when the pellets cross it [m], shape B + (3,).
      muzzle: best estimate; only drag and length count, shape ().

    Returns:
      Start [m] and velocity [m/s], shape B + (3,) each; of a pellet that was not fired they mean nothing.
    """
    start = np.asarray(float(muzzle.length) * direction(shot.angle))
    end = plate + np.concatenate([np.zeros_like(shot.miss[..., :1]), shot.miss], axis=-1)
    time, drag = np.where(shot.flight_time > 0.0, shot.flight_time, 1.0), float(muzzle.drag)
    line = end - start
    for _ in range(3):  # the drop depends a little on the speed
        length = np.linalg.norm(line, axis=-1)
        speed = (np.expm1(drag * length) / drag if drag else length) / time
        line = end - start
        line[..., 2] += flat_fire_drop(time, drag * speed)
    return start, line * (speed / np.linalg.norm(line, axis=-1))[..., None]


def moment(trial: Trial, number: int, time: float) -> Moment:
    """Return what is to be seen of an engagement at a time since it began [s]."""
    flight, at = trial.flight_time[number], time / trial.period_s
    crossed = trial.fired_at + flight <= time
    flying = np.isfinite(flight) & (trial.fired_at <= time) & ~crossed
    since = (time - trial.fired_at)[flying]
    flown = flat_fire_position(trial.velocity[number][flying], np.full(len(since), float(trial.muzzle.drag)), since)
    return Moment(
        angle=_between(trial.angle[number], at),
        command=trial.command[number][min(int(at) + 1, trial.command.shape[1] - 1)],
        place=_between(trial.place[number], at),
        pellets=trial.start[number][flying] + flown,
        misses=trial.miss[number][crossed],
        hit=trial.hit[number][crossed],
    )


def _between(rows: FloatArray, at: float) -> FloatArray:
    """Return a row between two rows, the last one beyond the end, shape (M, n) → (n,)."""
    first = min(max(int(at), 0), len(rows) - 1)
    second, share = min(first + 1, len(rows) - 1), min(max(at - first, 0.0), 1.0)
    return np.asarray((1.0 - share) * rows[first] + share * rows[second])


def rate_text(rate: HitRate) -> str:
    """Return a hit rate with its interval."""
    return f"{100 * rate.rate:.1f} % ({100 * rate.low:.1f}–{100 * rate.high:.1f})"


def trial_text(trial: Trial) -> str:
    """Return hits and hit rate of a whole trial."""
    rate = hit_rate(trial.hits, trial.hit.shape[1])
    return f"{rate.hits} of {rate.decisions} hit, {rate_text(rate)}"


def difference_text(trial: Trial, other: Trial) -> str:
    """Return by how many points a trial's rate is above another's in the same engagements, with its interval."""
    found = paired_difference(trial.hits, other.hits, trial.hit.shape[1])
    points = [f"{100 * value:+.1f}".replace("-", "−") for value in found]
    return f"{points[0]} points ({points[1]} to {points[2]})"

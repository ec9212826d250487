"""One trial: a controller in a world, with everything that there is to see of it."""

import contextlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.array_namespace import map_arrays
from archerfish.dynamics.intercept import intercept
from archerfish.dynamics.muzzle import Muzzle
from archerfish.dynamics.pellet import flat_fire_position
from archerfish.records.extensions import own_code
from archerfish.sensing.interfaces import Engagement
from archerfish.viewer.choice import Choice, Subject, check_choice, chosen_controller, chosen_world
from archerfish.viewer.motions import meet

Floats = NDArray[np.floating[Any]]

AFTERMATH_S = 0.3
"""What is shown of an engagement after its last shot: the pellets land [s]."""


class Trial(NamedTuple):
    """B engagements of N decisions; the pellet of decision i leaves at (i + 1) periods, if it fires one."""

    period_s: float
    """Between decisions [s]."""
    hit_radius: float
    """Largest miss that hits [m]."""
    drag: float
    """Of the pellets [1/m]."""
    spread: Floats
    """Standard deviation of the dispersion angles, pitch and yaw [rad], shape (2,)."""
    angle: Floats
    """Pitch and yaw of the gimbal at the decisions and after the last [rad], shape (B, N + 1, 2)."""
    command: Floats
    """Command in force then [rad], shape (B, N + 1, 2)."""
    place: Floats
    """Armor at the same times and during the aftermath [m], shape (B, M, 3), M > N."""
    fired: NDArray[np.bool_]
    """Whether a pellet left the muzzle, shape (B, N)."""
    fallback: NDArray[np.bool_]
    """Whether the controller fell back on a simpler one, shape (B, N)."""
    position: Floats
    """Pellets as they leave the muzzle [m], shape (B, N, 3)."""
    velocity: Floats
    """Their velocity then [m/s], shape (B, N, 3)."""
    flight_time: Floats
    """Until they cross the armor's x [s], infinite for one that still flies or was not fired, shape (B, N)."""
    miss: Floats
    """Pellet minus armor in y and z there [m], NaN for one that was not fired, shape (B, N, 2)."""
    error: Floats
    """Gimbal minus the angles that would have hit, pitch and yaw [rad], shape (B, N, 2)."""

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Whether each decision fired a pellet that hit, shape (B, N)."""
        return np.asarray(self.fired & (np.linalg.norm(self.miss, axis=-1) <= self.hit_radius))

    @property
    def fired_at(self) -> Floats:
        """When the pellets leave [s], shape (N,)."""
        return self.period_s * np.arange(1, self.miss.shape[1] + 1)

    @property
    def shown_s(self) -> float:
        """How long one engagement is shown, with its aftermath [s]."""
        return float(self.period_s * (self.place.shape[1] - 1))


class Moment(NamedTuple):
    """What is to be seen at one moment of one engagement."""

    angle: Floats
    """Pitch and yaw of the gimbal [rad], shape (2,)."""
    command: Floats
    """Command in force [rad], shape (2,)."""
    place: Floats
    """Armor [m], shape (3,)."""
    pellets: Floats
    """Pellets in flight [m], shape (k, 3)."""
    misses: Floats
    """Where the others passed the armor, in y and z from its middle [m], shape (j, 2)."""
    hit: NDArray[np.bool_]
    """Whether those hit, shape (j,)."""


def run_trial(subject: Subject, choice: Choice) -> Trial:
    """Let a controller meet the targets of a choice.

    Raises:
      InputError: if the choice makes no trial.
    """
    check_choice(subject, choice)
    world, controller, conditions = (
        chosen_world(subject, choice),
        chosen_controller(subject, choice),
        subject.conditions,
    )
    steps = conditions.decisions
    engagements = meet(
        choice.motion,
        choice.distance,
        choice.speed,
        conditions,
        choice.engagements,
        world.plants,
        choice.seed,
        subject.own_motions,
    )
    times = world.period_s * np.arange(steps + 1 + round(AFTERMATH_S / world.period_s))
    own = subject.own_motions.get(choice.motion)
    # First of all: what a motion of a user's own raises beyond the engagement, where no path was looked at, is told.
    with own_code(own.extension) if own else contextlib.nullcontext():
        place, wanted = positions(engagements, times), wanted_angles(engagements, times[1 : steps + 1], world.muzzle)
    generator = np.random.default_rng([choice.seed, 72])
    draws = generator.standard_normal((choice.engagements, steps, world.normals)).astype(np.float32)
    state = world.begin(engagements, draws[:, -1])
    seen = world.see(state)
    truth = world.truth(engagements) if getattr(controller, "needs_truth", False) else None
    memory = controller.reset(seen, truth)
    rows = []
    for step in range(steps):
        memory, command = controller.step(memory, seen)
        state, shot = world.shoot(state, command, draws[:, step])
        seen = world.see(state)
        pellet = world.pellet(state, draws[:, step])
        rows.append((shot.angle, seen.command, *pellet, shot.flight_time, shot.miss, shot.fired, command.fallback))
    angle, command, position, velocity, flight_time, miss, fired, fallback = (
        np.stack(each, 1) for each in zip(*rows, strict=True)
    )
    muzzle = world.muzzle
    return Trial(
        period_s=world.period_s,
        hit_radius=conditions.hit_radius,
        drag=float(muzzle.drag),
        spread=np.asarray(muzzle.sd),
        angle=_from(engagements.start, angle),
        command=_from(engagements.start, command),
        place=place,
        fired=fired,
        fallback=fallback,
        position=position,
        velocity=velocity,
        flight_time=np.where(np.isfinite(flight_time), flight_time, np.inf),
        miss=miss,
        error=angle - wanted,
    )


def _from(start: Floats, later: Floats) -> Floats:
    return np.concatenate([np.asarray(start)[:, None], later], axis=1)


def positions(engagements: Engagement, times: Floats) -> Floats:
    """Return where the armors are [m], shape (B, M, 3), at times [s] of shape (M,)."""
    return _places(engagements.motion, np.broadcast_to(times, (engagements.start.shape[0], times.size)))


def wanted_angles(engagements: Engagement, fired_at: Floats, muzzle: Muzzle) -> Floats:
    """Return the angles at which pellets of the mean would hit [rad], shape (B, N, 2).

    Args:
      engagements: whom to meet.
      fired_at: when the pellets leave [s], shape (N,).
      muzzle: its mean counts.
    """
    fired = np.broadcast_to(fired_at, (engagements.start.shape[0], fired_at.size)).astype(np.float32)
    return np.asarray(intercept(lambda times: _places(engagements.motion, times), fired, muzzle).angle)


def _places(motion: Any, times: Floats) -> Floats:
    """Return where B targets are [m], shape (B, M, 3), at times [s] of shape (B, M).

    A motion of a user's own promises one time for each target, no more. So each target is asked of M times over.
    """
    many: Any = map_arrays(lambda each: np.repeat(each, times.shape[1], axis=0), motion)
    return np.asarray(many.position(times.astype(np.float32).reshape(-1))).reshape(*times.shape, 3)


def moment(trial: Trial, engagement: int, time: float) -> Moment:
    """Return what is to be seen of an engagement at a time since its beginning [s]."""
    fired_at, flight = trial.fired_at, trial.flight_time[engagement]
    landed = fired_at + flight <= time
    flying = trial.fired[engagement] & (fired_at <= time) & ~landed
    velocity = trial.velocity[engagement][flying]
    way = flat_fire_position(velocity, np.full(len(velocity), trial.drag), time - fired_at[flying])
    return Moment(
        angle=_between(trial.angle[engagement], time / trial.period_s),
        command=trial.command[engagement][min(int(time / trial.period_s), trial.command.shape[1] - 1)],
        place=_between(trial.place[engagement], time / trial.period_s),
        pellets=trial.position[engagement][flying] + way,
        misses=trial.miss[engagement][landed],
        hit=trial.hit[engagement][landed],
    )


def _between(rows: Floats, place: float) -> Floats:
    """Return a row between two rows, and the last one beyond the end, shape (M, n) → (n,)."""
    first = int(np.clip(np.floor(place), 0, len(rows) - 1))
    second, share = min(first + 1, len(rows) - 1), float(np.clip(place - first, 0.0, 1.0))
    return np.asarray((1.0 - share) * rows[first] + share * rows[second])

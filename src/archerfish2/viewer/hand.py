"""A run against a target that is dragged by hand: its path isn't known when a pellet is fired.

So a shot is scored when its pellet has crossed the plate's plane.
"""

import itertools
from typing import Any, NamedTuple

import numpy as np

from archerfish2.dynamics.aiming import intercept
from archerfish2.errors import InputError
from archerfish2.protocols import Engagement, Shot
from archerfish2.simulation.world import make_world
from archerfish2.viewer.choice import Choice, Setup, chosen_controller, chosen_robot, chosen_task
from archerfish2.viewer.motions import HAND, Floats, HandPath, follow
from archerfish2.viewer.trial import Trial, pellets_of

LONGEST_S = 30.0
"""A run ends after this, and another begins [s]."""


class _Fired(NamedTuple):
    """A decision whose shot is not yet scored."""

    time: Floats  # of the shot [s], (1,)
    angle: Floats  # of the gimbal [rad], (1, 2)
    rate: Floats  # of the gimbal [rad/s], (1, 2)
    fire: Any  # (1,)
    normals: Floats  # (1, n)


class HandRun:
    """A run that continues by one decision at a time."""

    def __init__(self, setup: Setup, choice: Choice, place: Floats) -> None:
        task = chosen_task(setup, choice)
        self._world, self._controller = make_world(chosen_robot(setup, choice), task), chosen_controller(setup, choice)
        if getattr(self._controller, "needs_truth", False):
            problem = f"{choice.controller} needs the target's path in advance, which a dragged target has not"
            raise InputError(f"{problem}; choose another controller")
        self._task, self._speed, self._steps = task, choice.speed, round(LONGEST_S / task.period_s)
        self._path = HandPath(place, self._steps + 2)
        self._velocity: Floats = np.zeros(3)
        start = np.array([task.start], np.float32)
        duration = np.full(1, LONGEST_S, np.float32)
        self._engagement = Engagement(self._path, start, np.zeros(1, np.int32), duration)
        self._generator = np.random.default_rng([choice.seed, 73])
        self._state = self._world.begin(self._engagement, self._draw()[:, None])
        self._seen = self._world.see(self._state)
        self._memory = self._controller.reset(self._seen)
        self._angles, self._commands = [start[0]], [start[0]]
        self._pending: list[_Fired] = []
        self._scored: list[tuple[Any, ...]] = []  # (hit, flight time, miss, start, velocity, error) of each decision

    def _draw(self) -> Floats:
        return self._generator.standard_normal((1, self._world.normals)).astype(np.float32)

    @property
    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return self._task.period_s * (len(self._angles) - 1)

    @property
    def place(self) -> Floats:
        """Where the target is [m], shape (3,)."""
        return np.asarray(self._path.places[-1])

    @property
    def is_over(self) -> bool:
        """Whether its time is over."""
        return len(self._angles) > self._steps

    def step(self, hand: Floats) -> None:
        """Let a period pass, with the hand at a place [m], shape (3,)."""
        place, self._velocity = follow(self.place, self._velocity, hand, self._speed, self._task.period_s)
        self._path.add(self.elapsed + self._task.period_s, place)
        self._memory, command = self._controller.step(self._memory, self._seen)
        normals = self._draw()
        self._state, shot = self._world.step(self._state, command, normals)
        self._seen = self._world.see(self._state)
        self._angles.append(shot.angle[0])
        self._commands.append(self._seen.command[0])
        _, rate = self._world.hardware.angle_and_rate(self._state.hardware, self._engagement)
        time = np.array([self.elapsed], np.float32)
        self._pending.append(_Fired(time, shot.angle, rate, shot.fired, normals))
        self._score()

    def _score(self) -> None:
        """Score the pellets that have crossed the plate's plane by now, in the order of their shots."""
        fired = _Fired(*(np.stack(values) for values in zip(*self._pending, strict=True)))
        shots = self._world.shoot(self._engagement, *fired)
        crossed = np.where(np.isfinite(shots.flight_time), fired.time + shots.flight_time, fired.time + 0.2)
        for time, crossed_at, values in zip(fired.time, crossed, zip(*shots, strict=True), strict=True):
            if crossed_at[0] > self.elapsed:
                break
            shot, muzzle = Shot(*values), self._world.muzzle
            start, velocity = pellets_of(shot, self._path.at(crossed_at).position[:, 0], muzzle)
            aim = intercept(lambda times: self._path.at(times).position[..., 0, :], time, muzzle).angle
            hit, flight = shot.fired & (shot.margin >= 0.0), np.nan_to_num(shot.flight_time, nan=np.inf)
            self._scored.append((hit, flight, shot.miss, start, velocity, shot.angle - aim))
            self._pending.pop(0)

    def trial(self) -> Trial:
        """Return what there is to see so far, as a trial of one engagement."""
        count = len(self._angles) - 1
        empty = (False, np.inf, *(np.full(size, np.nan) for size in (2, 3, 3, 2)))
        rows = [*([value[0] for value in values] for values in self._scored)]
        rows = [*rows, *itertools.repeat([*empty], count - len(rows))]
        shapes = ((), (), (2,), (3,), (3,), (2,))
        columns = zip(*rows, strict=True) if rows else ((),) * len(shapes)
        fields = [
            np.asarray(column, bool if place == 0 else np.float64).reshape(1, count, *shape)
            for place, (column, shape) in enumerate(zip(columns, shapes, strict=True))
        ]
        angle, command, place = np.stack(self._angles)[None], np.stack(self._commands)[None], self._path.places[None]
        facts = self._task.period_s, self._task.hit_radius_m, self._world.muzzle, (HAND,)
        return Trial(*facts, angle, command, place.copy(), *fields)

"""A run against a target that is dragged by hand: its path isn't known when a pellet is fired.

So a shot is scored when its pellet has crossed the plate's plane.
"""

from typing import Any

import numpy as np

from archerfish.dynamics.aiming import intercept
from archerfish.errors import InputError
from archerfish.protocols import Engagement, Shot
from archerfish.simulation.world import make_world
from archerfish.viewer.choice import Setup, TrialChoice, chosen_controller, chosen_robot, chosen_task
from archerfish.viewer.motions import HAND, FloatArray, HandPath, follow
from archerfish.viewer.trial import Trial, pellets_of

LONGEST_RUN_S = 30.0
"""A run ends after this, and another begins [s]."""
UNKNOWN_FLIGHT_S = 0.2
"""Taken for the flight time where there is no pellet, or it crosses nothing [s]."""


class HandRun:
    """A run that continues by one decision at a time."""

    def __init__(self, setup: Setup, choice: TrialChoice, place: FloatArray) -> None:
        task = chosen_task(setup, choice)
        self._world, self._controller = make_world(chosen_robot(setup, choice), task), chosen_controller(setup, choice)
        if getattr(self._controller, "needs_truth", False):
            problem = f"{choice.controller} needs the target's path in advance, which a dragged target has not"
            raise InputError(f"{problem}; choose another controller")
        self._task, self._speed, self._steps = task, choice.speed, round(LONGEST_RUN_S / task.period_s)
        self._path = HandPath(place, self._steps + 2)
        self._velocity: FloatArray = np.zeros(3)
        start = np.array([task.start], np.float32)
        duration = np.full(1, LONGEST_RUN_S, np.float32)
        self._engagement = Engagement(self._path, start, np.zeros(1, np.int32), duration)
        self._generator = np.random.default_rng([choice.seed, 73])
        self._state = self._world.begin(self._engagement, self._draw()[:, None])
        self._seen = self._world.see(self._state)
        self._memory = self._controller.reset(self._seen)
        self._angles, self._commands = [start[0]], [start[0]]
        self._pending: list[tuple[Any, ...]] = []  # (time, angle, rate, fire, normals) of shots that are not yet scored
        self._scored = 0
        sizes = {"hit": (), "flight_time": (), "miss": (2,), "start": (3,), "velocity": (3,), "error": (2,)}
        self._fields = {name: np.full((1, self._steps, *size), np.nan) for name, size in sizes.items()}

    def _draw(self) -> FloatArray:
        return self._generator.standard_normal((1, self._world.normals)).astype(np.float32)

    @property
    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return self._task.period_s * (len(self._angles) - 1)

    @property
    def place(self) -> FloatArray:
        """Where the target is [m], shape (3,)."""
        return np.asarray(self._path.places[-1])

    @property
    def is_over(self) -> bool:
        """Whether its time is over."""
        return len(self._angles) > self._steps

    def step(self, hand: FloatArray) -> None:
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
        self._pending.append((time, shot.angle, rate, shot.fired, normals))
        self._score()

    def _score(self) -> None:
        """Score the pellets that have crossed the plate's plane by now, in the order of their shots."""
        times, *rest = (np.stack(values) for values in zip(*self._pending, strict=True))
        shots = self._world.shoot(self._engagement, times, *rest)
        crossed = times + np.nan_to_num(shots.flight_time, nan=UNKNOWN_FLIGHT_S)
        for time, crossed_at, values in zip(times, crossed, zip(*shots, strict=True), strict=True):
            if crossed_at[0] > self.elapsed:
                break
            shot, muzzle = Shot(*values), self._world.muzzle
            start, velocity = pellets_of(shot, self._path.at(crossed_at).position[:, 0], muzzle)
            aim = intercept(lambda times: self._path.at(times).position[..., 0, :], time, muzzle).angle
            hit = shot.fired & (shot.margin >= 0.0)
            found = (hit, shot.flight_time, shot.miss, start, velocity, shot.angle - aim)
            for field, value in zip(self._fields.values(), found, strict=True):
                field[0, self._scored] = value[0]
            self._scored += 1
            self._pending.pop(0)

    def trial(self) -> Trial:
        """Return what there is to see so far, as a trial of one engagement."""
        count = len(self._angles) - 1
        fields = {name: values[:, :count].copy() for name, values in self._fields.items()}
        fields |= {"hit": fields["hit"] == 1.0, "place": self._path.places[None].copy()}
        fields |= {"angle": np.stack(self._angles)[None], "command": np.stack(self._commands)[None]}
        return Trial(self._task.period_s, self._task.hit_radius_m, self._world.muzzle, (HAND,), **fields)

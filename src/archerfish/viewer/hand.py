"""A target that is dragged by hand, and the trial that goes on as long as it is dragged.

Nobody knows where the hand will go, so a pellet is judged when it crosses the armor's plane, not when it is fired.
"""

from typing import Any

import numpy as np

from archerfish.dynamics.intercept import intercept
from archerfish.records.errors import InputError
from archerfish.sensing.interfaces import Engagement
from archerfish.simulation.shooting import miss_at_armor
from archerfish.viewer.choice import Choice, Subject, check_choice, chosen_controller, chosen_world
from archerfish.viewer.trial import Floats, Trial

LONGEST_S = 30.0
"""After this the run begins anew [s]."""
REACTION_S = 0.12
"""Time in which the target takes up the hand's speed [s]."""
CLOSEST, FARTHEST, WIDEST = 0.8, 8.0, 2.5
"""Where a target may be dragged: ahead, and to each side [m]."""
HEIGHTS = (-0.3, 1.0)
"""How low and how high [m]."""


class HandPath:
    """Where the target was; it counts as standing still after the last known moment."""

    def __init__(self, place: Floats, capacity: int) -> None:
        self._times, self._places = np.zeros(capacity), np.zeros((capacity, 3))
        self._places[0], self._known = place, 1

    def position(self, time: Any) -> Floats:
        """Return the position [m] at times [s] of any shape B, shape B + (3,)."""
        times, places = self._times[: self._known], self._places[: self._known]
        each = [np.interp(np.asarray(time, np.float64), times, places[:, axis]) for axis in range(3)]
        return np.stack(each, axis=-1).astype(np.float32)

    def add(self, time: float, place: Floats) -> None:
        """Add a moment [s] and a place [m], shape (3,)."""
        self._times[self._known], self._places[self._known] = time, place
        self._known += 1

    @property
    def places(self) -> Floats:
        """All places so far [m], shape (N, 3)."""
        return self._places[: self._known]


def follow(place: Floats, velocity: Floats, wanted: Floats, speed: float, period_s: float) -> tuple[Floats, Floats]:
    """Move a target for a period towards where the hand holds it, at a bounded speed.

    Args:
      place: of the target [m], shape (3,).
      velocity: of the target [m/s], shape (3,).
      wanted: where the hand is [m], shape (3,).
      speed: largest speed [m/s].
      period_s: [s].

    Returns:
      Place and velocity after the period.
    """
    low, high = (CLOSEST, -WIDEST, HEIGHTS[0]), (FARTHEST, WIDEST, HEIGHTS[1])
    asked = (np.clip(wanted, low, high) - place) / REACTION_S
    length = float(np.linalg.norm(asked))
    asked = asked * min(1.0, speed / length) if length > 0 else asked
    velocity = velocity + (asked - velocity) * min(1.0, period_s / REACTION_S)
    return place + period_s * velocity, velocity


class HandRun:
    """A run that goes on in steps of a decision."""

    def __init__(self, subject: Subject, choice: Choice, place: Floats) -> None:
        check_choice(subject, choice)
        self._world, self._controller = chosen_world(subject, choice), chosen_controller(subject, choice)
        if getattr(self._controller, "needs_truth", False):
            raise InputError(
                f"{choice.controller} must know the target's way beforehand, so it can't shoot at a dragged target; "
                "choose another controller"
            )
        self._subject, self._choice = subject, choice
        self._steps = round(LONGEST_S / self._world.period_s)
        self._path = HandPath(place, self._steps + 2)
        self._velocity: Floats = np.zeros(3)
        start = np.array([[subject.conditions.start_pitch, subject.conditions.start_yaw]], np.float32)
        engagement = Engagement(self._path, start, np.zeros(1, np.int32))
        self._generator = np.random.default_rng([choice.seed, 73])
        self._state = self._world.begin(engagement, self._draw())
        self._seen = self._world.see(self._state)
        self._memory = self._controller.reset(self._seen)
        self._rows: list[tuple[Floats, ...]] = []
        self._fired: list[bool] = []
        self._fallback: list[bool] = []
        self._angles, self._commands = [start[0]], [start[0]]
        self._landed = 0  # the decisions before this one are judged
        self._judged: list[tuple[Floats, float, Floats]] = []

    def _draw(self) -> Floats:
        return self._generator.standard_normal((1, self._world.normals)).astype(np.float32)

    @property
    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return self._world.period_s * len(self._rows)

    @property
    def place(self) -> Floats:
        """Where the target is [m], shape (3,)."""
        return np.asarray(self._path.places[-1])

    @property
    def over(self) -> bool:
        """Whether its time is up."""
        return len(self._rows) >= self._steps

    def step(self, wanted: Floats) -> None:
        """Let a period go by, with the hand at a place [m], shape (3,)."""
        period = self._world.period_s
        place, self._velocity = follow(self.place, self._velocity, wanted, self._choice.speed, period)
        self._path.add(self.elapsed + period, place)
        self._memory, command = self._controller.step(self._memory, self._seen)
        draws = self._draw()
        self._state, shot = self._world.shoot(self._state, command, draws)
        self._seen = self._world.see(self._state)
        position, velocity = self._world.pellet(self._state, draws)
        self._rows.append((position[0], velocity[0]))
        self._fired.append(bool(shot.fired[0]))
        self._fallback.append(bool(command.fallback[0]))
        self._angles.append(shot.angle[0])
        self._commands.append(self._seen.command[0])
        self._judge()

    def _judge(self) -> None:
        """Judge the pellets that have crossed the armor's plane by now, in order of firing.

        Of a shot that was withheld, only the aim is judged, and at the time at which its pellet would have crossed.
        """
        while self._landed < len(self._rows):
            position, velocity = (each[None] for each in self._rows[self._landed])
            fired = np.array([self._world.period_s * (self._landed + 1)])
            miss, flight = miss_at_armor(self._world.muzzle, self._path, fired, position, velocity)
            if fired[0] + flight[0] > self.elapsed:
                return
            aim = intercept(lambda time: self._path.position(time), fired, self._world.muzzle)
            error = self._angles[self._landed + 1] - aim.angle[0]
            landed = (miss[0], float(flight[0])) if self._fired[self._landed] else (np.full(2, np.nan), np.inf)
            self._judged.append((*landed, error))
            self._landed += 1

    def trial(self) -> Trial:
        """Return what there is to see so far, as a trial of one engagement."""
        count, judged = len(self._rows), len(self._judged)
        miss, flight, error = np.full((count, 2), np.inf), np.full(count, np.inf), np.full((count, 2), np.nan)
        for rows, values in zip((miss, flight, error), zip(*self._judged, strict=True), strict=False):
            rows[:judged] = np.stack([np.asarray(each) for each in values])
        pellets = np.array(self._rows, np.float32).reshape(count, 2, 3)
        return Trial(
            period_s=self._world.period_s,
            hit_radius=self._subject.conditions.hit_radius,
            drag=float(self._world.muzzle.drag),
            spread=np.asarray(self._world.muzzle.sd),
            angle=np.stack(self._angles)[None],
            command=np.stack(self._commands)[None],
            place=self._path.places[None].copy(),
            fired=np.array(self._fired, bool)[None],
            fallback=np.array(self._fallback, bool)[None],
            position=pellets[None, :, 0],
            velocity=pellets[None, :, 1],
            flight_time=flight[None],
            miss=miss[None],
            error=error[None],
        )

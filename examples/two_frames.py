"""Leads by the difference of the last two frames: no filter, and no model of the gimbal. Runs compiled."""

from typing import Any, NamedTuple

from archerfish.authors import aim, first_detection, intercept, namespace, select


class TwoFrames(NamedTuple):
    muzzle: Any  # for drop, drag and flight time
    period: Any  # from a decision until its pellet leaves [s]

    def reset(self, seen, truth=None):
        first = first_detection(seen)  # a guess, with fresh = False, where no frame shows anything
        return first.place, 0.0 * first.place, first.age  # B + (3,), B + (3,), B

    def step(self, state, seen):
        (before, velocity, age), latest, xp = state, first_detection(seen), namespace(seen.elapsed)
        new, age = latest.fresh & (seen.elapsed > 0.0), age + seen.elapsed  # the first step gets reset's frames again
        between = xp.where(new, age - latest.age, 1.0)[..., None]
        measured = xp.clip((latest.place - before) / between, -2.0, 2.0)  # frames are noisy, robots no faster [m/s]
        velocity = xp.where(new[..., None], measured, velocity)
        place, age = select(new, (latest.place, latest.age), (before, age))
        delay = self.period + 0.0 * age
        angle = intercept(lambda time: place + velocity * (age + time)[..., None], delay, self.muzzle).angle
        return (place, velocity, age), aim(angle)


def two_frames(robot, task):
    return TwoFrames(robot.muzzle_model(), task.period_s)

"""Motions that no training draws, for evaluations, as functions of a batch of uniform draws."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from archerfish.arrays import map_arrays, namespace
from archerfish.targets.mixture import path_about
from archerfish.targets.motion import BEGIN_S, STEP_S, TIMES, ZERO

LENGTHS, CHANCES = (1.0, 3.0), 40


class Draws:
    """Uniform draws of a batch of targets, shape (B, CHANCES), made from four by a hash."""

    def __init__(self, uniforms: Any) -> None:
        """Take uniforms of shape (B, 4)."""
        seeds = (np.asarray(uniforms, np.float64) * 2**24).astype(np.uint64) @ np.array(
            [1, 2**16 + 1, 2**32 + 5, 3], np.uint64
        )
        mixed: Any = (seeds[..., None] + np.arange(1, CHANCES + 1, dtype=np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        for shift in (30, 27):
            mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(0xBF58476D1CE4E5B9)
        self.chance = (mixed >> np.uint64(11)) / 2.0**53

    def between(self, index: int, low: float, high: float) -> Any:
        """Return a parameter, shape (B, 1)."""
        return low + (high - low) * self.chance[..., index, None]

    def side(self, index: int) -> Any:
        """Return -1 or 1, shape (B, 1)."""
        return np.where(self.chance[..., index, None] < 0.5, -1.0, 1.0)

    def phase(self, index: int) -> Any:
        """Return an angle [rad], shape (B, 1)."""
        return self.between(index, 0.0, 2.0 * math.pi)

    def sideways(self) -> Any:
        """Return a heading that is mostly across."""
        return self.between(0, -0.5, 0.5)

    def swing(self, first: int, amplitude: tuple[float, float], frequency: tuple[float, float]) -> Any:
        """Return a sine of three draws."""
        size, rate = self.between(first, *amplitude), self.between(first + 1, *frequency)
        return size * np.sin(2.0 * math.pi * rate * TIMES + self.phase(first + 2))

    def turns(self, periods: tuple[float, float]) -> Any:
        """Return the share of a cycle that is gone, of draws 1 and 2."""
        return (TIMES / self.between(1, *periods) + self.between(2, 0.0, 1.0)) % 1.0

    def legs(self, first: int, dwell: tuple[float, float], count: int = 14) -> tuple[Any, Any]:
        """Return at `TIMES` the number of the leg that is under way, and a number 0…1 of each leg's own."""
        ends = BEGIN_S + np.cumsum(dwell[0] + (dwell[1] - dwell[0]) * self.chance[..., first : first + count], axis=-1)
        leg = np.minimum((ends[..., None] <= TIMES).sum(axis=-2), count - 1)
        return leg, np.take_along_axis(self.chance[..., first + count : first + 2 * count], leg, axis=-1)


def along(heading: Any, way: Any) -> Any:
    """Return a level way along a line; zero is across the line of sight."""
    return np.stack([np.sin(heading) * way, np.cos(heading) * way], axis=-1)


def driven(speed: Any) -> Any:
    """Return the way of a speed at `TIMES`, zero at time zero."""
    way = np.cumsum(speed, axis=-1) * STEP_S
    return way - way[..., ZERO, None]


def from_zero(way: Any) -> Any:
    """Return a way that is zero at time zero."""
    return way - way[..., ZERO, None, :]


def soft(speed: Any, steps: int = 6) -> Any:
    """Smooth a speed over some steps."""
    return np.apply_along_axis(lambda row: np.convolve(row, np.full(steps, 1.0 / steps), "same"), -1, speed)


def dash(d: Draws) -> Any:
    """Stand, then drive off to one side."""
    late = np.maximum(TIMES - d.between(1, 0.1, 0.8), 0.0)
    return along(d.sideways(), driven(d.side(2) * np.minimum(d.between(3, 6.0, 15.0) * late, d.between(4, 1.0, 2.5))))


def dash_again(d: Draws) -> Any:
    """Rest and drive off in turn, to sides that are drawn again."""
    leg, own = d.legs(6, (0.2, 0.6))
    return along(d.sideways(), driven(soft(np.where(leg % 2 == 0, 0.0, np.sign(own - 0.5) * d.between(1, 1.0, 2.5)))))


def stagger(d: Draws) -> Any:
    """Drive in short legs of any direction and speed."""
    _, own = d.legs(6, (0.1, 0.4))
    speed, heading = 1.5 * ((7.0 * own) % 1.0), 2.0 * math.pi * own
    return np.stack([driven(soft(speed * turn(heading))) for turn in (np.sin, np.cos)], axis=-1)


def two_swings(d: Draws) -> Any:
    """Swing in two sines at once."""
    return along(d.sideways(), d.swing(1, (0.1, 0.4), (0.2, 0.6)) + d.swing(4, (0.05, 0.15), (0.8, 1.6)))


def even_speeding(d: Draws) -> Any:
    """Drive at a speed that rises and falls evenly, to and fro."""
    rising = 2.0 * np.abs(2.0 * d.turns((0.8, 2.0)) - 1.0) - 1.0
    return along(d.sideways(), driven(d.between(3, 0.5, 2.0) * rising))


def to_and_from(d: Draws) -> Any:
    """Drive towards the gimbal and away."""
    turn = np.sign(np.sin(2.0 * math.pi * d.turns((0.8, 2.0))))
    return along(d.between(0, 1.3, 1.57), driven(d.between(3, 0.4, 1.5) * turn))


def fast_line(d: Draws) -> Any:
    """Drive past the gimbal at 2.5 m/s."""
    return along(d.between(0, -0.2, 0.2), d.side(1) * 2.5 * TIMES)


def jumps(d: Draws) -> Any:
    """Go from one place to another in no time, as no robot does."""
    return along(d.sideways(), d.between(3, 0.1, 0.3) * np.sign(np.sin(2.0 * math.pi * d.turns((0.4, 1.2)))))


def eight(d: Draws) -> Any:
    """Drive a figure of eight."""
    angle, radius = 2.0 * math.pi * d.between(1, 0.3, 0.8) * TIMES + d.phase(2), d.between(3, 0.15, 0.5)
    return np.stack([0.5 * radius * np.sin(2.0 * angle), radius * np.sin(angle)], axis=-1)


def pushes(d: Draws) -> Any:
    """Accelerate by one size, with a sign that is drawn again at even times, and some friction."""
    leg = np.minimum(((TIMES - BEGIN_S) / d.between(1, 0.15, 0.4)).astype(int), 27)
    pushed = d.between(2, 1.0, 5.0) * np.sign(np.take_along_axis(d.chance[..., 6:34], leg, axis=-1) - 0.5)
    speed, speeds = np.zeros(d.chance.shape[:-1]), []
    for index in range(len(TIMES)):
        speed = speed * (1.0 - STEP_S / 0.8) + STEP_S * pushed[..., index]
        speeds.append(speed)
    return along(d.sideways(), driven(np.stack(speeds, axis=-1)))


def weaving(d: Draws) -> Any:
    """Drive straight on, swinging."""
    line = along(d.sideways(), d.side(1) * d.between(2, 0.3, 1.5) * TIMES)
    return line + along(d.between(3, -1.57, 1.57), d.swing(4, (0.03, 0.15), (0.6, 1.8)))


def creeping(d: Draws) -> Any:
    """Drive straight on, slower than any in the table."""
    return along(d.between(0, -1.5, 1.5), d.side(1) * d.between(2, 0.05, 0.3) * TIMES)


def to_and_fro_with_rests(d: Draws) -> Any:
    """Drive there, rest, drive back, rest."""
    turn = d.turns((0.9, 2.0))
    speed = np.select([turn < 0.3, turn < 0.5, turn < 0.8], [1.0, 0.0, -1.0], 0.0)
    return along(d.sideways(), driven(d.between(3, 0.4, 1.8) * soft(speed)))


def chirp(d: Draws) -> Any:
    """Swing quicker and quicker."""
    turns = d.between(1, 0.2, 0.5) * TIMES + 0.5 * d.between(2, 0.1, 0.4) * TIMES**2
    return along(d.sideways(), d.between(3, 0.1, 0.3) * np.sin(2.0 * math.pi * turns + d.phase(4)))


def spinning_and_driving(d: Draws) -> Any:
    """Show one plate of a robot that spins while it drives, always in sight."""
    angle = d.between(1, 2.0, 6.0) * TIMES + d.phase(2)
    circle = 0.2 * np.stack([-np.cos(angle), np.sin(angle)], axis=-1)
    return circle + along(d.between(3, -0.5, 0.5), d.between(4, -0.8, 0.8) * TIMES)


def wide_and_straight(d: Draws) -> Any:
    """Follow eq (7) without curvature, three to five times as wide."""
    width, speed = d.between(1, 0.3, 0.6), d.between(2, 0.1, 0.9)
    turn = (TIMES * speed / (4.0 * width) + d.between(3, 0.0, 1.0)) % 1.0
    wave = np.where(turn < 0.25, 4.0 * turn, np.where(turn < 0.75, 2.0 - 4.0 * turn, 4.0 * turn - 4.0))
    return along(np.zeros_like(width), width * wave)


def soft_braking(d: Draws) -> Any:
    """Drive, and brake to a stand at some moment."""
    braked = d.between(3, 1.0, 4.0) * np.maximum(TIMES - d.between(2, -0.2, 2.0), 0.0)
    return along(d.sideways(), driven(d.side(4) * np.maximum(d.between(1, 0.5, 2.5) - braked, 0.0)))


BURSTS = (dash, dash_again, stagger)
OTHERS = (
    two_swings, even_speeding, to_and_from, fast_line, jumps, eight, pushes, weaving, creeping,
    to_and_fro_with_rests, chirp, spinning_and_driving, wide_and_straight, soft_braking,
)  # fmt: skip


# Five more, looked at while the training was developed.


def depth_zigzag(d: Draws) -> Any:
    """Turn back towards the gimbal and away from it, while drifting sideways."""
    turn = np.sign(np.sin(2.0 * math.pi * (TIMES / d.between(1, 0.4, 1.0) + d.between(2, 0.0, 1.0))))
    zero = 0.0 * d.between(0, 0.0, 1.0)
    return along(1.4 + zero, driven(d.between(3, 0.4, 1.2) * turn)) + along(
        zero, d.side(4) * d.between(5, 0.2, 0.8) * TIMES
    )


def peek(d: Draws) -> Any:
    """Come out from cover for a moment, and go back the same way; again and again."""
    period, out = d.between(1, 1.0, 2.0), d.between(2, 0.15, 0.4)
    at = ((TIMES / period + d.between(4, 0.0, 1.0)) % 1.0) * period
    back = (at > 0.5 * period) & (at < 0.5 * period + out)
    return along(
        d.sideways(), driven(np.select([at < out, back], [1.0, -1.0], 0.0) * d.between(3, 0.6, 2.0) * d.side(5))
    )


def random_walk(d: Draws) -> Any:
    """Drive at a speed that is noise with a memory of 0.3 s, of about 0.8 m/s."""
    leg = np.minimum(((TIMES - BEGIN_S) / 0.13).astype(int), 27)
    kick = d.chance[..., 6:34][..., leg] - 0.5
    speed, speeds = np.zeros(d.chance.shape[:-1]), []
    for index in range(len(TIMES)):
        speed = speed + STEP_S * (-speed / 0.3 + 14.0 * kick[..., index])
        speeds.append(speed)
    return along(d.sideways(), driven(np.stack(speeds, axis=-1)))


def late_start(d: Draws) -> Any:
    """Stand for 0.3–0.9 s, then drive off."""
    late = np.maximum(TIMES - d.between(1, 0.3, 0.9), 0.0)
    return along(d.sideways(), driven(d.side(2) * np.minimum(8.0 * late, d.between(3, 0.8, 2.2))))


def shuffle(d: Draws) -> Any:
    """Turn back every 0.15–0.35 s."""
    turn = np.sign(np.sin(math.pi * (TIMES / d.between(1, 0.15, 0.35) + d.between(2, 0.0, 2.0))))
    return along(d.sideways(), driven(d.between(3, 0.5, 1.8) * turn))


ZIGZAG = (depth_zigzag,)
LATE = (peek, random_walk, late_start, shuffle)

# Ten more. Looked at since, as those above.


def patrol(d: Draws) -> Any:
    """Drive round a rectangle, cutting its corners at 0.7 of the speed."""
    long, short, speed = d.between(1, 0.3, 0.9), d.between(2, 0.2, 0.6), d.between(3, 0.5, 1.8)
    at = (speed * TIMES + d.between(4, 0.0, 3.0)) % (2.0 * (long + short))
    edges = [at < long, at < long + short, at < 2.0 * long + short]
    over, beside = np.select(edges, [1.0, 0.0, -1.0], 0.0), np.select(edges, [0.0, 1.0, 0.0], -1.0)
    heading = d.phase(5)
    turned = heading + d.side(6) * math.pi / 2.0
    return along(heading, driven(speed * soft(over))) + along(turned, driven(speed * soft(beside)))


def u_turns(d: Draws) -> Any:
    """Drive there, turn in half a circle, drive back, turn again."""
    straight, radius = d.between(1, 0.2, 0.8), d.between(2, 0.1, 0.3)
    half = straight + math.pi * radius
    at = (d.between(3, 0.5, 1.8) * TIMES + d.between(4, 0.0, 2.0)) % (2.0 * half)
    back = at >= half
    on = np.where(back, at - half, at)
    angle = np.maximum(on - straight, 0.0) / radius
    over = np.minimum(on, straight) + radius * np.sin(angle)
    beside = radius * (1.0 - np.cos(angle))
    over, beside = np.where(back, straight - over, over), np.where(back, 2.0 * radius - beside, beside)
    heading = d.phase(5)
    return from_zero(along(heading, over) + along(heading + d.side(6) * math.pi / 2.0, beside))


def keys(d: Draws) -> Any:
    """Follow a driver's four keys, left, right, forward and back, each pair independently."""
    top, lag = d.between(1, 0.8, 2.0), d.between(2, 0.06, 0.2)
    moved = []
    for first, turn in ((4, 0.0), (22, math.pi / 2.0)):
        _, own = d.legs(first, (0.15, 0.7), 9)
        wanted = top * (np.floor(3.0 * own) - 1.0)
        speed, speeds = wanted[..., 0], []
        for index in range(len(TIMES)):
            speed = speed + STEP_S / lag[..., 0] * (wanted[..., index] - speed)
            speeds.append(speed)
        moved.append(along(d.between(3, -0.3, 0.3) + turn, driven(np.stack(speeds, axis=-1))))
    return moved[0] + moved[1]


def surge(d: Draws) -> Any:
    """Drive across steadily and, for a third of a second now and then, twice to three times as fast."""
    turn = d.turns((0.6, 1.5)) * d.between(1, 0.6, 1.5)
    speed = d.between(3, 0.25, 0.9) * np.where(turn < 0.33, d.between(4, 2.0, 3.0), 1.0)
    return along(d.sideways(), driven(d.side(5) * soft(speed)))


def spiral(d: Draws) -> Any:
    """Drive circles that grow."""
    radius = np.maximum(d.between(1, 0.05, 0.2) + d.between(2, 0.03, 0.12) * TIMES, 0.02)
    angle = d.side(3) * d.between(4, 1.5, 4.5) * TIMES + d.phase(5)
    return from_zero(radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def bump(d: Draws) -> Any:
    """Drive into a wall at some moment, recoil, and come to a stand."""
    after = TIMES - d.between(1, 0.0, 1.6)
    recoil = -d.between(2, 0.1, 0.5) * np.exp(-np.maximum(after, 0.0) / d.between(3, 0.1, 0.3))
    return along(d.sideways(), driven(d.side(4) * d.between(5, 0.6, 2.2) * np.where(after < 0.0, 1.0, recoil)))


def arc(d: Draws) -> Any:
    """Drive on an arc of 2–6 m radius, and turn back now and then."""
    radius = d.between(1, 2.0, 6.0)
    leg, _ = d.legs(6, (0.5, 1.6))
    angle = driven(d.side(2) * d.between(3, 0.4, 2.0) * soft(np.where(leg % 2 == 0, 1.0, -1.0), 10)) / radius
    return radius[..., None] * np.stack([np.cos(angle) - 1.0, np.sin(angle)], axis=-1)


def feint(d: Draws) -> Any:
    """Lurch to one side for a moment, drive off to the other, then stand; again and again."""
    turn = d.turns((0.9, 2.0))
    speed = np.select([turn < d.between(3, 0.08, 0.16), turn < 0.7], [-1.0, 1.0], 0.0)
    return along(d.sideways(), driven(d.side(4) * d.between(5, 0.6, 2.0) * soft(speed)))


def slalom(d: Draws) -> Any:
    """Drive away or nearer at 40–80° to the lateral direction, swinging sideways."""
    line = along(d.side(1) * d.between(2, 0.7, 1.4), d.between(3, 0.4, 1.2) * d.side(4) * TIMES)
    return from_zero(line + along(0.0 * d.between(0, 0.0, 1.0), d.swing(5, (0.12, 0.35), (0.35, 0.8))))


def lurch(d: Draws) -> Any:
    """Speed up slowly, brake hard, and once more, to sides that are drawn again."""
    leg, own = d.legs(6, (0.5, 1.3))
    speeds, speed = [], np.zeros(d.chance.shape[:-1])
    for index in range(len(TIMES)):
        ends = leg[..., min(index + 6, len(TIMES) - 1)] != leg[..., index]
        wanted = np.where(ends, 0.0, d.between(1, 1.0, 2.2)[..., 0] * np.sign(own[..., index] - 0.5))
        most = STEP_S * np.where(ends, 12.0, d.between(2, 1.5, 4.0)[..., 0])
        speed = speed + np.clip(wanted - speed, -most, most)
        speeds.append(speed)
    return along(d.sideways(), driven(np.stack(speeds, axis=-1)))


TEN = (patrol, u_turns, keys, surge, spiral, bump, arc, feint, slalom, lurch)

# A second ten, written after the first had been looked at, and before the policies of the stored results were trained.


def shuttle(d: Draws) -> Any:
    """Drive to and fro between two places: speed up, hold the speed, brake, turn back at once."""
    top, acceleration = d.between(1, 0.6, 2.2), d.between(2, 1.5, 5.0)
    hold = d.between(3, 0.1, 0.8)
    half = 2.0 * top / acceleration + hold
    at = (TIMES + d.between(4, 0.0, 2.0)) % (2.0 * half)
    on = np.where(at < half, at, at - half)
    speed = np.minimum(np.minimum(acceleration * on, top), acceleration * (half - on))
    return along(d.sideways(), driven(np.where(at < half, speed, -speed) * d.side(5)))


def hesitate(d: Draws) -> Any:
    """Drive across and slow down for a moment now and then, then drive on to the same side."""
    period, brief = d.between(1, 0.7, 1.6), d.between(2, 0.15, 0.35)
    at = ((TIMES / period + d.between(3, 0.0, 1.0)) % 1.0) * period
    speed = np.where(at < brief, d.between(4, 0.0, 0.4), 1.0)
    return along(d.sideways(), driven(d.side(5) * d.between(6, 0.6, 2.0) * soft(speed)))


def covers(d: Draws) -> Any:
    """Drive smoothly from place to place, with rests between."""
    move, rest = d.between(1, 0.5, 1.1), d.between(2, 0.1, 0.4)
    passed = (TIMES - BEGIN_S) / (move + rest) + d.between(3, 0.0, 1.0)
    leg = np.minimum(passed.astype(int), 26)
    places = d.chance[..., 10:38] - 0.5
    before, after = (np.take_along_axis(places, leg + later, axis=-1) for later in (0, 1))
    gone = np.clip((passed - leg) * (move + rest) / move, 0.0, 1.0)
    eased = gone**3 * (10.0 - 15.0 * gone + 6.0 * gone**2)  # of the least jerk
    displacement = d.between(4, 0.4, 1.0) * (before + eased * (after - before))
    return from_zero(along(d.sideways(), displacement))


def wander(d: Draws) -> Any:
    """Drive at a velocity that is noise with a memory of 1 s, in both directions, of about 1.1 m/s."""
    leg = np.minimum(((TIMES - BEGIN_S) / 0.26).astype(int), 13)
    parts = []
    for first in (6, 20):
        kick = d.chance[..., first : first + 14][..., leg] - 0.5
        speed, speeds = 1.6 * (d.chance[..., first // 6] - 0.5), []
        for index in range(len(TIMES)):
            speed = speed + STEP_S * (-speed / 1.0 + 9.0 * kick[..., index])
            speeds.append(speed)
        parts.append(driven(np.stack(speeds, axis=-1)))
    return np.stack(parts, axis=-1)


def corners(d: Draws) -> Any:
    """Drive at one speed, and turn by 60–120° now and then, slipping on at first."""
    leg, own = d.legs(8, (0.5, 1.4))
    turned = np.where(own < 0.5, -1.0, 1.0) * np.radians(60.0 + 60.0 * ((7.0 * own) % 1.0))
    new = np.diff(leg, axis=-1, prepend=leg[..., :1]) > 0
    course = d.phase(1) + np.cumsum(np.where(new, turned, 0.0), axis=-1)
    lag = d.between(2, 0.05, 0.15)[..., 0]
    wanted = d.between(3, 0.5, 1.8)[..., None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    velocity, velocities = wanted[..., 0, :], []
    for index in range(len(TIMES)):
        velocity = velocity + (STEP_S / lag)[..., None] * (wanted[..., index, :] - velocity)
        velocities.append(velocity)
    return np.stack([driven(np.stack([v[..., axis] for v in velocities], axis=-1)) for axis in (0, 1)], axis=-1)


def ram(d: Draws) -> Any:
    """Drive towards the gimbal, faster and faster, and swerve to one side at some moment."""
    start, acceleration, top = d.between(1, 0.0, 0.6), d.between(2, 0.5, 2.0), d.between(3, 0.6, 1.5)
    speed = np.minimum(start + acceleration * (TIMES - BEGIN_S), top)
    swerve = np.clip((TIMES - d.between(4, 0.1, 1.8)) / d.between(5, 0.2, 0.5), 0.0, 1.0)
    course = d.between(6, -0.2, 0.2) + d.side(7) * d.between(8, 0.8, 1.6) * swerve
    return np.stack([driven(-speed * np.cos(course)), driven(speed * np.sin(course))], axis=-1)


def sidestep(d: Draws) -> Any:
    """Stand, and step aside quickly now and then, to a side that is drawn again."""
    pause, step = d.between(1, 0.35, 1.0), d.between(2, 0.2, 0.35)
    passed = (TIMES - BEGIN_S) / (pause + step) + d.between(3, 0.0, 1.0)
    leg = np.minimum(passed.astype(int), 27)
    side = np.sign(np.take_along_axis(d.chance[..., 10:38], leg, axis=-1) - 0.5)
    gone = np.clip(((passed - leg) * (pause + step) - pause) / step, 0.0, 1.0)
    speed = side * np.where((gone > 0.0) & (gone < 1.0), 2.0 * np.sin(math.pi * gone) ** 2, 0.0)
    return along(d.sideways(), driven(d.between(4, 0.1, 0.25) / step * speed))


def rocking(d: Draws) -> Any:
    """Swing to rest after a push, and be pushed once more."""
    frequency, decay, size = d.between(1, 0.5, 1.5), d.between(2, 0.4, 1.5), d.between(3, 0.1, 0.35)
    moved = 0.0 * TIMES
    for first, since in ((4, TIMES - BEGIN_S), (6, TIMES - d.between(8, 0.2, 2.0))):
        after = np.maximum(since, 0.0)
        swing = np.exp(-after / decay) * np.sin(2.0 * math.pi * frequency * after)
        moved = moved + d.side(first) * size * d.between(first + 1, 0.5, 1.0) * swing
    return from_zero(along(d.sideways(), moved))


def snake(d: Draws) -> Any:
    """Drive at one speed on a course that swings by up to 90° to either side."""
    course = d.phase(1) + d.swing(2, (0.4, 1.6), (0.3, 1.0))
    speed = d.between(6, 0.4, 1.8)
    return np.stack([driven(speed * np.sin(course)), driven(speed * np.cos(course))], axis=-1)


def sprint(d: Draws) -> Any:
    """Speed up evenly from a slow pace to a fast one, and hold it."""
    slow, fast = d.between(1, 0.0, 0.5), d.between(2, 1.0, 2.4)
    gained = d.between(3, 0.6, 3.0) * np.maximum(TIMES - d.between(4, -0.3, 1.2), 0.0)
    return along(d.sideways(), driven(d.side(5) * np.minimum(slow + gained, fast)))


SECOND_TEN = (shuttle, hesitate, covers, wander, corners, ram, sidestep, rocking, snake, sprint)


def motion(way: Callable[[Draws], Any], length_s: float) -> Any:
    """Return a motion as a user's code has it, within the speed and displacement of the drawn ones."""

    def draw(place: Any, speed: Any, uniforms: Any) -> Any:  # noqa: ARG001
        xp, traced = namespace(place, uniforms), not isinstance(uniforms, np.ndarray)
        if traced:  # for the shapes alone: an evaluation draws in NumPy
            place, uniforms = (np.ones(each.shape, np.float32) for each in (place, uniforms))
        displacement = way(Draws(uniforms)).astype(np.float32)
        path = path_about(place, displacement, np.full(len(place), length_s, np.float32))
        return map_arrays(xp.asarray, path) if traced else path

    return draw


# As names of this file, by which a task finds them: dash_1, dash_3, …
globals().update(
    {
        f"{way.__name__}_{length:g}": motion(way, length)
        for way in (*BURSTS, *OTHERS, *ZIGZAG, *LATE, *TEN, *SECOND_TEN)
        for length in LENGTHS
    }
)

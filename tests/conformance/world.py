"""A world that needs all of the protocols: four plates that hide each other, a base that drives and turns.

Several frames a decision show the plates that face the camera, in slots without identity; frames are missed, and for a
second nothing is found. Tests load this file by the fixture `conformance`.
"""

import numpy as np

from archerfish import protocols as p
from archerfish.arrays import Array, lift, namespace, select, single_precision, tree
from archerfish.controllers.aiming.direct import DirectAim
from archerfish.controllers.predictors.constant_velocity import ConstantVelocity
from archerfish.controllers.predictors.predictor import AgedTrack
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.robot import Robot
from archerfish.simulation.world import WorldState, scored
from archerfish.task import Task
from archerfish.tracking.detections import Detection
from archerfish.tracking.kalman_filter import TrackerNoise, begin_track, moved

SLOTS, FACING, MISSED, BLIND = 2, 0.5, -1.28, (0.7, 1.7)
"""Slots of a frame; cosine at which a plate is found; normal below which a frame is missed; nothing is found [s]."""
OWN_VELOCITY, AGES, HALF = map(np.float32, ([0.0, 1.0, 0.0], [0.021, 0.014, 0.008], [0.065, 0.06]))
"""Of the base [m/s]; of the frames at a decision, oldest first [s]; half width and half height of a plate [m]."""
PER_FRAME = 2 + 3 * SLOTS
"""Normals of a frame: whether it is missed, order of the slots, noise of the places."""


@tree()
class FourPlates:
    """A robot that drives straight and turns about itself."""

    centre: Array  # at time zero [m], B + (3,)
    velocity: Array  # [m/s], B + (3,)
    turning: Array  # yaw of the first plate at time zero [rad], yaw rate [rad/s], radius [m], B + (3,)

    plates = 4

    def at(self, time: Array) -> p.Plates:
        """Return the plates at times [s] of shape B or (N,) + B."""
        xp, time = namespace(self.centre, time), time[..., None]
        yaw, spin, radius = (lift(self.turning[..., index, None], time) for index in range(3))
        yaw = yaw + spin * time + lift(xp.asarray(np.arange(4) * np.pi / 2, dtype=time.dtype), time)
        out = xp.stack([radius * xp.cos(yaw), radius * xp.sin(yaw), 0.0 * yaw], axis=-1)
        centre = lift(self.centre, time) + lift(self.velocity, time) * time
        return p.Plates(centre[..., None, :] + out, yaw)


@tree(left_out=("name",))
class ConformanceWorld:
    """Plates are hit from their front, inside a rectangle."""

    period: Array  # [s], ()
    gimbal: GimbalModel
    muzzle: Muzzle
    limits: CommandLimits  # of yaw against the base
    name: str = ""

    compiled, plants = True, 1
    period_s = property(lambda self: float(self.period))
    normals = property(lambda self: 3 + PER_FRAME * len(AGES))

    def begin(self, engagement: p.Engagement, normals: Array) -> WorldState:
        """Begin at rest; the hardware is gimbal and frames."""
        start, time = engagement.start, 0.0 * engagement.start[..., 0]
        hardware = rest_state(self.gimbal, start), self._frames(engagement.target, time, normals[..., -1, :])
        return WorldState(hardware, start, 0.0 * start, time, engagement)

    def see(self, state: WorldState) -> p.Seen:
        """Return what a controller sees."""
        (gimbal, frames), zero = state.hardware, 0.0 * state.time
        feedback = p.GimbalFeedback(gimbal_angle(self.gimbal, gimbal), gimbal_rate(self.gimbal, gimbal), zero)
        elapsed = namespace(zero).where(state.time > 0.0, self.period, zero)
        barrel = p.Barrel(zero + self.muzzle.speed, zero + 1e6)
        return p.Seen(elapsed, feedback, state.command, frames, self._base(state.time), barrel)

    def step(self, state: WorldState, command: p.Command, normals: Array) -> tuple[WorldState, p.Shot]:
        """Hold a command for a period, then fire."""
        xp, time, target = namespace(state.time), state.time + self.period, state.engagement.target
        base = self._base(time)
        turned = xp.stack([0.0 * base.yaw, base.yaw], axis=-1)  # the mechanical range turns with the base
        low, high = (lift(each, turned) + turned for each in (self.limits.low, self.limits.high))
        limits = self.limits._replace(low=low, high=high)
        asked = limit_command(limits, command.angle, state.command, state.command_rate, 0.0 * turned, self.period)
        gimbal, frames = advance(self.gimbal, state.hardware[0], asked), self._frames(target, time, normals)
        following = WorldState((gimbal, frames), asked, (asked - state.command) / self.period, time, state.engagement)
        angle, rate = gimbal_angle(self.gimbal, gimbal), gimbal_rate(self.gimbal, gimbal)
        position, velocity = pellet_at_muzzle(self.muzzle, angle, rate, normals[..., :3])
        miss, flown, front = self._crossings(target, time, position + base.position, velocity + base.velocity)
        margin = xp.where(front, xp.min(lift(HALF, miss) - xp.abs(miss), axis=-1), -1e3)
        plate = xp.argmax(margin, axis=-1)[..., None]
        margin, flown, front = (xp.take_along_axis(each, plate, axis=-1)[..., 0] for each in (margin, flown, front))
        miss = xp.take_along_axis(miss, plate[..., None], axis=-2)[..., 0, :]
        return following, scored(command.fire, plate[..., 0], miss, margin, front, flown, angle)

    def truth(self, engagement: p.Engagement) -> p.Truth:
        """Return the target's path and the models."""
        return p.Truth(engagement.target, self.gimbal, self.muzzle)

    def _base(self, time: Array) -> p.Base:
        velocity = lift(OWN_VELOCITY, time[..., None]) + 0.0 * time[..., None]
        return p.Base(velocity * time[..., None], velocity, time - 1.0, 0.0 * time + 1.0)  # turns at 1 rad/s

    def _frames(self, target: FourPlates, time: Array, normals: Array) -> p.Frames:
        xp = namespace(time)
        ages = lift(AGES, time[..., None]) + 0.0 * time[..., None]  # B + (F,)
        exposed = time[..., None] - ages
        place, normal = (xp.moveaxis(each, 0, time.ndim) for each in target.at(xp.moveaxis(exposed, -1, 0)))
        own = self._base(exposed).position
        facing = xp.cos(line_of_sight(own[..., None, :] - place)[..., 1] - normal)
        drawn = normals[..., 3:].reshape((*ages.shape, PER_FRAME))
        order = xp.argsort(-facing, axis=-1)[..., :SLOTS]
        order = xp.where(drawn[..., 1:2] > 0.0, xp.flip(order, axis=-1), order)
        received = drawn[..., 0] > MISSED
        shown = received & ~((exposed > BLIND[0]) & (exposed < BLIND[1]))
        found = (xp.take_along_axis(facing, order, axis=-1) > FACING) & shown[..., None]
        noise = 0.003 * drawn[..., 2:].reshape((*ages.shape, SLOTS, 3))
        place = xp.where(found[..., None], xp.take_along_axis(place, order[..., None], axis=-2) + noise, 0.0)
        normal = xp.where(found, xp.take_along_axis(normal, order, axis=-1), 0.0)
        return p.Frames(received, xp.where(received, ages, 0.0), found, place, normal)

    def _crossings(self, target: FourPlates, time: Array, position: Array, velocity: Array) -> tuple[Array, ...]:
        """Return where a pellet crosses the plane of each plate from its front: miss B + (4, 2), time and whether."""
        xp = namespace(position)
        flown = 0.0 * (time[..., None] + position[..., :1]) + xp.zeros_like(target.at(time).normal_yaw)
        for _ in range(4):
            # Each plate at its own time: four times of all plates, of which the diagonal counts.
            asked = target.at(xp.moveaxis(time[..., None] + flown, -1, 0))
            place = xp.moveaxis(xp.diagonal(asked.position, axis1=0, axis2=-2), -1, -2)
            normal = xp.diagonal(asked.normal_yaw, axis1=0, axis2=-1)
            # Flat fire doesn't change under a turn about the vertical: x is turned against each plate's normal.
            cos, sin = xp.cos(normal), xp.sin(normal)
            vectors = (xp.moveaxis(v, -1, 0) for v in (position[..., None, :], velocity[..., None, :], place))
            turned = [(-cos * x - sin * y, sin * x - cos * y, z + 0.0 * cos) for x, y, z in vectors]
            start, speed, plate = (xp.stack(each, axis=-1) for each in turned)
            front = (speed[..., 0] > 1.0) & (plate[..., 0] > start[..., 0])
            safe = xp.concat([xp.where(front, speed[..., 0], 1.0)[..., None], speed[..., 1:]], axis=-1)
            depth = xp.where(front, plate[..., 0], start[..., 0] + 1.0)
            crossing = flat_fire_crossing(start, safe, depth, self.muzzle.drag)
            front = front & (crossing.time < 1.0)  # the plane of a plate seen edge on is crossed far away
            flown = xp.where(front, crossing.time, 0.0)
        return xp.stack([crossing.lateral, crossing.height], axis=-1) - plate[..., 1:], flown, front


@tree()
class GatedTracker(ConstantVelocity):
    """Begins with a detection that is far from the prediction: another plate has turned up."""

    gate: Array  # [m], ()

    def update(self, state: AgedTrack, seen: Detection) -> AgedTrack:
        """Update with a detection, or begin with it."""
        begun = moved(begin_track(self.noise, seen.place - seen.own, seen.fresh | True), seen.own)
        far = seen.fresh & (seen.distance > self.gate)
        return select(far, AgedTrack(begun, seen.age), super().update(state, seen))


@tree()
class PatientAim(DirectAim):
    """Holds fire where there was no detection for a while."""

    patience: Array  # [s], ()

    def step(self, state: AgedTrack, seen: p.Seen) -> tuple[AgedTrack, p.Command]:
        """Decide."""
        state, command = super().step(state, seen)
        return state, command._replace(fire=state.age < self.patience)


def build() -> tuple[ConformanceWorld, DirectAim]:
    """Return the world and a controller that aims at the nearest plate."""
    robot, period = Robot.paper(), 0.02
    parts = robot.gimbal(period), robot.muzzle_model(), robot.command_limits(Task(motion="paper"))
    tracker = GatedTracker(TrackerNoise(12.0, 0.004, 0.004, 0.0, 0.0, 2.0), 1.0, gate=0.2)
    controller = PatientAim(tracker, *parts[1:], lead=period + 0.012, period=period, patience=0.3)
    return single_precision((ConformanceWorld(period, *parts, name="conformance"), controller))


def engagements(batch: tuple[int, ...], decisions: int, seed: int = 0) -> tuple[p.Engagement, Array]:
    """Return engagements with robots 2.5–4 m ahead, and the normals of all decisions."""
    rng = np.random.default_rng(seed)
    low = [2.5, -0.3, -0.1, -0.6, -0.3, 0.0, 0.0, -3.0, 0.2]
    drawn = rng.uniform(low, [4.0, 0.8, 0.2, 0.6, 1.5, 0.0, 6.28, 3.0, 0.3], (*batch, 9))
    target, still = FourPlates(drawn[..., :3], drawn[..., 3:6], drawn[..., 6:]), np.zeros((*batch, 2))
    met = single_precision(p.Engagement(target, still, np.zeros(batch, np.int32), np.full(batch, 2.0)))
    return met, rng.standard_normal((*batch, decisions, 3 + PER_FRAME * 3), dtype=np.float32)

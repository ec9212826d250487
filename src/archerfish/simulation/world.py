"""The simulated world: gimbal, pellet and target as pure functions on batches of engagements.

One decision: the command is limited and held for a period, then a pellet is fired at the gimbal's angles at its end,
if the command says so, and scored where it crosses the plate's plane. A robot without a sensing record has immediate
and perfect camera, link and feedback, as in the paper; one with it has those of `camera`.
"""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from typing import Any, NamedTuple, Protocol

import numpy as np

from archerfish.arrays import Array, lift, map_arrays, namespace, single_precision, tree
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.delayed_axis import delayed_gimbal, longest_wait
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_draws, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import NORMALS as PELLET_NORMALS
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.errors import InputError
from archerfish.protocols import Barrel, Base, Command, Engagement, Frames, GimbalFeedback, Seen, Shot, Truth
from archerfish.records.muzzle import MuzzleRecord
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.camera import LinkedHardware, Sensing, jittered, plate_place, sensing_from_record
from archerfish.targets.motion import BEGIN_S
from archerfish.task import Task, TaskLike

CROSSING_ROUNDS = 3
"""Rounds of the search for the plane that a pellet crosses; each shrinks the error by the ratio of the two speeds."""
SLOWEST = 1e-3
"""Share of the muzzle speed towards the plate with which a pellet is taken to reach it."""
OUT = -1e3
"""Margin without pellet or crossing [m]: finite, so that a mean or a reward of margins needs no mask."""
OLDEST_FEEDBACK_S = 0.25
"""Age beyond which feedback is of no use to any controller [s]."""


class Hardware(Protocol):
    """Axes, camera and link of a world; what is in a state is the hardware's own."""

    normals: int  # standard normals that a decision takes, the pellet's first

    @property
    def plants(self) -> int:
        """Number of posterior draws."""

    def begin(self, engagement: Engagement, time: Array, normals: Array) -> Any:
        """Begin with the gimbal at rest, shape B."""

    def step(self, state: Any, engagement: Engagement, command: Array, time: Array, normals: Array) -> Any:
        """Let a period pass under a command, until `time`; shape B."""

    def feedback(self, state: Any, engagement: Engagement) -> GimbalFeedback:
        """Return the latest feedback, shape B."""

    def frames(self, state: Any, time: Array) -> Frames:
        """Return the frames since the last decision, shape B."""

    def angle_and_rate(self, state: Any, engagement: Engagement) -> tuple[Array, Array]:
        """Return true pitch and yaw within the stops [rad] and their rates [rad/s], shape B + (2,) each."""


class ImmediateState(NamedTuple):
    """What axes and camera of running engagements remember."""

    axes: Array  # B + (2, m)
    place: Array  # of the plate now [m], B + (3,)


@tree()
class ImmediateHardware:
    """Axes whose commands act at once, feedback without age, a camera without noise: the paper's."""

    gimbal: GimbalModel  # (2, ...), or (k, 2, ...) for k posterior draws
    low: Array  # mechanical stops [rad], (2,)
    high: Array  # mechanical stops [rad], (2,)

    normals = PELLET_NORMALS + 3
    """Three of a decision's normals are unused, so that draws are those of earlier results."""

    @property
    def plants(self) -> int:
        """Number of posterior draws."""
        return int(self.gimbal.input.shape[0]) if self.gimbal.input.ndim == 3 else 1

    def begin(self, engagement: Engagement, time: Array, normals: Array) -> ImmediateState:  # noqa: ARG002
        """Begin with the gimbal at rest, shape B."""
        return ImmediateState(rest_state(self._plant(engagement), engagement.start), plate_place(engagement, time))

    def step(
        self,
        state: ImmediateState,
        engagement: Engagement,
        command: Array,
        time: Array,
        normals: Array,  # noqa: ARG002
    ) -> ImmediateState:
        """Let a period pass under a command, until `time`; shape B."""
        return ImmediateState(advance(self._plant(engagement), state.axes, command), plate_place(engagement, time))

    def feedback(self, state: ImmediateState, engagement: Engagement) -> GimbalFeedback:
        """Return the angles and rates of now, shape B."""
        angle, rate = self.angle_and_rate(state, engagement)
        return GimbalFeedback(angle, rate, 0.0 * angle[..., 0])

    def frames(self, state: ImmediateState, time: Array) -> Frames:
        """Return a frame of now, F = S = 1, shape B."""
        xp, zero = namespace(state.place), namespace(state.place).zeros_like(time)
        received = (zero == 0.0)[..., None]
        yaw = zero[..., None, None] + xp.pi
        return Frames(received, zero[..., None], received[..., None], state.place[..., None, None, :], yaw)

    def angle_and_rate(self, state: ImmediateState, engagement: Engagement) -> tuple[Array, Array]:
        """Return pitch and yaw within the stops [rad] and their rates [rad/s], shape B + (2,) each."""
        plant = self._plant(engagement)
        angle = gimbal_angle(plant, state.axes)
        angle = namespace(angle).clip(angle, lift(self.low, angle), lift(self.high, angle))
        return angle, gimbal_rate(plant, state.axes)

    def _plant(self, engagement: Engagement) -> GimbalModel:
        if self.gimbal.input.ndim == 2:
            return self.gimbal
        return GimbalModel(*(field[engagement.plant] for field in self.gimbal))


class WorldState(NamedTuple):
    """Running engagements."""

    hardware: Any  # ImmediateState or LinkedState
    command: Array  # in force, or sent last [rad], B + (2,)
    command_rate: Array  # at which it was reached [rad/s], B + (2,)
    time: Array  # since the engagement began [s], B
    engagement: Engagement


@tree(left_out=("name",))
class SimulatedWorld:
    """The world of a robot and a task: one plate, one camera, a base at rest."""

    period: Array  # of decisions [s], ()
    hardware: Hardware  # immediate or linked
    model: GimbalModel  # best estimate of the axes with the mean latency of commands, (2, ...)
    muzzle: Muzzle  # best estimate, ()
    muzzles: Muzzle | None  # k draws, (k,); None: the best estimate for all
    limits: CommandLimits
    hit_radius: Array  # largest miss distance that hits [m], ()
    name: str = ""  # by which results call it

    compiled = True

    def __repr__(self) -> str:
        hardware = type(self.hardware).__name__
        return f"SimulatedWorld(robot {self.name}, {hardware}, plants {self.plants}, normals {self.normals})"

    @property
    def period_s(self) -> float:
        """Decision period [s]."""
        return float(self.period)

    @property
    def normals(self) -> int:
        """Standard normals that a decision takes."""
        return int(self.hardware.normals)

    @property
    def plants(self) -> int:
        """Number of posterior draws that engagements choose from."""
        return int(self.hardware.plants)

    def begin(self, engagement: Engagement, normals: Array) -> WorldState:
        """Begin engagements; see `World.begin`."""
        start = engagement.start
        time = 0.0 * start[..., 0]
        # The first detection's noise comes from the last decision, whose own nobody sees: it must not repeat.
        hardware = self.hardware.begin(engagement, time, normals[..., -1, :])
        return WorldState(hardware, start, 0.0 * start, time, engagement)

    def see(self, state: WorldState) -> Seen:
        """Return what a controller sees now, shape B."""
        xp, zero = namespace(state.time), namespace(state.time).zeros_like(state.time)
        origin = xp.stack([zero] * 3, axis=-1)
        return Seen(
            elapsed=xp.where(state.time > 0.0, self.period, zero),
            gimbal=self.hardware.feedback(state.hardware, state.engagement),
            command=state.command,
            frames=self.hardware.frames(state.hardware, state.time),
            base=Base(origin, origin, zero, zero),
            barrel=Barrel(zero + self.muzzle.speed, zero + 1e6),
        )

    def step(self, state: WorldState, command: Command, normals: Array) -> tuple[WorldState, Shot]:
        """Hold a command for a period, then fire if it says so; see `World.step`."""
        before, engagement = state.command, state.engagement
        target = line_of_sight(state.hardware.place)
        asked = limit_command(self.limits, command.angle, before, state.command_rate, target, self.period)
        time = state.time + self.period
        hardware = self.hardware.step(state.hardware, engagement, asked, time, normals)
        following = WorldState(hardware, asked, (asked - before) / self.period, time, engagement)
        angle, rate = self.hardware.angle_and_rate(hardware, engagement)
        return following, self.shoot(engagement, time, angle, rate, command.fire, normals)

    def shoot(
        self, engagement: Engagement, time: Array, angle: Array, rate: Array, fire: Array, normals: Array
    ) -> Shot:
        """Return what becomes of a pellet that is fired at some angles.

        The plate moves while the pellet flies, so its plane x = const is found by iteration.

        Args:
          engagement: target and muzzle, shape B.
          time: of the shot since the engagement began [s], shape B or (N,) + B, as of all arguments below.
          angle: pitch and yaw of the gimbal [rad], shape ... + (2,).
          rate: their rates [rad/s], shape ... + (2,).
          fire: whether there is a pellet, shape ....
          normals: of the decision, shape ... + (normals,).
        """
        xp, muzzle = namespace(angle), self.muzzle_of(engagement)
        if muzzle.speed.ndim < time.ndim and muzzle.speed.ndim:
            muzzle = map_arrays(lambda field: field[(None,) * (time.ndim - muzzle.speed.ndim)], muzzle)
        position, velocity = pellet_at_muzzle(muzzle, angle, rate, normals[..., :PELLET_NORMALS])
        # A pellet that flies backwards crosses no plate. Replaced before any arithmetic, which has no value for it.
        forward = velocity[..., 0] > SLOWEST * muzzle.speed
        velocity = xp.where(forward[..., None], velocity, xp.abs(velocity) + lift(muzzle.speed[..., None], velocity))
        plate = plate_place(engagement, time)
        crossing = flat_fire_crossing(position, velocity, plate[..., 0], muzzle.drag)
        for _ in range(CROSSING_ROUNDS):
            plate = plate_place(engagement, time + crossing.time)
            crossing = flat_fire_crossing(position, velocity, plate[..., 0], muzzle.drag)
        miss = xp.stack([crossing.lateral - plate[..., 1], crossing.height - plate[..., 2]], axis=-1)
        # A square root has no gradient at zero: the guard is below a float32's last place of any miss that matters.
        margin = self.hit_radius - xp.sqrt(xp.sum(miss**2, axis=-1) + 1e-20)
        return scored(fire, 0.0 * time, miss, margin, forward & (crossing.time > 0.0), crossing.time, angle)

    def muzzle_of(self, engagement: Engagement) -> Muzzle:
        """Return the muzzle of each engagement, shape () or B."""
        return self.muzzle if self.muzzles is None else Muzzle(*(field[engagement.plant] for field in self.muzzles))

    def truth(self, engagement: Engagement) -> Truth:
        """Return the target's path and the best estimates of the rest."""
        return Truth(engagement.target, self.model, self.muzzle)


def scored(
    fire: Array, plate: Array, miss: Array, margin: Array, crosses: Array, flight_time: Array, angle: Array
) -> Shot:
    """Return a shot by the rules of `Shot`, from what was computed for every decision; shapes as there."""
    xp, nan = namespace(miss), float("nan")
    return Shot(
        fire,
        xp.where(fire, xp.astype(plate, xp.int32), xp.asarray(-1, dtype=xp.int32)),
        xp.where(fire[..., None], xp.where(crosses[..., None], miss, -OUT), nan),
        xp.where(fire & crosses, margin, OUT),
        xp.where(fire & crosses, flight_time, nan),
        angle,
    )


def make_world(robot: RobotLike = None, task: TaskLike = "any") -> SimulatedWorld:
    """Build the simulator of a robot for a task, in float32.

    Args:
      robot: a robot or its folder, the paper's if not given; posterior draws and intervals become draws that
        engagements choose from.
      task: decision period, command limit and hit radius: a task, its name or its file.

    Raises:
      InputError: if a plant does not fit the decision period, or feedback is older than a controller can use.
    """
    robot, task = Robot.of(robot), Task.of(task)
    period, limits = task.period_s, robot.limits
    for axis, angle in zip(("pitch", "yaw"), task.start, strict=True):
        lowest, highest = getattr(limits, axis).ends
        if not lowest <= angle <= highest:
            between = f"{lowest:.3g}…{highest:.3g} rad"
            raise InputError(f"the task begins at a {axis} of {angle:g} rad, expected {between}, as of {robot.name}")
    low, high = np.array([limits.pitch.ends, limits.yaw.ends]).T
    hardware: Hardware
    if robot.sensing is None:
        draws = gimbal_draws(robot.pitch, robot.yaw, period)
        draws = draws if len(draws.input) > 1 else GimbalModel(*(field[0] for field in draws))
        hardware, muzzles = ImmediateHardware(draws, low, high), None
    else:
        gimbal = delayed_gimbal(robot.pitch, robot.yaw, period)
        count = len(gimbal.rest)
        sensing = sensing_from_record(robot.sensing, count)
        latest = np.max(jittered(sensing.command_latency, sensing.command_jitter, np.full(count, np.inf)))
        queue = longest_wait(gimbal, float(latest) / float(gimbal.tick))
        hardware = LinkedHardware(gimbal, sensing, low, high, queue, _periods_back(sensing, period))
        muzzles = muzzle_draws(robot.muzzle, count)
    world = SimulatedWorld(
        period=np.asarray(period),
        hardware=hardware,
        model=robot.gimbal(period),
        muzzle=robot.muzzle_model(),
        muzzles=muzzles,
        limits=robot.command_limits(task),
        hit_radius=np.asarray(task.hit_radius_m),
        name=robot.name,
    )
    built: SimulatedWorld = single_precision(world)
    return built


def _periods_back(sensing: Sensing, period: float) -> int:
    """Return how many periods back the world must remember the axes for the oldest feedback."""
    seen = jittered(sensing.latency, sensing.latency_jitter, np.full(len(sensing.latency), np.inf))
    if (age := float(np.max(seen + sensing.frame_period))) > -BEGIN_S:
        raise InputError(
            f"frames are up to {age:.3g} s old by the sensing record, expected at most {-BEGIN_S} s; a camera of more "
            "frames per second, or a quicker program, is needed"
        )
    latency = jittered(sensing.feedback_latency, sensing.feedback_jitter, np.full(len(sensing.latency), np.inf))
    oldest = float(np.max(latency + sensing.feedback_period))
    if oldest > OLDEST_FEEDBACK_S:
        raise InputError(
            f"feedback is up to {oldest:.3g} s old by the sensing record, expected at most {OLDEST_FEEDBACK_S} s; have "
            "the gimbal report more often, or repair its link"
        )
    return max(2, int(np.ceil(oldest / period - 1e-6)))


def muzzle_draws(record: MuzzleRecord, count: int) -> Muzzle:
    """Draw muzzles from the intervals of a record; the best estimate where it has none.

    Args:
      record: the muzzle.
      count: k draws; a single one is the best estimate.

    Returns:
      Fields of shape (k,) and (k, 2).
    """
    generator = np.random.default_rng([0, 58])

    def drawn(name: str) -> Array:
        low, high = record.intervals.get(name, (0.0, 0.0))
        normals = generator.standard_normal(count) if count > 1 else np.zeros(count)
        values = getattr(record, name) + (high - low) / (2 * 1.96) * normals
        return values if name.endswith("_offset") else np.maximum(values, 0.0)

    offset = np.stack([drawn("pitch_offset"), drawn("yaw_offset")], axis=-1)
    sd = np.stack([drawn("pitch_sd"), drawn("yaw_sd")], axis=-1)
    return Muzzle(drawn("speed"), drawn("speed_sd"), offset, sd, drawn("drag"), drawn("length"))

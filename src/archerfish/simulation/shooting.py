"""The shooting world: gimbal, pellet and target as pure functions on batches of engagements.

One decision: the command is limited and held for a period, then a pellet is fired at the gimbal's angles at its end,
if the command says so, and scored where it crosses the armor's x. Array-generic, so one compiled program steps
thousands of engagements.

Camera and link are immediate here, as in the paper; `identified` has the world of a robot whose are not.
"""

from typing import NamedTuple

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.linear_axis import GimbalModel, advance, gimbal_angle, gimbal_rate, rest_state
from archerfish.dynamics.muzzle import DRAWS as MUZZLE_DRAWS
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.sensing.interfaces import Command, Engagement, Seen, Shot, Truth, without_withheld
from archerfish.targets.motion import TargetMotion

DRAWS = MUZZLE_DRAWS + 3
"""Standard normals per step: the muzzle's, then three for the noise of the seen position in x, y and z."""
_CROSSING_ROUNDS = 3


class ShootingState(NamedTuple):
    """What the world knows of running engagements."""

    gimbal: Array
    """State of the axes, shape B + (2, m)."""
    command: Array
    """Command in force [rad], shape B + (2,)."""
    command_rate: Array
    """Rate at which it was reached [rad/s], shape B + (2,)."""
    plate: Array
    """Armor as seen now [m], shape B + (3,)."""
    time: Array
    """Since the engagement began [s], shape B."""
    engagement: Engagement
    """Whom we meet, and with which plant."""


class ShootingWorld(NamedTuple):
    """The shooting world and its parameters; a pytree, so it may be an argument of a compiled function."""

    period: Array
    """Decision period [s], shape ()."""
    gimbal: GimbalModel
    """Plant over one period, shape (2, ...), or (k, 2, ...) for k posterior draws."""
    muzzle: Muzzle
    """The muzzle, shape ()."""
    limits: CommandLimits
    """What the gimbal may be asked."""
    angle_low: Array
    """Mechanical stops [rad], shape (2,)."""
    angle_high: Array
    """Mechanical stops [rad], shape (2,)."""
    position_noise: Array
    """Standard deviation of the seen position along and across the line of sight [m], shape (2,)."""

    @property
    def period_s(self) -> float:
        """Decision period [s]."""
        return float(self.period)

    @property
    def pure(self) -> bool:
        """The simulation may be traced and compiled."""
        return True

    @property
    def plants(self) -> int:
        """Number of draws of what is not known exactly."""
        return int(self.gimbal.input.shape[0]) if self.gimbal.input.ndim == 3 else 1

    @property
    def normals(self) -> int:
        """Standard normals that a step needs."""
        return DRAWS

    def reset(self, engagements: Engagement, draws: Array) -> tuple[tuple[ShootingState, Array, Array], Seen]:
        """Begin engagements.

        Args:
          engagements: whom to meet, shape B.
          draws: standard normals of all steps, shape B + (T, DRAWS).
        """
        # The noise of the first sight comes from the last step, whose own nobody sees: it must not repeat in the next.
        state = self.begin(engagements, draws[..., -1, :])
        return (state, draws, namespace(draws).asarray(0)), self.see(state)

    def step(
        self, state: tuple[ShootingState, Array, Array], command: Command
    ) -> tuple[tuple[ShootingState, Array, Array], Seen, Shot]:
        """Hold a command for one period, then fire if it says so, in engagements of any shape B."""
        shooting, draws, index = state
        shooting, shot = self.shoot(shooting, command, draws[..., index, :])
        return (shooting, draws, index + 1), self.see(shooting), shot

    def begin(self, engagement: Engagement, draws: Array) -> ShootingState:
        """Begin engagements with the gimbal at rest.

        Args:
          engagement: whom to meet, shape B.
          draws: standard normals, shape B + (DRAWS,).
        """
        xp = namespace(engagement.start, draws)
        start = engagement.start
        time = xp.zeros(start.shape[:-1], dtype=start.dtype)
        return ShootingState(
            gimbal=rest_state(plant_of(self, engagement), start),
            command=start,
            command_rate=xp.zeros_like(start),
            plate=_seen_plate(self, engagement.motion, time, draws),
            time=time,
            engagement=engagement,
        )

    def see(self, state: ShootingState) -> Seen:
        """Return what a controller sees now; feedback and camera are immediate in this world."""
        xp = namespace(state.gimbal)
        plant = plant_of(self, state.engagement)
        zero = xp.zeros_like(state.time)
        return Seen(
            elapsed=xp.where(state.time > 0.0, self.period, zero),
            angle=_within_stops(self, gimbal_angle(plant, state.gimbal)),
            rate=gimbal_rate(plant, state.gimbal),
            gimbal_age=zero,
            command=state.command,
            plate=state.plate[..., None, :],
            normal_yaw=zero[..., None],
            plate_age=zero[..., None],
            fresh=zero[..., None] == 0.0,
            base=xp.stack([zero] * 4, axis=-1),
            muzzle_speed=zero + self.muzzle.speed,
            heat_left=zero + 1e6,
        )

    def shoot(self, state: ShootingState, command: Command, draws: Array) -> tuple[ShootingState, Shot]:
        """Hold a command for one period, then fire if it says so.

        Args:
          state: running engagements.
          command: what the controller asks, before the limits.
          draws: standard normals, shape B + (DRAWS,).
        """
        sight = line_of_sight(state.plate)
        angle = limit_command(self.limits, command.angle, state.command, state.command_rate, sight, self.period)
        plant = plant_of(self, state.engagement)
        gimbal = advance(plant, state.gimbal, angle)
        time = state.time + self.period
        motion = state.engagement.motion
        following = ShootingState(
            gimbal=gimbal,
            command=angle,
            command_rate=(angle - state.command) / self.period,
            plate=_seen_plate(self, motion, time, draws),
            time=time,
            engagement=state.engagement,
        )
        position, velocity = self.pellet(following, draws)
        miss, flight_time = miss_at_armor(self.muzzle, motion, time, position, velocity)
        pointing = _within_stops(self, gimbal_angle(plant, gimbal))
        return following, without_withheld(Shot(command.fire, miss, flight_time, pointing))

    def pellet(self, state: ShootingState, draws: Array) -> tuple[Array, Array]:
        """Return position [m] and velocity [m/s] of a pellet that is fired now, shape B + (3,) each.

        Args:
          state: running engagements.
          draws: standard normals, shape B + (DRAWS,).
        """
        plant = plant_of(self, state.engagement)
        pointing = _within_stops(self, gimbal_angle(plant, state.gimbal))
        return pellet_at_muzzle(self.muzzle, pointing, gimbal_rate(plant, state.gimbal), draws[..., :MUZZLE_DRAWS])

    def truth(self, engagements: Engagement) -> Truth:
        """Return what the oracle may know."""
        return Truth(engagements.motion, plant_of(self, engagements), self.muzzle)


def plant_of(world: ShootingWorld, engagement: Engagement) -> GimbalModel:
    """Return the plant of each engagement: the only one, or the posterior draw that the engagement names."""
    if world.gimbal.input.ndim == 2:
        return world.gimbal
    return GimbalModel(*(array[engagement.plant] for array in world.gimbal))


def miss_at_armor(
    muzzle: Muzzle, motion: TargetMotion, fired_at: Array, position: Array, velocity: Array
) -> tuple[Array, Array]:
    """Distance of a pellet from the armor where they have the same x, the vector whose length eq (8) negates.

    The armor moves while the pellet flies, so its plane is found by iteration; a round shrinks the error by the ratio
    of the two speeds.

    Args:
      muzzle: its drag is used.
      motion: the armor's path, shape B.
      fired_at: time of the shot [s], shape B.
      position: of the muzzle [m], shape B + (3,).
      velocity: of the pellet [m/s], shape B + (3,).

    Returns:
      Pellet minus armor in y and z [m], shape B + (2,); time of flight [s], shape B.
    """
    xp = namespace(position, velocity)
    armor = motion.position(fired_at)
    crossing = flat_fire_crossing(position, velocity, armor[..., 0], muzzle.drag)
    for _ in range(_CROSSING_ROUNDS):
        armor = motion.position(fired_at + crossing.time)
        crossing = flat_fire_crossing(position, velocity, armor[..., 0], muzzle.drag)
    miss = xp.stack([crossing.lateral - armor[..., 1], crossing.height - armor[..., 2]], axis=-1)
    return miss, crossing.time


def miss_distance(miss: Array) -> Array:
    """Distance between pellet and armor [m], shape B + (2,) → B; eq (8) is its negative."""
    xp = namespace(miss)
    return xp.sqrt(xp.sum(miss**2, axis=-1))


def _within_stops(world: ShootingWorld, angle: Array) -> Array:
    return namespace(angle).clip(angle, lift(world.angle_low, angle), lift(world.angle_high, angle))


def _seen_plate(world: ShootingWorld, motion: TargetMotion, time: Array, draws: Array) -> Array:
    """Return the armor's position with noise along and across the line of sight, shape B + (3,)."""
    xp = namespace(draws)
    place = motion.position(time)
    distance = xp.sqrt(xp.sum(place**2, axis=-1, keepdims=True))
    along = place / distance
    noise = draws[..., MUZZLE_DRAWS:]
    radial = xp.sum(noise * along, axis=-1, keepdims=True) * along
    return place + world.position_noise[0] * radial + world.position_noise[1] * (noise - radial)

"""The shooting world of an identified robot: commands come late, what is seen is old, and little is known exactly.

Every engagement has a draw of its own of what the logs leave open: the axes, the delays of link and camera, the error
of the camera's time offset, the muzzle's speed and boresight.
"""

from typing import NamedTuple

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import Array, lift, namespace
from archerfish.dynamics.command_limits import CommandLimits, limit_command
from archerfish.dynamics.delayed_gimbal import (
    DelayedGimbal,
    DelayedState,
    angle_and_rate,
    rest_under,
    run,
    send,
)
from archerfish.dynamics.linear_axis import GimbalModel
from archerfish.dynamics.muzzle import DRAWS as MUZZLE_DRAWS
from archerfish.dynamics.muzzle import Muzzle, pellet_at_muzzle
from archerfish.sensing.camera import DRAWS as SENSING_DRAWS
from archerfish.sensing.camera import Sensing, Sight, feedback_age, first_sight, jittered, next_sight, phase, quantised
from archerfish.sensing.interfaces import Command, Engagement, Seen, Shot, Truth, without_withheld
from archerfish.simulation.shooting import miss_at_armor

DRAWS = MUZZLE_DRAWS + SENSING_DRAWS
"""Standard normals per step: the muzzle's, then those of camera and link."""


class IdentifiedState(NamedTuple):
    """What the world knows of running engagements."""

    gimbal: DelayedState
    """Axes and commands on their way."""
    before: tuple[DelayedState, ...]
    """The same just after each of the last decisions, oldest first."""
    angle: Array
    """Latest feedback [rad], shape B + (2,)."""
    rate: Array
    """Its rates [rad/s], shape B + (2,)."""
    gimbal_age: Array
    """Time since it was sampled [s], shape B."""
    command: Array
    """Command sent last [rad], shape B + (2,)."""
    command_rate: Array
    """Rate at which it was reached [rad/s], shape B + (2,)."""
    sight: Sight
    """Latest frame of the camera."""
    phases: Array
    """Of camera and feedback against the decisions, 0…1, shape B + (2,)."""
    time: Array
    """Since the engagement began [s], shape B."""
    engagement: Engagement
    """Whom we meet, and which draw."""


class IdentifiedWorld(NamedTuple):
    """The world of an identified robot; a pytree, so it may be an argument of a compiled function."""

    period: Array
    """Decision period [s], shape ()."""
    gimbal: DelayedGimbal
    """The axes, k draws."""
    sensing: Sensing
    """Camera and link, k draws."""
    muzzles: Muzzle
    """The muzzle, k draws."""
    muzzle: Muzzle
    """Its best estimate, shape ()."""
    model: GimbalModel
    """Best estimate of the axes with the mean latency of the commands, shape (2, ...)."""
    limits: CommandLimits
    """What the gimbal may be asked."""
    angle_low: Array
    """Mechanical stops [rad], shape (2,)."""
    angle_high: Array
    """Mechanical stops [rad], shape (2,)."""
    queue: Array
    """Ones for each command that may be in force or on its way, shape (Q,)."""
    past: Array
    """Ones for each period that feedback may reach back, shape (P,)."""

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
        return int(self.gimbal.rest.shape[0])

    @property
    def normals(self) -> int:
        """Standard normals that a step needs."""
        return DRAWS

    def reset(self, engagements: Engagement, draws: Array) -> tuple[tuple[IdentifiedState, Array, Array], Seen]:
        """Begin engagements.

        Args:
          engagements: whom to meet, shape B.
          draws: standard normals of all steps, shape B + (T, DRAWS).
        """
        # The noise of the first sight comes from the last step, whose own nobody sees: it must not repeat in the next.
        state = self.begin(engagements, draws[..., -1, :])
        return (state, draws, namespace(draws).asarray(0)), self.see(state)

    def step(
        self, state: tuple[IdentifiedState, Array, Array], command: Command
    ) -> tuple[tuple[IdentifiedState, Array, Array], Seen, Shot]:
        """Hold a command for one period, then fire if it says so, in engagements of any shape B."""
        engagement, draws, index = state
        engagement, shot = self.shoot(engagement, command, draws[..., index, :])
        return (engagement, draws, index + 1), self.see(engagement), shot

    def begin(self, engagement: Engagement, draws: Array) -> IdentifiedState:
        """Begin engagements with the gimbal at rest and the target in sight.

        Args:
          engagement: whom to meet, shape B.
          draws: standard normals, shape B + (DRAWS,).
        """
        xp = namespace(engagement.start, draws)
        start, noise, draw = engagement.start, draws[..., MUZZLE_DRAWS:], engagement.plant
        time = xp.zeros(start.shape[:-1], dtype=start.dtype)
        phases = phase(draws[..., :2])
        gimbal = rest_under(self.gimbal, draw, start, self.queue.shape[0])
        angle, rate = angle_and_rate(self.gimbal, draw, gimbal)
        age = feedback_age(self.sensing, draw, phases[..., 1], time, noise)
        return IdentifiedState(
            gimbal=gimbal,
            before=(gimbal,) * (self.past.shape[0] - 1),
            angle=quantised(self.sensing, draw, angle),
            rate=rate,
            gimbal_age=age,
            command=start,
            command_rate=xp.zeros_like(start),
            sight=first_sight(self.sensing, draw, phases[..., 0], engagement.motion, age, noise),
            phases=phases,
            time=time,
            engagement=engagement,
        )

    def see(self, state: IdentifiedState) -> Seen:
        """Return what a controller gets to see now."""
        xp = namespace(state.angle)
        zero = xp.zeros_like(state.time)
        return Seen(
            elapsed=xp.where(state.time > 0.0, self.period, zero),
            angle=state.angle,
            rate=state.rate,
            gimbal_age=state.gimbal_age,
            command=state.command,
            plate=state.sight.plate[..., None, :],
            normal_yaw=zero[..., None],
            plate_age=(state.time - state.sight.exposed)[..., None],
            fresh=state.sight.fresh[..., None],
            base=xp.stack([zero] * 4, axis=-1),
            muzzle_speed=zero + self.muzzle.speed,
            heat_left=zero + 1e6,
        )

    def shoot(self, state: IdentifiedState, command: Command, draws: Array) -> tuple[IdentifiedState, Shot]:
        """Send a command, let a period pass, then fire if it says so.

        Args:
          state: running engagements.
          command: what the controller asks, before the limits.
          draws: standard normals, shape B + (DRAWS,).
        """
        draw, noise = state.engagement.plant, draws[..., MUZZLE_DRAWS:]
        sight = line_of_sight(state.sight.plate)
        angle = limit_command(self.limits, command.angle, state.command, state.command_rate, sight, self.period)
        latency = jittered(self.sensing.command_latency[draw], self.sensing.command_jitter[draw], noise[..., 0])
        sent = send(self.gimbal, draw, state.gimbal, angle, latency)
        gimbal = run(self.gimbal, draw, sent, 0.0 * latency + self._ticks)
        time = state.time + self.period
        age, measured, rate = self._feedback(state, sent, time, noise)
        following = IdentifiedState(
            gimbal=gimbal,
            before=(*state.before, sent)[1:],
            angle=measured,
            rate=rate,
            gimbal_age=age,
            command=angle,
            command_rate=(angle - state.command) / self.period,
            sight=next_sight(
                self.sensing,
                draw,
                state.phases[..., 0],
                state.sight,
                time,
                state.engagement.motion,
                state.rate,
                age,
                noise,
            ),
            phases=state.phases,
            time=time,
            engagement=state.engagement,
        )
        return following, self._fire(following, command.fire, draws)

    @property
    def _ticks(self) -> int:
        return int(self.gimbal.transition.shape[1]) - 1

    def _feedback(
        self, state: IdentifiedState, sent: DelayedState, time: Array, noise: Array
    ) -> tuple[Array, Array, Array]:
        """Age of the latest feedback, and the angles and rates that it shows."""
        xp = namespace(time)
        draw = state.engagement.plant
        age = feedback_age(self.sensing, draw, state.phases[..., 1], time, noise)
        states = (*state.before, sent)
        since = xp.clip(len(states) * self._ticks - xp.round(age / self.gimbal.tick), 0.0, len(states) * self._ticks)
        begin = states[0]
        for each in states[1:]:
            later = since >= self._ticks
            since = xp.where(later, since - self._ticks, since)
            begin = _chosen(later, each, begin)
        then = run(self.gimbal, draw, begin, since)
        angle, rate = angle_and_rate(self.gimbal, draw, then)
        return age, quantised(self.sensing, draw, self._within_stops(angle)), rate

    def _fire(self, state: IdentifiedState, fired: Array, draws: Array) -> Shot:
        position, velocity = self.pellet(state, draws)
        miss, flight_time = miss_at_armor(
            self.muzzle_of(state.engagement), state.engagement.motion, state.time, position, velocity
        )
        angle, _ = angle_and_rate(self.gimbal, state.engagement.plant, state.gimbal)
        return without_withheld(Shot(fired, miss, flight_time, self._within_stops(angle)))

    def pellet(self, state: IdentifiedState, draws: Array) -> tuple[Array, Array]:
        """Return position [m] and velocity [m/s] of a pellet that is fired now, shape B + (3,) each.

        Args:
          state: running engagements.
          draws: standard normals, shape B + (DRAWS,).
        """
        angle, rate = angle_and_rate(self.gimbal, state.engagement.plant, state.gimbal)
        muzzle = self.muzzle_of(state.engagement)
        return pellet_at_muzzle(muzzle, self._within_stops(angle), rate, draws[..., :MUZZLE_DRAWS])

    def muzzle_of(self, engagement: Engagement) -> Muzzle:
        """Return the muzzle of each engagement: the draw that it names, shape B."""
        return Muzzle(*(each[engagement.plant] for each in self.muzzles))

    def _within_stops(self, angle: Array) -> Array:
        return namespace(angle).clip(angle, lift(self.angle_low, angle), lift(self.angle_high, angle))

    def truth(self, engagements: Engagement) -> Truth:
        """Return what the oracle may know: the target's path, and the best estimates of the rest."""
        return Truth(engagements.motion, self.model, self.muzzle)


def _chosen(condition: Array, state: DelayedState, other: DelayedState) -> DelayedState:
    """Choose between two states, per engagement."""
    xp = namespace(condition)
    return DelayedState(
        *(
            xp.where(xp.reshape(condition, condition.shape + (1,) * (a.ndim - condition.ndim)), a, b)
            for a, b in zip(state, other, strict=True)
        )
    )

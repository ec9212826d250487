"""The shooting world as a reinforcement-learning environment: batches of engagements that end and begin anew.

An engagement of fixed length is truncated, not terminated: the world goes on, only the watch stops. So the observation
after the last step is handed out beside the first of the next engagement, for the value to bootstrap from.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from archerfish.dynamics.array_namespace import Array, if_any, map_arrays, namespace
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.muzzle import Muzzle
from archerfish.sensing.interfaces import Command, Engagement, Seen, Shot, World, fire_always
from archerfish.sensing.observers import AnyObserver
from archerfish.simulation.reward import EQ_8, Reward, reward
from archerfish.simulation.scenario import Scenario, draw_engagement, engagement_length


class PureWorld(World, Protocol):
    """A world that can be traced and compiled, step by step with draws of its own."""

    @property
    def normals(self) -> int:
        """Standard normals that a step needs."""

    @property
    def period(self) -> Array:
        """Decision period [s], shape ()."""

    @property
    def muzzle(self) -> Muzzle:
        """The muzzle, shape ()."""

    @property
    def plants(self) -> int:
        """Number of draws of what is not known exactly."""

    @property
    def limits(self) -> CommandLimits:
        """What the gimbal may be asked."""

    def begin(self, engagement: Engagement, draws: Array) -> Any:
        """Begin engagements with standard normals, shape B + (normals,)."""

    def see(self, state: Any) -> Seen:
        """Return what a controller gets to see now."""

    def shoot(self, state: Any, command: Command, draws: Array) -> tuple[Any, Shot]:
        """Let a period pass under a command, then fire if it says so, with standard normals, shape B + (normals,)."""

    def pellet(self, state: Any, draws: Array) -> tuple[Array, Array]:
        """Return position and velocity of a pellet fired now, with the normals of its shot, shape B + (3,) each."""


class EnvironmentState(NamedTuple):
    """Running engagements of a batch."""

    shooting: Any
    """The world."""
    memory: Any
    """What the policy remembers."""
    step: Array
    """Steps since the engagement began, or since a longer one would have begun, shape (B,)."""


class Outcome(NamedTuple):
    """What one step gave; everything has shape (B,) but the observations."""

    observation: Array
    """For the next decision, of the next engagement where this one ended, shape (B, n)."""
    final_observation: Array
    """After this step, of this engagement, shape (B, n)."""
    reward: Array
    """See `archerfish.simulation.reward` [m]."""
    terminated: Array
    """Whether nothing can follow this step; never so in shooting."""
    truncated: Array
    """Whether the engagement's time is up."""
    hit: Array = np.float32(np.nan)
    """Whether the shot hit; NaN, of shape (), where that is not told."""


class Advance(NamedTuple):
    """What one step gave, before anything begins anew."""

    observation: Array
    """After this step, shape (B, n)."""
    reward: Array
    """See `archerfish.simulation.reward` [m], shape (B,)."""
    truncated: Array
    """Whether the engagement's time is up, shape (B,)."""
    miss: Array
    """Pellet minus armor in y and z [m], shape (B, 2)."""
    hit: Array
    """Whether the shot hit, shape (B,)."""


class ShootingEnvironment(NamedTuple):
    """Engagements of a scenario in a world, seen by an observer."""

    world: PureWorld
    """Where."""
    scenario: Scenario
    """Against whom."""
    observer: AnyObserver
    """Seen how."""
    length: Array
    """Decisions per engagement, shape ()."""
    reward: Reward = EQ_8
    """What a decision is worth."""
    hit_radius: Array = np.float32(0.0)
    """Largest miss that hits [m], shape ()."""
    hidden: Array = np.zeros(0, np.float32)
    """Ones for each number that the critic alone sees, shape (0,) or (HIDDEN,); see `hidden_state`."""

    @property
    def observed(self) -> int:
        """How many of an observation's numbers the policy sees; what follows them is for the critic alone."""
        return self.observer.size

    @property
    def normals(self) -> int:
        """Standard normals that a step needs per engagement."""
        return self.world.normals

    @property
    def uniforms(self) -> int:
        """Uniform draws that a step needs per engagement."""
        return self.scenario.uniforms

    def begin(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        """Begin a batch, staggered: its members are at different phases of an engagement, `PHASES` of them.

        Args:
          normals: shape (B, normals).
          uniforms: shape (B, uniforms).
        """
        xp = namespace(normals, uniforms)
        batch = normals.shape[0]
        state, observation = self.fresh(normals, uniforms)
        phases = min(PHASES, batch)
        return state._replace(step=xp.arange(batch) * phases // batch * self.length // phases), observation

    def step(
        self, state: EnvironmentState, action: Array, normals: Array, uniforms: Array
    ) -> tuple[EnvironmentState, Outcome]:
        """Advance a batch by one decision and begin anew what has ended.

        Args:
          state: running engagements.
          action: shape (B, 2).
          normals: shape (B, normals).
          uniforms: shape (B, uniforms), for the engagements that begin.
        """
        going_on, given = self.advance(state, action, normals)
        ended = given.truncated
        following, observation = if_any(
            ended,
            lambda: self.renew(going_on, given, normals, uniforms),
            lambda: (going_on, given.observation),
        )
        return following, Outcome(observation, given.observation, given.reward, ended & False, ended, given.hit)

    def advance(self, state: EnvironmentState, action: Array, normals: Array) -> tuple[EnvironmentState, Advance]:
        """Advance a batch by one decision and leave what has ended as it is, for the caller to begin anew.

        Args:
          state: running engagements.
          action: shape (B, 2).
          normals: shape (B, normals).
        """
        command = fire_always(self.observer.decode(state.memory, action))
        shooting, shot = self.world.shoot(state.shooting, command, normals)
        memory = self.observer.remember(state.memory, self.world.see(shooting))
        going_on = EnvironmentState(shooting, memory, state.step + 1)
        observation, ended = self._observation(shooting, memory), going_on.step >= self.length
        gained, hit = reward(self.reward, shot.miss, self.hit_radius)
        return going_on, Advance(observation, gained, ended, shot.miss, hit)

    def renew(
        self, state: EnvironmentState, given: Advance, normals: Array, uniforms: Array
    ) -> tuple[EnvironmentState, Array]:
        """Begin anew what has ended: state, and observations for the next decision.

        Args:
          state: engagements after a step.
          given: what that step gave.
          normals: shape (B, normals).
          uniforms: shape (B, uniforms).
        """
        begun, first = self.fresh(normals, uniforms)
        observation = namespace(first).where(given.truncated[:, None], first, given.observation)
        return _where(given.truncated, begun, state), observation

    def fresh(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        """Begin a batch, all its members at the beginning of an engagement.

        Args:
          normals: shape (B, normals).
          uniforms: shape (B, uniforms).
        """
        engagement: Engagement = draw_engagement(self.scenario, uniforms)
        shooting = self.world.begin(engagement, normals)
        memory = self.observer.begin(self.world.see(shooting))
        xp = namespace(normals)
        # A short engagement is one that has its last decisions alone.
        missing = self.scenario.lengths[..., 1] - engagement_length(self.scenario, uniforms)
        step = xp.astype(xp.round(missing / self.world.period), int)
        return EnvironmentState(shooting, memory, step), self._observation(shooting, memory)

    def _observation(self, shooting: Any, memory: Any) -> Array:
        seen = self.observer.observe(memory)
        if self.hidden.shape[0] == 0:
            return seen
        return namespace(seen).concat([seen, hidden_state(self.world.period, shooting)], axis=-1)


PHASES = 10
"""Phases of an engagement that a batch is staggered over: few, since a step in which none ends costs half as much."""
HIDDEN = 5
"""Numbers of `hidden_state`."""


def hidden_state(period: Array, shooting: Any) -> Array:
    """Return what a robot can't see and a critic may: where the target really is and will be, shape B + (HIDDEN,).

    Args:
      period: decision period [s].
      shooting: state of the world, with engagement and time of shape B.
    """
    motion, time = shooting.engagement.motion, shooting.time
    now, soon, later = (motion.position(time + ahead)[..., :2] for ahead in (0.0 * period, period, 20.0 * period))
    speed = (soon - now)[..., 1:] / period
    return namespace(now).concat([now, speed, 5.0 * (later - now)], axis=-1)


def _where(condition: Array, chosen: Array, other: Array) -> Array:
    """Choose per batch member between two equal trees of arrays, NamedTuples all the way."""
    xp = namespace(condition)
    return map_arrays(lambda a, b: xp.where(xp.reshape(condition, (-1,) + (1,) * (a.ndim - 1)), a, b), chosen, other)

"""The shooting world as a reinforcement-learning environment: batches of engagements that end and begin anew.

An engagement of fixed length is truncated, not terminated: the world goes on, only the watch stops. So the observation
after the last step is handed out beside the first of the next engagement, for the value to bootstrap from.
"""

from typing import NamedTuple

from archerfish.dynamics.array_namespace import Array, map_arrays, namespace
from archerfish.sensing.interfaces import Engagement, fire_always
from archerfish.sensing.observation import Observer, begin_memory, decode_action, observe, remember
from archerfish.simulation.scenario import UNIFORMS, Scenario, draw_engagement
from archerfish.simulation.shooting import DRAWS, ShootingState, ShootingWorld, begin, reward, see, shoot


class EnvironmentState(NamedTuple):
    """Running engagements of a batch."""

    shooting: ShootingState
    """The world."""
    memory: Array
    """What the policy remembers, shape (B, h, 7)."""
    step: Array
    """Steps since the engagement began, shape (B,)."""


class Outcome(NamedTuple):
    """What one step gave; everything has shape (B,) but the observations."""

    observation: Array
    """For the next decision, of the next engagement where this one ended, shape (B, n)."""
    final_observation: Array
    """After this step, of this engagement, shape (B, n)."""
    reward: Array
    """Eq (8) [m]."""
    terminated: Array
    """Whether nothing can follow this step; never so in shooting."""
    truncated: Array
    """Whether the engagement's time is up."""


class ShootingEnvironment(NamedTuple):
    """Engagements of a scenario in a world, seen by an observer."""

    world: ShootingWorld
    """Where."""
    scenario: Scenario
    """Against whom."""
    observer: Observer
    """Seen how."""
    length: Array
    """Decisions per engagement, shape ()."""

    @property
    def normals(self) -> int:
        """Standard normals that a step needs per engagement."""
        return DRAWS

    @property
    def uniforms(self) -> int:
        """Uniform draws that a step needs per engagement."""
        return UNIFORMS

    def begin(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        """Begin a batch, staggered: its members are at all phases of an engagement.

        Args:
          normals: shape (B, normals).
          uniforms: shape (B, uniforms).
        """
        xp = namespace(normals, uniforms)
        batch = normals.shape[0]
        state, observation = self._fresh(normals, uniforms)
        return state._replace(step=xp.arange(batch) * self.length // batch), observation

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
        command = fire_always(decode_action(self.observer, state.memory, action))
        shooting, shot = shoot(self.world, state.shooting, command, normals)
        memory = remember(self.observer, state.memory, see(self.world, shooting))
        going_on = EnvironmentState(shooting, memory, state.step + 1)
        final = observe(self.observer, memory)
        truncated = going_on.step >= self.length
        fresh, first = self._fresh(normals, uniforms)
        following = _where(truncated, fresh, going_on)
        observation = namespace(final).where(truncated[:, None], first, final)
        return following, Outcome(observation, final, reward(shot.miss), truncated & False, truncated)

    def _fresh(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        engagement: Engagement = draw_engagement(self.scenario, uniforms)
        shooting = begin(self.world, engagement, normals)
        memory = begin_memory(self.observer, see(self.world, shooting))
        step = namespace(normals).zeros(normals.shape[0], dtype=int)
        return EnvironmentState(shooting, memory, step), observe(self.observer, memory)


def _where(condition: Array, chosen: Array, other: Array) -> Array:
    """Choose per batch member between two equal trees of arrays, NamedTuples all the way."""
    xp = namespace(condition)
    return map_arrays(lambda a, b: xp.where(xp.reshape(condition, (-1,) + (1,) * (a.ndim - 1)), a, b), chosen, other)

"""The simulated world as a reinforcement-learning environment: batches of engagements that end and are replaced.

An engagement whose time is up is truncated, not terminated: its target goes on, only nobody looks. So the observation
after the last step is returned beside the first of the next engagement, for a value function to bootstrap from.
"""

from typing import Any, NamedTuple

from archerfish2.arrays import Array, namespace, select, tree, when_any
from archerfish2.controllers.policy.observer import Observer
from archerfish2.errors import InputError
from archerfish2.plugins import Plugin
from archerfish2.protocols import Command, Seen, Shot
from archerfish2.simulation.world import SimulatedWorld
from archerfish2.task import Scenario

PHASES = 10
"""Phases of an engagement that a batch is staggered over: few, since a step in which none ends costs less."""
HIDDEN = 5
"""Numbers that a critic alone may see."""
FARTHEST = -1.0
"""Smallest margin that a reward distinguishes [m]: farther off, and without a pellet, all are worth the same."""
_STEEPEST = 40.0
"""Beyond it the logistic function is 0 or 1 in float32, and its exponential would overflow."""


@tree()
class Reward:
    """What a shot is worth [m]: the distance of eq (8), and a hit.

        r = −w d + h σ(m / s),   with the step m ≥ 0 in the place of σ where s = 0

    d is the distance between pellet and plate, m the margin to the edge of the hit area. Eq (8) is w = 1, h = 0. Where
    a target may or may not turn back, the nearest place on average is one that neither hits, so a hit is worth
    something in itself. A step has no slope, though: for a trainer that follows the simulator's gradient the hit is
    smoothed, as a little more dispersion would do.
    """

    distance: Array  # w, ()
    hit: Array  # h [m], ()
    width: Array  # s [m], ()
    hit_radius: Array  # [m], ()

    def __call__(self, shot: Shot, command: Command, seen: Seen) -> Array:  # noqa: ARG002
        """Return the reward [m], shape B."""
        xp = namespace(shot.margin)
        margin = xp.maximum(shot.margin, FARTHEST)
        smooth = self.width > 0.0
        steepness = margin / xp.where(smooth, self.width, 1.0)
        likely = 1.0 / (1.0 + xp.exp(xp.clip(-steepness, -_STEEPEST, _STEEPEST)))
        worth = xp.where(smooth, likely, xp.where(margin >= 0.0, 1.0 + 0.0 * margin, 0.0 * margin))
        return self.hit * worth - self.distance * (self.hit_radius - margin)


@tree(static=("plugin",))
class UserReward:
    """A user's reward."""

    plugin: Plugin  # (shot, command, what is seen after it) → [m], shape B

    def __call__(self, shot: Shot, command: Command, seen: Seen) -> Array:
        """Return the reward [m], shape B.

        Raises:
          InputError: if the user's code fails, or returns something else.
        """
        with self.plugin.running():
            reward, expected = self.plugin.value(shot, command, seen), shot.margin.shape
            if getattr(reward, "shape", None) != expected or reward.dtype.kind != "f":
                found = f"{getattr(reward, 'dtype', type(reward).__name__)} of shape {getattr(reward, 'shape', ())}"
                raise InputError(
                    f"returns {found}, expected floats of shape {expected}, one per engagement; correct it"
                )
            return reward


class EnvironmentState(NamedTuple):
    """Running engagements."""

    world: Any  # of the world
    memory: Any  # of the observer
    left: Array  # decisions until the engagement ends, int32, B
    hidden: Array  # for a critic alone, B + (HIDDEN,), or B + (0,)


class Step(NamedTuple):
    """What a step gave."""

    observation: Array  # for the next decision, of the next engagement where this one ended, B + (n,)
    final_observation: Array  # after this step, of this engagement, B + (n,)
    hidden: Array  # for a critic alone, after this step, of this engagement, B + (HIDDEN,), or B + (0,)
    reward: Array  # [m], B
    terminated: Array  # whether nothing can follow: never so, bool, B
    truncated: Array  # whether the engagement's time is up, bool, B
    shot: Shot


@tree(static=("sees_truth",))
class Environment:
    """Engagements of a task in a world, as an observer sees them; batch shape B = (N,)."""

    world: SimulatedWorld
    scenario: Scenario
    observer: Observer
    reward: Any  # Reward or UserReward
    sees_truth: bool  # whether states and steps have `HIDDEN` numbers for a critic alone, never in an observation

    @property
    def normals(self) -> int:
        """Standard normals that a step takes."""
        return self.world.normals

    @property
    def uniforms(self) -> int:
        """Uniform draws that an engagement takes."""
        return self.scenario.uniforms

    def begin(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        """Begin a batch, staggered: its first engagements are cut to different lengths, `PHASES` of them.

        Args:
          normals: shape (N, normals).
          uniforms: shape (N, uniforms).

        Returns:
          State, and observations of shape (N, n).
        """
        xp, count = namespace(normals, uniforms), normals.shape[0]
        state, observation = self.fresh(normals, uniforms)
        phases = min(PHASES, count)
        phase = xp.asarray(xp.arange(count) * phases // count, dtype=xp.int32)
        return state._replace(left=state.left - phase * state.left // phases), observation

    def fresh(self, normals: Array, uniforms: Array) -> tuple[EnvironmentState, Array]:
        """Begin a batch, not staggered; see `begin` for arguments, shapes and result."""
        xp, engagement = namespace(normals, uniforms), self.scenario.draw(uniforms)
        world = self.world.begin(engagement, normals[..., None, :])
        memory = self.observer.begin(self.world.see(world))
        left = xp.astype(xp.round(engagement.duration / self.world.period), xp.int32)
        observation = self._observation(memory)
        return EnvironmentState(world, memory, left, self._hidden(world, observation)), observation

    def step(
        self, state: EnvironmentState, action: Array, normals: Array, fresh: tuple[EnvironmentState, Array]
    ) -> tuple[EnvironmentState, Step]:
        """Advance a batch by one decision and replace what has ended.

        Args:
          state: running engagements.
          action: shape (N, 2); zero aims at the target as estimated now.
          normals: shape (N, normals).
          fresh: what ended engagements are replaced by, as from `fresh`: once, so not in two steps of one member.
        """
        command = self.observer.decode(self.observer.view(state.memory), action)
        world, shot = self.world.step(state.world, command, normals)
        seen = self.world.see(world)
        memory = self.observer.remember(state.memory, seen)
        observation, left = self._observation(memory), state.left - 1
        hidden, ended = self._hidden(world, observation), left <= 0
        running = EnvironmentState(world, memory, left, hidden), observation
        after = when_any(ended, lambda new, old: select(ended, new, old), fresh, running)
        reward = self.reward(shot, command, seen)
        return after[0], Step(after[1], observation, hidden, reward, ended & False, ended, shot)

    def _observation(self, memory: Any) -> Array:
        return self.observer.observe(self.observer.view(memory))

    def _hidden(self, world: Any, observation: Array) -> Array:
        """Return where the target really is and will be, which no robot can see, shape B + (HIDDEN,), or B + (0,)."""
        if not self.sees_truth:
            return observation[..., :0]
        xp, target, time, period = namespace(world.time), world.engagement.target, world.time, self.world.period
        now, soon, later = (
            target.at(time + ahead).position[..., 0, :2] for ahead in (0.0 * period, period, 20.0 * period)
        )
        return xp.concat([now, (soon - now)[..., 1:] / period, 5.0 * (later - now)], axis=-1)

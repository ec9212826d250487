"""The environment that `train` trains in: batches of engagements that end and are replaced.

An engagement whose time is up is truncated, not terminated: its target goes on, only nobody looks. So the observation
after the last step is returned beside the first of the next engagement, for a value function to bootstrap from.
"""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, namespace, select, single_precision, tree, when_any
from archerfish.controllers.policy.observation import make_observer, observer_facts
from archerfish.controllers.policy.observer import Observer
from archerfish.learning.config import ConfigLike, TrainConfig
from archerfish.learning.reward import RewardFunction, UserReward, make_reward
from archerfish.protocols import Seen, Shot
from archerfish.robot import Robot, RobotLike
from archerfish.simulation.camera import with_open_nearness
from archerfish.simulation.world import SimulatedWorld, make_world
from archerfish.task import DRAWN, Scenario, Task, TaskLike

PHASES = 10
"""Phases of an engagement that a batch is staggered over: few, since a step in which none ends costs less."""
HIDDEN = 5
"""Numbers that a critic alone may see."""


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
    reward: RewardFunction
    sees_truth: bool  # whether states and steps have `HIDDEN` numbers for a critic alone, never in an observation

    def __repr__(self) -> str:
        motion = getattr(self.scenario.motion, "name", self.scenario.motion)  # a user's, or one of ours
        names = ", ".join(getattr(block, "__name__", type(block).__name__) for block in self.observer.blocks)
        draws = f"draws of (N, {self.normals}) normals and (N, {self.uniforms}) uniforms"
        return f"Environment(targets {motion}, robot {self.world.name}, observation {names}, {draws})"

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
        seen = self.world.see(world)
        memory = self.observer.begin(seen)
        left = xp.astype(xp.round(engagement.duration / self.world.period), xp.int32)
        observation = self._observation(memory, seen)
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
        observation, left = self._observation(memory, seen), state.left - 1
        hidden, ended = self._hidden(world, observation), left <= 0
        running = EnvironmentState(world, memory, left, hidden), observation
        after = when_any(ended, lambda new, old: select(ended, new, old), fresh, running)
        reward = self.reward(shot, command, seen)
        return after[0], Step(after[1], observation, hidden, reward, ended & False, ended, shot)

    def _observation(self, memory: Any, seen: Seen) -> Array:
        return self.observer.observe(self.observer.view(memory, seen))

    def _hidden(self, world: Any, observation: Array) -> Array:
        """Return where the target really is and will be, which no robot can see, shape B + (HIDDEN,), or B + (0,)."""
        if not self.sees_truth:
            return observation[..., :0]
        xp, target, time, period = namespace(world.time), world.engagement.target, world.time, self.world.period
        now, soon, later = (
            target.at(time + ahead).position[..., 0, :2] for ahead in (0.0 * period, period, 20.0 * period)
        )
        return xp.concat([now, (soon - now)[..., 1:] / period, 5.0 * (later - now)], axis=-1)


def make_environment(
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    config: ConfigLike = None,
    reward: str | RewardFunction | None = None,
) -> Environment:
    """Build the environment that `train` trains in, in float32.

    Args:
      robot: a robot or its folder; the paper's if not given.
      task: a task, its name or its file.
      config: observation, reward and share of still targets; by default those of `train`.
      reward: in the place of the settings'; a name, or a user's function.

    Raises:
      InputError: if robot, task and settings don't fit each other, or a user's code fails.
    """
    robot = Robot.of(robot)
    task = Task.of(task)
    config = TrainConfig.of(config).resolved(robot, task)
    observer = make_observer(observer_facts(config.names, robot, task, config.frames), config.names[1:])
    observer.layout()
    world = make_world(robot, task)
    if task.motion in DRAWN:
        world = with_open_nearness(world)
    scenario = task.replace(still_share=config.still_share).scenario(world.plants)
    # Who sees old detections alone, or six numbers of them, leaves the critic to learn where the target really is.
    sees_truth = config.trainer == "ppo" and (robot.sensing is not None or config.kind in ("tracked", "multimodel"))
    found = make_reward(reward or config.reward, task.hit_radius_m)
    made: Environment = single_precision(Environment(world, scenario, observer, found, sees_truth))
    if isinstance(found, UserReward):
        normals = np.zeros((2, made.normals), np.float32)
        state, observation = made.fresh(normals, np.full((2, made.uniforms), 0.5, np.float32))
        made.step(state, np.zeros((2, 2), np.float32), normals, (state, observation))  # its faults show now
    return made

"""The environment that `train` trains in for Gymnasium: one engagement after the other, or many side by side.

    import gymnasium
    env = gymnasium.make("archerfish2:archerfish2/Shooting-v0", robot="my-robot", task="any")

An engagement's random numbers are drawn when it is prepared, from the generator of its environment: so environment i of
seed s has the engagements of a single one of seed s + i. A step is compiled; without JAX, or in a process that was
forked while JAX was running, where its threads are missing, it runs in NumPy.
"""

import os
import sys
from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from archerfish2.arrays import map_arrays, namespace
from archerfish2.compiled import has_jax, import_jax
from archerfish2.errors import InputError
from archerfish2.learning.environments import make_environment
from archerfish2.simulation.environment import Environment
from archerfish2.simulation.picture import REMEMBERED, Picture, draw_picture

_MODE = 'and render_mode "rgb_array" or None'
OBSERVATION_BOUND = 1e6
"""Far beyond any number of an observation; Gymnasium advises against spaces without bounds."""
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]
_forked: list[bool] = []  # not empty in a process that was forked while JAX was running

if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _forked.append(True) if sys.modules.get("jax") else None)


class _Engagements:
    """What both adapters share: the environment, its spaces, its programs, and the draws of engagements."""

    def __init__(self, mode: Any, options: dict[str, Any]) -> None:
        given = {"robot": None, "task": "any", "config": None, "environment": None, "action_bound": 1.0} | options
        robot, task, config, environment, action_bound, *more = given.values()
        if more or mode not in (None, "rgb_array"):
            *names, expected = *list(given)[5:], f"options robot, task, config, environment, action_bound, {_MODE}"
            raise InputError(f"expected {expected}; got {', '.join(names) or f'render_mode {mode!r}'}; correct it")
        if not 0.0 < action_bound < np.inf:
            raise InputError(f"action_bound must be finite and > 0, got {action_bound}; 1 is usual")
        if environment is not None and (robot is not None or task != "any" or config is not None):
            raise InputError("an environment is given, so robot, task and config can't be; give one or the other")
        self.environment: Environment = make_environment(robot, task, config) if environment is None else environment
        self.bound, self.plain = np.float32(action_bound), map_arrays(np.asarray, self.environment)
        self.step, self.fresh = _step, _fresh
        if has_jax() and not _forked:
            jax = import_jax()
            self.environment = jax.tree.map(jax.numpy.asarray, self.environment)
            self.step, self.fresh = jax.jit(_step), jax.jit(_fresh)
        lengths = np.asarray(self.environment.scenario.lengths) / np.asarray(self.environment.world.period)
        self.shortest, self.longest = (round(float(each)) for each in lengths)
        size = self.plain.fresh(*self.drawn([np.random.default_rng(0)])[1:])[1].shape[-1]
        box: Any = gymnasium.spaces.Box
        self.observations = box(-OBSERVATION_BOUND, OBSERVATION_BOUND, (size,), np.float32)
        self.actions = box(-action_bound, action_bound, (2,), np.float32)
        fps = round(1.0 / float(self.environment.world.period))
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": fps}

    def drawn(self, generators: list[np.random.Generator]) -> tuple[Floats, Floats, Floats]:
        """Return draws of new engagements: normals of all decisions (B, T, n), and what they begin with."""
        uniforms = [each.random(self.environment.uniforms, np.float32) for each in generators]
        shape = (self.longest + 1, self.environment.normals)
        normals = np.stack([each.standard_normal(shape, np.float32) for each in generators])
        return normals[:, 1:], normals[:, 0], np.stack(uniforms)

    def action(self, action: Any, shape: tuple[int, ...]) -> Floats:
        """Return actions as float32, if that is what they can be."""
        found = np.asarray(action)
        if found.shape != shape or found.dtype.kind not in "fiu" or not np.all(np.isfinite(found)):
            what = f"{found.dtype} of shape {found.shape}" if found.shape != shape else "a number that is not finite"
            raise InputError(f"an action must be finite numbers of shape {shape}, pitch and yaw, got {what}")
        return found.astype(np.float32)

    def picture(self, state: Any, member: int, misses: Any) -> Picture:
        """Draw an engagement of a batch."""
        world = self.plain.world
        seen = world.see(map_arrays(np.asarray, state.world))
        plate = world.hardware.frames(map_arrays(np.asarray, state.world.hardware), np.asarray(state.world.time))
        place = plate.position[member, -1, 0] if plate.found[member, -1, 0] else np.array([3.0, 0.0, 0.0])
        return draw_picture(
            seen.gimbal.angle[member], seen.command[member], place, misses, float(np.asarray(world.hit_radius))
        )


def _fresh(environment: Environment, normals: Any, uniforms: Any) -> Any:
    return environment.fresh(normals, uniforms)


def _step(environment: Environment, bound: Any, state: Any, action: Any, normals: Any, fresh: Any) -> Any:
    """Return state, observations, last observations, and by row: reward, whether time is up, whether it hit, miss."""
    xp = namespace(action)
    state, step = environment.step(state, xp.clip(action, -bound, bound), normals, fresh)
    hit = step.shot.fired & (step.shot.margin >= 0.0)
    rows = xp.stack([step.reward, 1.0 * step.truncated, 1.0 * hit, *(step.shot.miss[..., each] for each in (0, 1))])
    return state, step.observation, step.final_observation, rows


def _check_reset(seed: Any, options: Any) -> None:
    if seed is not None and seed < 0:
        raise InputError(f"seed must be at least 0, got {seed}; give another one")
    if options:
        raise InputError(f"reset takes no options, got {', '.join(map(str, options))}; give them when making it")


class ShootingEnv(gymnasium.Env[Floats, Floats]):
    """Engagements, one after the other; an observation is what a policy sees, an action an offset from the aim."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  # Gymnasium reads the class's

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Make an environment.

        Args:
          render_mode: "rgb_array" or None.
          options: `robot`, a robot or its folder (the paper's); `task`, a task, its name or its file ("any"); `config`,
            a `TrainConfig` with observation and reward (those of `train`); or instead `environment`, of
            `make_environment`; `action_bound`, the largest action in units of the observer's action scale (1).

        Raises:
          InputError: if something can't be used.
        """
        self._all = _Engagements(render_mode, options)
        self.observation_space, self.action_space = self._all.observations, self._all.actions
        self.render_mode, self.metadata = render_mode, self._all.metadata
        self._state: Any = None
        self._misses = deque[Floats](maxlen=REMEMBERED)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin the next engagement; a seed begins a sequence of them.

        Args:
          seed: of everything random from now on.
          options: none.

        Raises:
          InputError: if there are options, or the seed is negative.
        """
        _check_reset(seed, options)
        super().reset(seed=seed, options=options)
        (self._normals,), *begin = self._all.drawn([self.np_random])
        self._state, observation = self._all.plain.fresh(*begin)
        self._place = 0
        self._misses.clear()
        return observation[0], {}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Decide and fire.

        Args:
          action: pitch and yaw, clipped to the action space, shape (2,).

        Returns:
          Observation; reward [m]; False; whether the engagement's time is up; `miss` of the shot, left and up [m], and
          whether it was a `hit`.

        Raises:
          InputError: if the action is not two finite numbers.
        """
        if self._state is None or self._place >= len(self._normals):
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked, normals = self._all.action(action, (2,)), self._normals[self._place][None]
        fresh = (self._state, np.zeros((1, *(self.observation_space.shape or ())), np.float32))
        self._state, _, observation, rows = self._all.step(
            self._all.environment, self._all.bound, self._state, asked[None], normals, fresh
        )
        reward, ended, hit, *miss = np.asarray(rows)[:, 0].tolist()
        self._place = len(self._normals) if ended else self._place + 1
        self._misses.append(np.array(miss, np.float32))
        info = {"miss": self._misses[-1], "hit": hit > 0.0}
        return np.array(observation[0]), reward, False, ended > 0.0, info

    def render(self) -> Picture | None:
        """Draw the engagement for "rgb_array", shape (height, width, 3)."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        return self._all.picture(self._state, 0, list(self._misses))


class ShootingVectorEnv(gymnasium.vector.VectorEnv[Floats, Floats, NDArray[Any]]):
    """Engagements side by side in one compiled step; one that ends is replaced in the same step, nothing is lost."""

    def __init__(
        self, num_envs: int = 1, render_mode: str | None = None, staggered: bool = False, **options: Any
    ) -> None:
        """Make environments.

        Args:
          num_envs: B engagements.
          render_mode: "rgb_array" or None.
          staggered: whether the first engagements are cut to different lengths, so that a batch has all phases.
          options: as of `ShootingEnv`.

        Raises:
          InputError: if something can't be used.
        """
        if num_envs < 1:
            raise InputError(f"num_envs must be at least 1, got {num_envs}; give more")
        self._all = _Engagements(render_mode, options)
        self.num_envs, self.render_mode, self._staggered = num_envs, render_mode, staggered
        self.single_observation_space, self.single_action_space = self._all.observations, self._all.actions
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {**self._all.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}
        self._generators: list[np.random.Generator] = []
        self._misses = deque[tuple[Floats, Flags]](maxlen=REMEMBERED)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin all engagements; the same seeds begin the same sequences of them.

        Args:
          seed: environment i gets seed + i, or its own of a sequence.
          options: none.

        Raises:
          InputError: if there is not one seed per environment, one is negative, or there are options.
        """
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise InputError(f"seed must be one per environment: expected {self.num_envs}, got {len(seeds)}")
        for each in (None,) if seeds is None else seeds:
            _check_reset(each, options)
        made = [gymnasium.utils.seeding.np_random(each)[0] for each in seeds or [None] * self.num_envs]
        if self._generators:  # without a seed a sequence goes on
            pairs = zip(seeds or [None] * self.num_envs, self._generators, made, strict=True)
            made = [before if own is None else new for own, before, new in pairs]
        self._generators = made
        normals, *begin = self._all.drawn(self._generators)
        self._state, observation = self._all.fresh(self._all.environment, *begin)
        if self._staggered:
            phase = np.arange(self.num_envs) * 10 // self.num_envs
            left = np.asarray(self._state.left)
            self._state = self._state._replace(left=left - (phase * left // 10).astype(left.dtype))
        # The next engagement of each is prepared, too: two buffers, of which one is in use.
        following, *self._begin = self._all.drawn(self._generators)
        self._fresh = self._all.fresh(self._all.environment, *self._begin)
        self._normals, self._used = np.stack([normals, following]), np.zeros(self.num_envs, int)
        self._place, self._consumed, self._block = np.zeros(self.num_envs, int), np.zeros(self.num_envs, bool), 0
        self._misses.clear()
        return np.array(observation), {}

    def step(self, actions: Floats) -> tuple[Floats, Floats, Flags, Flags, dict[str, Any]]:
        """Decide and fire in all environments.

        Args:
          actions: clipped to the action space, shape (B, 2).

        Returns:
          Observations, of the next engagement where one ended; rewards [m]; no termination; whether time is up; `miss`
          and `hit` of the shots, and where one ended its last observation in `final_obs`, as Gymnasium has it.

        Raises:
          InputError: if the actions are not finite numbers of that shape.
        """
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked, members = self._all.action(actions, (self.num_envs, 2)), np.arange(self.num_envs)
        if self._block >= self._all.shortest:
            self._refill()
        normals = self._normals[self._used, members, self._place]
        self._state, *given = self._all.step(
            self._all.environment, self._all.bound, self._state, asked, normals, self._fresh
        )
        observation, final, (reward, up, hits, *missed) = (np.array(each) for each in given)
        ended, hit, miss = up > 0.0, hits > 0.0, np.stack(missed, axis=-1)
        self._place = np.where(ended, 0, self._place + 1)
        self._used, self._consumed, self._block = self._used ^ ended, self._consumed | ended, self._block + 1
        self._misses.append((miss, ended))
        infos: dict[str, Any] = {"miss": miss, "_miss": ~ended, "hit": hit, "_hit": ~ended}
        if ended.any():
            rows = np.full(self.num_envs, None, object)
            for member in np.flatnonzero(ended):
                rows[member] = final[member]
            last = {"miss": miss, "_miss": ended.copy(), "hit": hit, "_hit": ended.copy()}
            infos |= {"final_obs": rows, "_final_obs": ended.copy(), "final_info": last, "_final_info": ended.copy()}
        return observation, reward, ended & False, ended, infos

    def render(self) -> tuple[Picture, ...] | None:
        """Draw every engagement for "rgb_array", each of shape (height, width, 3)."""
        if self.render_mode is None:
            return None
        if not self._generators:
            raise gymnasium.error.ResetNeeded("call reset before render")
        return tuple(self._all.picture(self._state, each, self._recent(each)) for each in range(self.num_envs))

    def _refill(self) -> None:
        """Prepare the next engagements of those that took theirs: once a block, in which none ends twice."""
        members = np.flatnonzero(self._consumed)
        if len(members):
            normals, *begin = self._all.drawn([self._generators[each] for each in members])
            self._normals[1 - self._used[members], members] = normals
            for array, rows in zip(self._begin, begin, strict=True):
                array[members] = rows
            self._fresh = self._all.fresh(self._all.environment, *self._begin)
        self._consumed, self._block = np.zeros(self.num_envs, bool), 0

    def _recent(self, member: int) -> list[Floats]:
        """Return the last misses of an engagement, and none of the one before it."""
        recent: list[Floats] = []
        for miss, ended in self._misses:
            recent = [] if ended[member] else [*recent, miss[member]]
        return recent

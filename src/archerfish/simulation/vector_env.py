"""Many engagements side by side as a Gymnasium vector environment: one compiled step, nothing lost where one ends.

An engagement that ends begins anew in the same step; what was seen at its end comes in `final_obs`.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from jax import Array
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.simulation.draw_stream import DrawStream, begin_stream, following
from archerfish.simulation.environment import Advance, EnvironmentState, ShootingEnvironment
from archerfish.simulation.gymnasium_env import (
    ACTIONS,
    Floats,
    check_reset,
    given_or_made,
    picture_of,
    possible_render_modes,
    refused_actions,
    spaces_of,
)
from archerfish.simulation.picture import REMEMBERED, Picture

Flags = NDArray[np.bool_]
Steps = tuple[Floats, Floats, Flags, Flags, dict[str, Any]]


class ShootingVectorEnv(gymnasium.vector.VectorEnv[Floats, Floats, NDArray[Any]]):
    """Engagements side by side; environment i of seed s meets what a single environment of seed s + i meets."""

    def __init__(
        self,
        num_envs: int = 1,
        environment: ShootingEnvironment | None = None,
        render_mode: str | None = None,
        action_bound: float = 1.0,
        staggered: bool = False,
        **options: Any,
    ) -> None:
        """Take an environment, or make one.

        Args:
          num_envs: B engagements.
          environment: where; made from the options if not given.
          render_mode: "rgb_array" or None.
          action_bound: largest action, in the units of the observer's action scale.
          staggered: whether the first engagements are cut short by all phases, so that a batch mixes them ever after.
          options: of `assembly.make_environment`.

        Raises:
          InputError: if an option can't be used.
        """
        if num_envs < 1:
            raise InputError(f"num_envs must be at least 1, got {num_envs}")
        if render_mode not in (None, "rgb_array"):
            raise InputError(f'render_mode of several environments must be "rgb_array" or None, got {render_mode!r}')
        made = given_or_made(environment, options)
        self.num_envs, self.render_mode, self._staggered = num_envs, render_mode, staggered
        self.single_observation_space, self.single_action_space = spaces_of(made, action_bound)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        shown = possible_render_modes(float(made.world.period)) | {"render_modes": ["rgb_array"]}
        self.metadata = {**shown, "autoreset_mode": AutoresetMode.SAME_STEP}
        self._bound, self._hit_radius = action_bound, float(made.hit_radius)
        self._environment: ShootingEnvironment = jax.tree.map(jnp.asarray, made)
        self._sizes, self._world = (made.normals, made.uniforms), jax.tree.map(np.asarray, made.world)
        self._state: EnvironmentState | None = None
        self._stream: DrawStream | None = None
        self._misses = deque[tuple[Floats, Flags]](maxlen=REMEMBERED)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin all engagements; the same seed begins the same sequences of them.

        Args:
          seed: environment i gets seed + i, or its own of a sequence; without one, what was begun goes on.
          options: none are known; `reset_mask` is refused, for what ends begins anew by itself.

        Raises:
          InputError: if there is not one seed per environment, one is negative, or there are options.
        """
        if options and "reset_mask" in options:
            raise InputError("reset_mask can't be used: an engagement that ends begins anew in the same step")
        first = int(seed) if isinstance(seed, int | np.integer) else None
        check_reset(first, options)
        super().reset(seed=first, options=options)
        if seed is not None or self._stream is None:
            self._stream = begin_stream(self._seeds(seed), *self._sizes)
        else:
            self._stream = following(self._stream)
        begin = _begin_staggered if self._staggered else _begin
        self._state, observation = begin(self._environment, *self._stream.draws, self._stream.place)
        self._misses.clear()
        return np.array(observation), {}

    def step(self, actions: Floats) -> Steps:
        """Take one decision in every engagement and fire.

        Args:
          actions: pitch and yaw; clipped to the action space, shape (B, 2).

        Returns:
          Observations, rewards [m], False, whether time is up, and infos: `miss` in y and z [m], `hit`, and where
          engagements ended `final_obs` and `final_info`, with masks as Gymnasium has them.
        """
        observation, given = self.advance(actions)
        miss, ended = np.array(given.miss), np.array(given.truncated)
        infos = {} if ended.all() else self._passed(np.where(ended[:, None], 0.0, miss), ~ended)
        if ended.any():
            final, seen = np.full(self.num_envs, None, object), np.asarray(given.observation)
            for member in np.flatnonzero(ended):
                final[member] = seen[member].copy()
            final_info = self._passed(np.where(ended[:, None], miss, 0.0), ended)
            infos |= {"final_obs": final, "_final_obs": ended, "final_info": final_info, "_final_info": ended}
        return np.array(observation), np.array(given.reward), np.zeros(self.num_envs, bool), ended, infos

    def advance(self, actions: Floats) -> tuple[Array, Advance]:
        """Take one decision in every engagement; what it gave stays in JAX's arrays.

        Args:
          actions: shape (B, 2).

        Returns:
          Observations for the next decision, shape (B, n), and what the step gave before anything began anew.

        Raises:
          InputError: if the actions are not two finite numbers for each engagement.
        """
        if self._state is None or self._stream is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked, expected = np.asarray(actions, np.float32), (self.num_envs, ACTIONS)
        if asked.shape != expected or not np.isfinite(asked).all():
            raise refused_actions(asked, expected)
        self._stream = following(self._stream)
        self._state, observation, given = _step(
            self._environment,
            self._state,
            asked,
            self._bound,
            *self._stream.draws,
            self._stream.place,
        )
        if self.render_mode is not None:
            self._misses.append((np.asarray(given.miss), np.asarray(given.truncated)))
        return observation, given

    def passed(self, given: Advance) -> tuple[Floats, Flags]:
        """Return where pellets passed the armor in y and z [m], shape (B, 2), and which of them hit.

        Args:
          given: what a step gave.
        """
        miss = np.array(given.miss)
        return miss, np.asarray(np.sum(miss**2, axis=-1) <= self._hit_radius**2)

    def render(self) -> tuple[Picture, ...] | None:
        """Draw every engagement, each of shape (height, width, 3)."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        state, world = self._state, self._world
        return tuple(
            picture_of(world, state, member, self._recent(member), self._hit_radius) for member in range(self.num_envs)
        )

    def _recent(self, member: int) -> Floats:
        """Return the last misses of an engagement, and none of the one before it, shape (k, 2)."""
        misses: list[Floats] = []
        for miss, ended in self._misses:
            misses = [] if ended[member] else [*misses, miss[member]]
        return np.array(misses, np.float32).reshape(-1, 2)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int]:
        if isinstance(seed, int | np.integer):
            return [int(seed) + member for member in range(self.num_envs)]
        given: Sequence[int | None] = [None] * self.num_envs if seed is None else seed
        if len(given) != self.num_envs:
            raise InputError(f"seeds must be one per environment: expected {self.num_envs}, got {len(given)}")
        for each in given:
            check_reset(each, None)
        drawn = self.np_random.integers(2**32, size=self.num_envs)
        return [int(own) if each is None else each for each, own in zip(given, drawn, strict=True)]

    def _passed(self, miss: Floats, told: Flags) -> dict[str, Any]:
        hit = (np.sum(miss**2, axis=-1) <= self._hit_radius**2) & told
        return {"miss": miss, "_miss": told, "hit": hit, "_hit": told.copy()}


@jax.jit
def _begin(environment: ShootingEnvironment, normals: Array, uniforms: Array, place: Array) -> Any:
    return environment.fresh(normals[place], uniforms[place])


@jax.jit
def _begin_staggered(environment: ShootingEnvironment, normals: Array, uniforms: Array, place: Array) -> Any:
    return environment.begin(normals[place], uniforms[place])


@jax.jit
def _step(
    environment: ShootingEnvironment,
    state: EnvironmentState,
    actions: Array,
    bound: Array,
    normals: Array,
    uniforms: Array,
    place: Array,
) -> tuple[EnvironmentState, Array, Advance]:
    going_on, given = environment.advance(state, jnp.clip(actions, -bound, bound), normals[place])
    return *environment.renew(going_on, given, normals[place], uniforms[place]), given

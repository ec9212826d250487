"""One engagement after the other as a Gymnasium environment: NumPy in and out, one compiled program within."""

import math
from collections import deque
from functools import partial
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from archerfish.records.errors import InputError
from archerfish.simulation.assembly import make_environment
from archerfish.simulation.draw_stream import Draws, DrawStream, begin_stream, following
from archerfish.simulation.environment import EnvironmentState, ShootingEnvironment
from archerfish.simulation.packing import Packing, pack, packing_of, unpack
from archerfish.simulation.picture import REMEMBERED, Picture, View, draw
from archerfish.simulation.window import Window, has_display

RENDER_MODES = ("human", "rgb_array")
ACTIONS = 2
OBSERVATION_BOUND = 1e6
"""Far beyond any number of an observation; Gymnasium advises against spaces without bounds."""
Floats = NDArray[np.float32]


def spaces_of(
    environment: ShootingEnvironment, action_bound: float
) -> tuple[gymnasium.Space[Floats], gymnasium.Space[Floats]]:
    """Return the spaces of observations and of actions.

    Raises:
      InputError: if the bound is not a positive number.
    """
    if not 0.0 < action_bound < np.inf:
        raise InputError(f"action_bound must be finite and > 0, got {action_bound}")
    size = _observation_size(environment)
    box: Any = gymnasium.spaces.Box
    seen: gymnasium.Space[Floats] = box(-OBSERVATION_BOUND, OBSERVATION_BOUND, (size,), np.float32)
    asked: gymnasium.Space[Floats] = box(-action_bound, action_bound, (ACTIONS,), np.float32)
    return seen, asked


def given_or_made(environment: ShootingEnvironment | None, options: dict[str, Any]) -> ShootingEnvironment:
    """Return the environment that was handed in, or make one.

    Raises:
      InputError: if both an environment and options to make one are given, or an option can't be used.
    """
    if environment is None:
        return make_environment(**options)
    if options:
        raise InputError(
            f"an environment is given, so {', '.join(options)} can't be; give one or the other (archerfish/Shooting-v0 "
            "sets nothing by itself)"
        )
    return environment


def possible_render_modes(period_s: float) -> dict[str, Any]:
    """Return Gymnasium's description of how an environment can be shown here, in real time."""
    modes = [mode for mode in RENDER_MODES if mode != "human" or has_display()]
    return {"render_modes": modes, "render_fps": round(1.0 / period_s)}


def check_reset(seed: int | None, options: dict[str, Any] | None) -> None:
    """Raise InputError if a seed is negative, or there are options: no environment of ours knows any."""
    if seed is not None and seed < 0:
        raise InputError(f"seed must be at least 0, got {seed}")
    if options:
        raise InputError(f"reset knows no options, got {', '.join(map(str, options))}; give them when making it")


def refused_actions(actions: Floats, expected: tuple[int, ...]) -> InputError:
    """Return why actions of a wrong shape, or with a number that is not finite, are not taken.

    Args:
      actions: as given.
      expected: their shape.
    """
    found = "a number that is not finite" if actions.shape == expected else f"shape {actions.shape}"
    return InputError(f"an action must be finite numbers of shape {expected}, pitch and yaw, got {found}")


class ShootingEnv(gymnasium.Env[Floats, Floats]):
    """Engagements, one after the other; an observation is what the policy sees, an action an offset from the aim."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 50}  # noqa: RUF012  # Gymnasium reads the class's

    def __init__(
        self,
        environment: ShootingEnvironment | None = None,
        render_mode: str | None = None,
        action_bound: float = 1.0,
        **options: Any,
    ) -> None:
        """Take an environment, or make one.

        Args:
          environment: where; made from the options if not given.
          render_mode: "rgb_array", "human" or None.
          action_bound: largest action, in the units of the observer's action scale.
          options: of `assembly.make_environment`.

        Raises:
          InputError: if an option can't be used, or there is no display for "human".
        """
        made = given_or_made(environment, options)
        if render_mode not in (None, *RENDER_MODES):
            raise InputError(f"render_mode must be one of {', '.join(RENDER_MODES)}, got {render_mode!r}")
        self.metadata = possible_render_modes(float(made.world.period))
        self.observation_space, self.action_space = spaces_of(made, action_bound)
        self.render_mode = render_mode
        self._window = Window("archerfish") if render_mode == "human" else None
        self._size, self._bound = _observation_size(made), action_bound
        self._sizes, self._hit_radius = (made.normals, made.uniforms), float(made.hit_radius)
        self._environment, self._parameters = packing_of(made), pack(made)
        self._world = made.world
        self._state: tuple[Array, Array] | None = None
        self._packing: Packing
        self._stream: DrawStream | None = None
        self._ended = False
        self._misses = deque[Floats](maxlen=REMEMBERED)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an engagement; the same seed begins the same sequence of them.

        Args:
          seed: of everything random from now on; without one, what was begun goes on.
          options: none are known.

        Raises:
          InputError: if there are options, or the seed is negative.
        """
        check_reset(seed, options)
        super().reset(seed=seed, options=options)
        if seed is not None or self._stream is None:
            seed = int(self.np_random.integers(2**32)) if seed is None else seed
            self._stream = begin_stream([seed], *self._sizes)
        elif not self._ended:
            # After an engagement that ended by itself, the next one has the numbers of its last step.
            self._stream = following(self._stream)
        packing, self._state, observation = _begin(
            self._environment, *self._parameters, self._stream.draws, self._stream.place
        )
        self._packing, self._ended = packing, False
        self._misses.clear()
        self._show()
        return np.array(observation), {}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Take one decision and fire.

        Args:
          action: pitch and yaw; clipped to the action space, shape (2,).

        Returns:
          Observation, reward [m], False, whether the engagement's time is up, and where the pellet passed the armor:
          `miss` in y and z [m], and whether that is a `hit`.

        Raises:
          InputError: if the action is not two finite numbers.
        """
        if self._state is None or self._stream is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked = np.asarray(action, np.float32)
        if asked.shape != (ACTIONS,) or not all(map(math.isfinite, asked.tolist())):
            raise refused_actions(asked, (ACTIONS,))
        self._stream = following(self._stream)
        floats, integers, told = _advance(
            self._environment,
            self._packing,
            self._bound,
            *self._parameters,
            *self._state,
            asked,
            self._stream.draws.normals,
            self._stream.place,
        )
        self._state = floats, integers
        told = np.array(told)
        observation, (reward, ended, left, up) = told[: self._size], told[self._size :].tolist()
        self._ended = ended > 0.0
        miss = told[-2:]
        self._misses.append(miss)
        self._show()
        return observation, reward, False, self._ended, {"miss": miss, "hit": left**2 + up**2 <= self._hit_radius**2}

    def render(self) -> Picture | None:
        """Draw the engagement for "rgb_array", shape (height, width, 3); "human" shows every step by itself."""
        return self._picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self._picture())

    def _picture(self) -> Picture:
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        state: EnvironmentState = unpack(self._packing, *self._state)
        return picture_of(self._world, state, 0, np.array(self._misses), self._hit_radius)


def picture_of(world: Any, state: EnvironmentState, member: int, misses: NDArray[Any], hit_radius: float) -> Picture:
    """Draw one engagement of a batch.

    Args:
      world: where.
      state: of the batch.
      member: which one.
      misses: its last pellets, shape (k, 2).
      hit_radius: largest miss that hits [m].
    """
    seen = jax.tree.map(np.asarray, world.see(jax.tree.map(np.asarray, state.shooting)))
    return draw(View(seen.angle[member], seen.command[member], seen.plate[member, 0], misses, hit_radius))


@partial(jax.jit, static_argnums=0)
def _begin_compiled(environment: Packing, floats: Array, integers: Array, draws: Draws, place: Array) -> Any:
    made: ShootingEnvironment = unpack(environment, floats, integers)
    return made.fresh(draws.normals[place], draws.uniforms[place])


def _begin(*arguments: Any) -> tuple[Packing, tuple[Array, Array], Array]:
    state, observation = _begin_compiled(*arguments)
    return packing_of(state), pack(state), observation[0]


@partial(jax.jit, static_argnums=(0, 1, 2))
def _advance(
    environment: Packing,
    packing: Packing,
    action_bound: float,
    floats: Array,
    integers: Array,
    state_floats: Array,
    state_integers: Array,
    action: Array,
    normals: Array,
    place: Array,
) -> tuple[Array, Array, Array]:
    made: ShootingEnvironment = unpack(environment, floats, integers)
    state = unpack(packing, state_floats, state_integers)
    # Clipped here, since a call of NumPy's takes a fifth of the step.
    asked = jnp.clip(action, -action_bound, action_bound)
    going_on, told = made.advance(state, asked[None], normals[place])
    # One array: handing over each by itself would cost more than the step.
    flat = [told.observation[0], told.reward, told.truncated.astype(jnp.float32), told.miss[0]]
    return *pack(going_on), jnp.concatenate(flat)


def _observation_size(environment: ShootingEnvironment) -> int:
    return environment.observed + int(environment.hidden.shape[0])

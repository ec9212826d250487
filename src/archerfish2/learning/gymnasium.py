"""The environment that `train` trains in for Gymnasium: one engagement after the other, or many side by side.

    import gymnasium
    env = gymnasium.make("archerfish2:archerfish2/Shooting-v0", robot="my-robot", task="any")

Each environment has two generators, one of its engagements and one of the noise of its decisions: so environment i of
seed s has the engagements of a single one of seed s + i, though the next one is prepared while one runs. A step is
compiled; without JAX, or in a process that was forked while JAX was loaded, where its threads are missing, it runs in
NumPy.
"""

from collections import deque
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from archerfish2.arrays import map_arrays, namespace
from archerfish2.compiled import forked, has_jax, import_jax
from archerfish2.errors import InputError
from archerfish2.learning.environments import make_environment
from archerfish2.simulation.environment import Environment
from archerfish2.simulation.picture import REMEMBERED, Picture, draw_picture

_OPTIONS = ("robot", "task", "config", "reward")  # of `make_environment`
_OTHERS = ', environment, action_bound, render_mode "rgb_array" or None, and of many environments staggered'
OBSERVATION_BOUND = 1e6
"""Far beyond any number of an observation; Gymnasium advises against spaces without bounds."""
Floats = NDArray[np.float32]
BoolArray = NDArray[np.bool_]


class _Engagements:
    """What both adapters share: the environment, its spaces, its programs, and the draws of engagements."""

    def __init__(self, mode: Any, environment: Any = None, action_bound: float = 1.0, **options: Any) -> None:
        unknown = [each for each in options if each not in _OPTIONS]
        if unknown or mode not in (None, "rgb_array"):
            found = ", ".join(unknown) or f"render_mode {mode!r}"
            raise InputError(f"expected options {', '.join(_OPTIONS)}{_OTHERS}; got {found}; correct it")
        if not 0.0 < action_bound < np.inf:
            raise InputError(f"action_bound must be finite and > 0, got {action_bound}; 1 is usual")
        if environment is not None and options:
            raise InputError(f"an environment is given, so {', '.join(options)} can't be; give one or the other")
        self.plain: Environment = make_environment(**options) if environment is None else environment
        if not isinstance(self.plain, Environment):
            raise InputError(f"environment must be from make_environment, got {self.plain!r}; or give robot and task")
        self.environment = self.plain = map_arrays(np.asarray, self.plain)
        self.bound, self.programs = np.float32(action_bound), dict[Any, Any]()
        if has_jax():
            jax = import_jax()
            self.environment = jax.tree.map(jax.numpy.asarray, self.plain)
            self.programs = {each: jax.jit(each) for each in (Environment.begin, Environment.fresh, _step, _alone)}
        self.shortest = round(float(self.plain.scenario.lengths[0] / self.plain.world.period))
        size = self.plain.fresh(*_batch([self.begun(np.random.default_rng(0))]))[1].shape[-1]
        box: Any = gymnasium.spaces.Box
        self.observations = box(-OBSERVATION_BOUND, OBSERVATION_BOUND, (size,), np.float32)
        self.actions = box(-action_bound, action_bound, (2,), np.float32)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / float(self.plain.world.period))}

    def begun(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        """Return the normals and uniforms that a new engagement begins with."""
        normals = generator.standard_normal(self.plain.normals, np.float32)
        return normals, generator.random(self.plain.uniforms, np.float32)

    def run(self, function: Any, *arguments: Any) -> Any:
        """Return what a function of the environment gives, compiled if that is possible."""
        if self.programs and not forked:
            return self.programs[function](self.environment, *arguments)
        return function(self.plain, *map_arrays(np.asarray, arguments))

    def action(self, action: Any, shape: tuple[int, ...]) -> Floats:
        """Return actions within the bound as float32, if that is what they can be."""
        try:
            found = np.asarray(action)
        except ValueError:  # ragged
            found = np.asarray(action, object)
        what = f"{found.dtype} of shape {found.shape}"
        if found.shape == shape and found.dtype.kind in "fiu":
            if np.isfinite(found).all():
                # Before they are float32, where a large number would overflow.
                taken: Floats = np.minimum(np.maximum(found, -self.bound), self.bound).astype(np.float32)
                return taken
            what = "a number that is not finite"
        raise InputError(f"an action must be finite numbers of shape {shape}, pitch and yaw, got {what}; correct it")

    def picture(self, state: Any, member: int, misses: Any) -> Picture:
        """Draw an engagement of a batch."""
        world = self.plain.world
        seen = world.see(map_arrays(np.asarray, state.world))
        target = map_arrays(np.asarray, state.world.engagement.target)
        plate = target.at(np.asarray(state.world.time)).position[member, 0]
        angle, command = seen.gimbal.angle[member], seen.command[member]
        return draw_picture(angle, command, plate, misses, float(world.hit_radius))


def _batch(rows: list[tuple[Floats, Floats]]) -> tuple[Floats, ...]:
    """Return the normals and the uniforms of engagements side by side, shape (B, ...)."""
    return tuple(np.stack(each) for each in zip(*rows, strict=True))


def _step(environment: Environment, state: Any, action: Any, normals: Any, fresh: Any) -> Any:
    """Return state, observations, last observations, and by row: reward, whether time is up, whether it hit, miss."""
    state, step = environment.step(state, action, normals, fresh)
    xp = namespace(step.reward)
    hit, miss = step.shot.fired & (step.shot.margin >= 0.0), step.shot.miss
    columns = step.reward, step.truncated, hit, miss[..., 0], miss[..., 1]
    rows = xp.stack([xp.asarray(column, dtype=xp.float32) for column in columns])
    return state, step.observation, step.final_observation, rows


def _alone(environment: Environment, state: Any, given: Any, action: Any, normals: Any) -> Any:
    """Return a single environment's state, and in one array, as that costs less, its row and its last observation."""
    state, _, final, rows = _step(environment, state, action[None], normals[None], (state, given[None, 5:]))
    return state, namespace(final).concat([rows[:, 0], final[0]])


def _seeds(seed: Any, options: Any, count: int) -> list[int | None]:
    """Return the seed of each environment, None where a sequence continues, or raise InputError."""
    if options:
        raise InputError(f"reset takes no options, got {', '.join(map(str, options))}; give them when making it")
    one = np.ndim(seed) == 0
    given = [seed] * count if one else list(seed)
    if len(given) != count:
        raise InputError(f"seed must be one per environment: expected {count}, got {len(given)}; or give a single one")
    for each in given:
        if each is not None and not (isinstance(each, int | np.integer) and each >= 0):
            raise InputError(f"seed must be an integer of at least 0, got {each!r}; give another one")
    return [None if each is None else int(each) + one * place for place, each in enumerate(given)]


class ShootingEnv(gymnasium.Env[Floats, Floats]):
    """Engagements, one after the other; an observation is what a policy sees, an action an offset from the aim."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012  # Gymnasium reads the class's

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Make an environment.

        Args:
          render_mode: "rgb_array" or None.
          options: `robot`, a robot or its folder (the paper's); `task`, a task, its name or its file ("any"); `config`,
            a `TrainConfig` with observation and reward (those of `train`); `reward`, in the place of the settings';
            or instead of these `environment`, of `make_environment`; `action_bound`, the largest action in units of
            the observer's action scale (1).

        Raises:
          InputError: if something can't be used.
        """
        self._all = _Engagements(render_mode, **options)
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
          InputError: if there are options, or the seed is no integer or negative.
        """
        super().reset(seed=_seeds(seed, options, 1)[0])
        if seed is not None or self._state is None:
            (self._noise,) = self.np_random.spawn(1)
        self._state, observation = self._all.plain.fresh(*_batch([self._all.begun(self.np_random)]))
        self._ended, self._given = False, np.pad(observation[0], (5, 0))
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
        if self._state is None or self._ended:
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked = self._all.action(action, (2,))
        normals = self._noise.standard_normal(self._all.plain.normals, np.float32)
        self._state, self._given = self._all.run(_alone, self._state, self._given, asked, normals)
        given = np.array(self._given)
        reward, ended, hit, *_ = given[:5].tolist()
        self._ended = ended > 0.0
        self._misses.append(given[3:5])
        return given[5:], reward, False, self._ended, {"miss": given[3:5], "hit": hit > 0.0}

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
        self._all = _Engagements(render_mode, **options)
        self.num_envs, self.render_mode, self._staggered = num_envs, render_mode, staggered
        self.single_observation_space, self.single_action_space = self._all.observations, self._all.actions
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {**self._all.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}
        self._generators, self._noises = ([np.random.default_rng()] * num_envs for _ in range(2))
        self._state: Any = None
        self._place = 0  # in a block of decisions
        self._misses = deque[tuple[Floats, BoolArray]](maxlen=REMEMBERED)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin all engagements; the same seeds begin the same sequences of them.

        Args:
          seed: environment i gets seed + i, or its own of a sequence, None in it for none; None if it continues.
          options: none.

        Raises:
          InputError: if there is not one seed per environment, one is negative, or there are options.
        """
        seeds = _seeds(seed, options, self.num_envs)
        super().reset(seed=seeds[0])
        for place, each in enumerate(seeds):
            if each is not None or self._state is None:  # else its sequence continues
                self._generators[place], _ = gymnasium.utils.seeding.np_random(each)
                (self._noises[place],) = self._generators[place].spawn(1)
        first = Environment.begin if self._staggered else Environment.fresh
        self._next = [self._all.begun(each) for each in self._generators]
        self._state, observation = self._all.run(first, *_batch(self._next))
        self._taken = np.ones(self.num_envs, bool)
        self._refill()
        self._misses.clear()
        return np.array(observation), {}

    def step(self, actions: Floats) -> tuple[Floats, Floats, BoolArray, BoolArray, dict[str, Any]]:
        """Decide and fire in all environments.

        Args:
          actions: clipped to the action space, shape (B, 2).

        Returns:
          Observations, of the next engagement where one ended; rewards [m]; no termination; whether time is up; `miss`
          and `hit` of the shots, and where one ended its last observation in `final_obs`, as Gymnasium has it.

        Raises:
          InputError: if the actions are not finite numbers of that shape.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        asked = self._all.action(actions, (self.num_envs, 2))
        if self._place == self._all.shortest:
            self._refill()
        self._state, *given = self._all.run(_step, self._state, asked, self._normals[self._place], self._fresh)
        observation, final, (reward, up, hits, *missed) = (np.array(each) for each in given)
        ended, hit, miss = up > 0.0, hits > 0.0, np.stack(missed, axis=-1)
        self._place, self._taken = self._place + 1, self._taken | ended
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
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        return tuple(self._all.picture(self._state, each, self._recent(each)) for each in range(self.num_envs))

    def _refill(self) -> None:
        """Draw for a block of decisions, in which no environment ends twice: noise, and engagements for those taken."""
        shape = (self._all.shortest, self._all.plain.normals)
        self._normals = np.stack([each.standard_normal(shape, np.float32) for each in self._noises], axis=1)
        if self._taken.any():
            pairs = zip(self._taken, self._generators, self._next, strict=True)
            self._next = [self._all.begun(each) if taken else kept for taken, each, kept in pairs]
            self._fresh = self._all.run(Environment.fresh, *_batch(self._next))
        self._place, self._taken = 0, np.zeros(self.num_envs, bool)

    def _recent(self, member: int) -> list[Floats]:
        """Return the last misses of an engagement, and none of the one before it."""
        recent: list[Floats] = []
        for miss, ended in self._misses:
            recent = [] if ended[member] else [*recent, miss[member]]
        return recent

"""The environment that `train` trains in for Gymnasium: one engagement after the other, or many side by side.

    import gymnasium
    env = gymnasium.make("archerfish.learning.gymnasium:archerfish/Shooting-v0", robot="my-robot", task="any")

Each environment has two generators, one of its engagements and one of the noise of its decisions: so environment i of
seed s has the engagements of a single one of seed s + i, though the next one is prepared while one runs. A step is
compiled; without JAX, or in a process that was forked while JAX was loaded, where its threads are missing, it runs in
NumPy.
"""

import dataclasses
import functools
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from archerfish.arrays import map_arrays, namespace, select
from archerfish.compiled import forked, has_jax, import_jax
from archerfish.controllers.policy.observer import Observer
from archerfish.errors import InputError
from archerfish.learning import register_environments
from archerfish.learning.environment import Environment, make_environment
from archerfish.simulation.picture import REMEMBERED, Picture, draw_picture

_OPTIONS = ("robot", "task", "config", "reward")  # of `make_environment`
_OTHERS = ', environment, action_bound, render_mode "rgb_array" or None, of own vectors staggered, autoreset_mode'
OBSERVATION_BOUND = 1e6
"""Far beyond any number of an observation; Gymnasium advises against spaces without bounds."""
Floats = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

register_environments()


class _Engagements:
    """What both adapters share: the environment, its spaces, its programs, and the draws of engagements."""

    render_mode: str | None = None
    _spec: EnvSpec | None = None
    _state: Any = None  # of the environment, from the first reset on
    _misses: Floats  # of the last pellets [m], the newest last, (REMEMBERED, B, 2)

    def _make(self, mode: Any, environment: Any = None, action_bound: float = 1.0, **options: Any) -> tuple[Any, Any]:
        """Take the options, and return the spaces of observations and of actions."""
        unknown = [name for name in options if name not in _OPTIONS]
        if unknown or mode not in (None, "rgb_array"):
            found = ", ".join(unknown) or f"render_mode {mode!r}"
            raise InputError(f"expected options {', '.join(_OPTIONS)}{_OTHERS}; got {found}; correct it")
        if not 0.0 < action_bound < np.inf:
            raise InputError(f"action_bound must be finite and > 0, got {action_bound}; 1 is usual")
        if environment is not None and options:
            raise InputError(f"an environment is given, so {', '.join(options)} can't be; give one or the other")
        made = make_environment(**options) if environment is None else environment
        if not isinstance(made, Environment):
            raise InputError(f"environment must be from make_environment, got {made!r}; or give robot and task")
        self.environment: Environment = map_arrays(np.asarray, made)
        self.render_mode, self._bound = mode, np.float32(action_bound)
        ends = self.environment.scenario.lengths / self.environment.world.period
        self._shortest, self._longest = (round(float(decisions)) for decisions in ends)
        size = self.environment.fresh(*_batch([self._begun(np.random.default_rng(0))]))[1].shape[-1]
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / self.environment.world.period_s)}
        box: Any = gymnasium.spaces.Box
        observations = box(-OBSERVATION_BOUND, OBSERVATION_BOUND, (size,), np.float32)
        return observations, box(-action_bound, action_bound, (2,), np.float32)

    @property
    def observer(self) -> Observer:
        """What turns what is seen into observations, and actions into commands."""
        return self.environment.observer

    @property
    def spec(self) -> EnvSpec | None:
        """How it was made by Gymnasium, with the decisions of the longest engagement; None where it was not."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec and dataclasses.replace(spec, max_episode_steps=self._longest)

    @functools.cached_property
    def _on_device(self) -> Any:
        """The environment as JAX's arrays; None without JAX."""
        return import_jax().tree.map(import_jax().numpy.asarray, self.environment) if has_jax() else None

    def _begun(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        """Return the normals and uniforms that a new engagement begins with."""
        normals = generator.standard_normal(self.environment.normals, np.float32)
        return normals, generator.random(self.environment.uniforms, np.float32)

    def _run(self, function: Any, *arguments: Any) -> Any:
        """Return what a function of the environment gives, compiled if that is possible."""
        if not forked and self._on_device is not None:
            return _compiled(function)(self._on_device, *arguments)
        return function(self.environment, *map_arrays(np.asarray, arguments))

    def _action(self, action: Any, shape: tuple[int, ...]) -> Floats:
        """Return actions within the bound as float32, if that is what they can be."""
        try:
            found = np.asarray(action)
        except ValueError:  # ragged
            found = np.asarray(action, object)
        what = f"{found.dtype} of shape {found.shape}"
        if found.shape == shape and found.dtype.kind in "fiu":
            if np.isfinite(found).all():
                # Before they are float32, where a large number would overflow.
                taken: Floats = np.minimum(np.maximum(found, -self._bound), self._bound).astype(np.float32)
                return taken
            what = "a number that is not finite"
        raise InputError(f"an action must be finite numbers of shape {shape}, pitch and yaw, got {what}; correct it")

    def _picture(self, member: int) -> Picture:
        """Draw an engagement, with the pellets since it began."""
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        world, state = self.environment.world, map_arrays(np.asarray, self._state.world)
        seen, plate = world.see(state), state.engagement.target.at(state.time).position[member, 0]
        angle, command = seen.gimbal.angle[member], seen.command[member]
        return draw_picture(angle, command, plate, self._misses[:, member], float(world.hit_radius))

    def _remember(self, miss: Floats, begins: BoolArray) -> None:
        """Remember the pellets of a decision for pictures, and none from before an engagement's begin, shape (B,)."""
        if self.render_mode is not None:
            self._misses = np.concatenate([self._misses[1:], miss[None]])
            self._misses[:, begins] = np.nan


@functools.cache
def _compiled(function: Any) -> Any:
    """Return a function's program, which all environments share."""
    return import_jax().jit(function)


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


def _chosen(_: Environment, condition: Any, one: Any, other: Any) -> Any:
    """Return the states of some environments from one batch, the rest from the other."""
    return select(condition, one, other)


def _seeds(seed: Any, count: int) -> list[int | None]:
    """Return the seed of each environment, None where a sequence continues, or raise InputError."""
    one = np.ndim(seed) == 0
    seeds = [seed] * count if one else list(seed)
    if len(seeds) != count:
        raise InputError(f"seed must be one per environment: expected {count}, got {len(seeds)}; or give a single one")
    for number in seeds:
        if number is not None and not (isinstance(number, int | np.integer) and number >= 0):
            raise InputError(f"seed must be an integer of at least 0, got {number!r}; give another one")
    return [None if number is None else int(number) + one * member for member, number in enumerate(seeds)]


class ShootingEnv(_Engagements, gymnasium.Env[Floats, Floats]):
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
        self.observation_space, self.action_space = self._make(render_mode, **options)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin the next engagement; a seed begins a sequence of them.

        Args:
          seed: of everything random from now on.
          options: none.

        Raises:
          InputError: if there are options, or the seed is no integer or negative.
        """
        if options:
            raise InputError(f"reset takes no options, got {', '.join(options)}; give them when making it")
        super().reset(seed=_seeds(seed, 1)[0])
        if seed is not None or self._state is None:
            (self._noise,) = self.np_random.spawn(1)
        self._state, observation = self.environment.fresh(*_batch([self._begun(self.np_random)]))
        self._ended, self._given = False, np.pad(observation[0], (5, 0))
        self._misses = np.full((REMEMBERED, 1, 2), np.nan, np.float32)
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
        asked = self._action(action, (2,))
        normals = self._noise.standard_normal(self.environment.normals, np.float32)
        self._state, self._given = self._run(_alone, self._state, self._given, asked, normals)
        given = np.array(self._given)
        reward, ended, hit, *_ = given[:5].tolist()
        self._ended = ended > 0.0
        self._remember(given[None, 3:5], np.array([False]))
        return given[5:], reward, False, self._ended, {"miss": given[3:5], "hit": hit > 0.0}

    def render(self) -> Picture | None:
        """Draw the engagement for "rgb_array", shape (height, width, 3)."""
        return None if self.render_mode is None else self._picture(0)


class ShootingVectorEnv(_Engagements, gymnasium.vector.VectorEnv[Floats, Floats, NDArray[Any]]):
    """Engagements side by side in one compiled step; no transition is lost in any of Gymnasium's autoreset modes."""

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        staggered: bool = False,
        autoreset_mode: str | AutoresetMode = AutoresetMode.SAME_STEP,
        max_episode_steps: int | None = None,
        **options: Any,
    ) -> None:
        """Make environments.

        Args:
          num_envs: B engagements.
          render_mode: "rgb_array" or None.
          staggered: whether the first engagements are cut to different lengths, so that a batch has all phases.
          autoreset_mode: when an engagement that has ended is replaced: in the same step, in the next one (which takes
            no action of it), or by `reset(options={"reset_mask": ended})` alone.
          max_episode_steps: that of the task's longest engagement, as a spec of Gymnasium has it.
          options: as of `ShootingEnv`.

        Raises:
          InputError: if something can't be used.
        """
        if num_envs < 1:
            raise InputError(f"num_envs must be at least 1, got {num_envs}; give more")
        self.num_envs, self._staggered, self._mode = num_envs, staggered, _autoreset_mode(autoreset_mode)
        self.single_observation_space, self.single_action_space = self._make(render_mode, **options)
        if max_episode_steps not in (None, self._longest):
            remedy = "give a task with other lengths_s"
            raise InputError(f"max_episode_steps of the task is {self._longest}, got {max_episode_steps}; {remedy}")
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata |= {"autoreset_mode": self._mode}
        self._generators, self._noises = ([np.random.default_rng()] * num_envs for _ in range(2))
        self._next: list[Any] = [None] * num_envs  # what the next engagements begin with
        self._taken = np.zeros(num_envs, bool)  # whose next engagement runs already
        self._waits = np.zeros(num_envs, bool)  # which have ended, and show their next engagement later
        self._normals = np.zeros((self._shortest, num_envs, self.environment.normals), np.float32)
        self._used = np.full(num_envs, self._shortest)  # of these normals
        self._place = 0  # decisions since the next engagements were prepared
        self._shown = np.zeros(self.observation_space.shape or (), np.float32)  # as returned last
        self._following = self._shown  # the next engagement's first where one has ended
        self._misses = np.full((REMEMBERED, num_envs, 2), np.nan, np.float32)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin engagements; the same seeds begin the same sequences of them.

        Args:
          seed: environment i gets seed + i, or its own of a sequence, None in it for none; None if it continues.
          options: `reset_mask`, which environments begin, the others go on, bool, shape (B,); all if not given.

        Raises:
          InputError: if there is not one seed per environment, one is negative, or there are other options.
        """
        mask, seeds = self._reset_mask(options or {}), _seeds(seed, self.num_envs)
        super().reset(seed=seeds[0])
        seeded = mask & [self._state is None or seed is not None for seed in seeds]  # else its sequence continues
        for member in np.flatnonzero(seeded):
            self._generators[member], _ = gymnasium.utils.seeding.np_random(seeds[member])
            (self._noises[member],) = self._generators[member].spawn(1)
        self._used[seeded] = self._shortest
        self._prepare(self._taken | seeded)
        staggered = self._staggered and mask.all()
        state, observation = self._run(Environment.begin, *_batch(self._next)) if staggered else self._fresh
        replaced = mask & (seeded | ~self._waits)
        self._state = state if replaced.all() else self._run(_chosen, replaced, state, self._state)
        self._following = np.where(replaced[:, None], observation, self._following)
        self._shown = np.where(mask[:, None], self._following, self._shown)
        self._waits = self._waits & ~mask
        self._prepare(replaced)
        self._misses[:, mask] = np.nan
        return self._shown.copy(), {}

    def step(self, actions: Floats) -> tuple[Floats, Floats, BoolArray, BoolArray, dict[str, Any]]:
        """Decide and fire in all environments.

        Args:
          actions: clipped to the action space, shape (B, 2).

        Returns:
          Observations; rewards [m]; no termination; whether time is up; `miss` and `hit` of the shots. If engagements
          are replaced in the same step, an observation is of the next one where one ended, and the last of the one that
          ended is in `final_obs`, as Gymnasium has it.

        Raises:
          InputError: if the actions are not finite numbers of that shape.
        """
        waits = self._waits
        if self._state is None or (self._mode is AutoresetMode.DISABLED and waits.any()):
            raise gymnasium.error.ResetNeeded('call reset before step, with options={"reset_mask": those that ended}')
        asked = self._action(actions, (self.num_envs, 2))
        if self._place == self._shortest:
            self._prepare(self._taken)
        for member in np.flatnonzero(self._used == self._shortest):
            shape = self._shortest, self.environment.normals
            self._normals[:, member] = self._noises[member].standard_normal(shape, np.float32)
            self._used[member] = 0
        normals = self._normals[self._used, np.arange(self.num_envs)]
        state, *results = self._run(_step, self._state, asked, normals, self._fresh)
        self._state = self._run(_chosen, waits, self._state, state) if waits.any() else state
        following, final, (reward, up, hits, *missed) = (np.array(array) for array in results)
        ended, hit, miss = (up > 0.0) & ~waits, hits > 0.0, np.stack(missed, axis=-1)
        self._place, self._used, self._taken = self._place + 1, self._used + ~waits, self._taken | ended
        self._remember(miss, ended | waits)
        counts = ~waits
        infos: dict[str, Any] = {}
        if self._mode is AutoresetMode.SAME_STEP:
            counts, self._shown = ~ended, following
            if ended.any():
                last = np.full(self.num_envs, None, object)
                for member in np.flatnonzero(ended):
                    last[member] = final[member]
                shots = {"miss": miss, "_miss": ended.copy(), "hit": hit, "_hit": ended.copy()}
                infos = {"final_obs": last, "_final_obs": ended.copy()}
                infos |= {"final_info": shots, "_final_info": ended.copy()}
        else:
            reward[waits] = 0.0
            following[waits] = final[waits] = self._following[waits]
            self._waits, self._shown = ended.copy(), final
        self._following = following
        infos |= {"miss": miss, "_miss": counts, "hit": hit, "_hit": counts.copy()}
        return self._shown.copy(), reward, ended & False, ended, infos

    def render(self) -> tuple[Picture, ...] | None:
        """Draw every engagement for "rgb_array", each of shape (height, width, 3)."""
        return None if self.render_mode is None else tuple(map(self._picture, range(self.num_envs)))

    def _reset_mask(self, options: dict[str, Any]) -> BoolArray:
        if others := [str(name) for name in options if name != "reset_mask"]:
            raise InputError(f"reset takes reset_mask alone, got {', '.join(others)}; give them when making it")
        every = np.ones(self.num_envs, bool)
        mask: BoolArray = np.asarray(options.get("reset_mask", every))
        if mask.shape != every.shape or mask.dtype != bool or (self._state is None and not mask.all()):
            found = f"{mask.dtype} of shape {mask.shape}"
            raise InputError(f"reset_mask must be bool of shape {every.shape}, all at first, got {found}; correct it")
        return mask

    def _prepare(self, members: BoolArray) -> None:
        """Draw the next engagements of some environments, for decisions in which no environment ends twice."""
        for member in np.flatnonzero(members):
            self._next[member] = self._begun(self._generators[member])
        if members.any():
            self._fresh = self._run(Environment.fresh, *_batch(self._next))
        self._place, self._taken = 0, np.zeros(self.num_envs, bool)


def _autoreset_mode(mode: str | AutoresetMode) -> AutoresetMode:
    """Return the mode of a name, as NEXT_STEP or NextStep."""
    for known in AutoresetMode:
        if mode in (known, known.name, known.value):
            return known
    raise InputError(f"autoreset_mode must be one of {', '.join(AutoresetMode.__members__)}, got {mode!r}; correct it")

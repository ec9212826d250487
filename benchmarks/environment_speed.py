"""How fast the environment alone is: in one compiled loop, through the vector adapter, and one at a time."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import archerfish.simulation.registration  # noqa: F401  # registers the environments
from archerfish.learning.config import PpoConfig
from archerfish.learning.shards import over_shards, own_key
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.vector_env import ShootingVectorEnv

ROUNDS = 5
SHARDS = PpoConfig().shards
ROLLOUT = 100
"""Steps of a compiled loop: its noise is drawn in one call, as in training."""


def environment_speeds(environment: ShootingEnvironment, environments: int, steps: int) -> dict[str, float]:
    """Return steps per second, all environments together, of each way to run them.

    Args:
      environment: where.
      environments: side by side.
      steps: of the adapters.
    """
    single = gymnasium.make("archerfish/Shooting-v0", environment=environment)
    return {
        "compiled": _compiled(environment, environments),
        "vector adapter": _vector(environment, environments, steps),
        "Gymnasium, one at a time": _loop(single, steps),
        "the same, unwrapped": _loop(single.unwrapped, steps),
    }


def _best(function: Callable[[], Any], steps: int) -> float:
    """Return the steps per second of the fastest of a few rounds, after one that compiles."""
    function()
    times = []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        function()
        times.append(time.perf_counter() - begun)
    return steps / min(times)


def _compiled(environment: ShootingEnvironment, environments: int) -> float:
    arrays = jax.tree.map(jnp.asarray, environment)
    state, _ = jax.jit(lambda made, *draws: made.begin(*draws))(
        arrays, *_draws(arrays, environments, jax.random.key(0))
    )
    own = environments // SHARDS

    def shard(made: ShootingEnvironment, state: Any, key: Array) -> Any:
        keys = jax.random.split(own_key(key), 2)
        normals = jax.random.normal(keys[0], (ROLLOUT, made.normals, own))
        uniforms = jax.random.uniform(keys[1], (ROLLOUT, made.uniforms, own))

        def step(state: Any, draws: tuple[Array, Array]) -> Any:
            state, outcome = made.step(state, jnp.zeros((own, 2)), *(each.T for each in draws))
            # What a training keeps of a step, so that none of it is optimised away.
            return state, (outcome.observation, outcome.final_observation, outcome.reward)

        return jax.lax.scan(step, state, (normals, uniforms))

    run = jax.jit(over_shards(shard, SHARDS, (False, True, False), True))
    return _best(lambda: jax.block_until_ready(run(arrays, state, jax.random.key(1))), ROLLOUT * environments)


def _draws(made: ShootingEnvironment, environments: int, key: Array) -> tuple[Array, Array]:
    first, second = jax.random.split(key)
    normals = jax.random.normal(first, (environments, made.normals))
    return normals, jax.random.uniform(second, (environments, made.uniforms))


def _vector(environment: ShootingEnvironment, environments: int, steps: int) -> float:
    env = ShootingVectorEnv(environments, environment)
    env.reset(seed=0)
    actions = np.zeros((environments, 2), np.float32)

    def run(count: int) -> None:
        for _ in range(count):
            env.step(actions)

    rounds = max(1, steps // 10)
    return _best(partial(run, rounds), rounds * environments)


def _loop(env: gymnasium.Env[Any, Any], steps: int) -> float:
    env.reset(seed=0)
    action = np.zeros(2, np.float32)

    def run() -> None:
        for _ in range(steps):
            if env.step(action)[3]:
                env.reset()

    return _best(run, steps)

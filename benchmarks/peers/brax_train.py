"""Adapter: PPO of Brax in our compiled environment, with begin-anew of our own.

Brax's wrapper would begin every engagement of an environment at the same target, so ours draws a new one. It masks the
step at which time is up instead of bootstrapping it. `jax.device_put_replicated`, which it calls once, is gone from JAX
and is put back.
"""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from training_protocol import ACTION_BOUND, Case, Log, Policy, main, shooting_environment


def _replicated(tree: Any, devices: list[Any]) -> Any:
    place = jax.sharding.NamedSharding(jax.sharding.Mesh(np.array(devices), ("d",)), jax.sharding.PartitionSpec("d"))
    return jax.tree.map(lambda each: jax.device_put(jnp.stack([jnp.asarray(each)] * len(devices)), place), tree)


if not hasattr(jax, "device_put_replicated"):
    jax.device_put_replicated = _replicated

from brax.envs.base import Env, State  # noqa: E402
from brax.training.agents.ppo import networks  # noqa: E402
from brax.training.agents.ppo.train import train as brax_train  # noqa: E402

CHUNK = 4
"""Iterations per compiled call, as ours."""


class Shooting(Env):
    """A batch of engagements."""

    def __init__(self) -> None:
        self._environment = jax.tree.map(jnp.asarray, shooting_environment())

    def reset(self, rng: jax.Array) -> State:
        """Begin a batch, staggered, with one key of each."""
        key, own = jax.random.split(rng[0])
        state, observation = self._environment.begin(*self._draws(own, len(rng)))
        zero = jnp.zeros(len(rng))
        # Brax asks for two entries that it does not use here.
        unused = {"episode_metrics": {}, "episode_done": zero}
        return State(state, observation, zero, zero, {}, {**unused, "truncation": zero, "key": key})

    def step(self, state: State, action: jax.Array) -> State:
        """Take one decision in all engagements."""
        key, own = jax.random.split(state.info["key"])
        asked = jnp.clip(action, -ACTION_BOUND, ACTION_BOUND)
        following, outcome = self._environment.step(state.pipeline_state, asked, *self._draws(own, len(action)))
        ended = outcome.truncated.astype(jnp.float32)
        info = {**state.info, "truncation": ended, "key": key}
        return state.replace(
            pipeline_state=following, obs=outcome.observation, reward=outcome.reward, done=ended, info=info
        )

    def _draws(self, key: jax.Array, batch: int) -> tuple[jax.Array, jax.Array]:
        first, second = jax.random.split(key)
        normals = jax.random.normal(first, (batch, self._environment.normals))
        return normals, jax.random.uniform(second, (batch, self._environment.uniforms))

    @property
    def observation_size(self) -> int:
        """Numbers of an observation."""
        return self._environment.observed

    @property
    def action_size(self) -> int:
        """Numbers of an action."""
        return 2

    @property
    def backend(self) -> str:
        """Not one of Brax's."""
        return "none"


def train(case: Case, log: Log) -> None:
    """Train with one learning rate, which does not fall, on as many devices as the case has threads."""
    jax.config.update("jax_num_cpu_devices", case.threads)
    calls = max(1, round(case.iterations / CHUNK))

    def note(steps: int, _: Any, parameters: Any) -> None:
        if steps == 0:
            log.begin()
        else:
            log.passed(steps, functools.partial(_policy, parameters))

    brax_train(
        environment=Shooting(),
        wrap_env=False,
        num_timesteps=calls * CHUNK * case.batch,
        num_envs=case.environments,
        num_eval_envs=case.environments,
        episode_length=50,
        learning_rate=case.learning_rate,
        entropy_cost=0.0,
        discounting=case.discount,
        unroll_length=case.rollout,
        batch_size=case.environments // case.minibatches,
        num_minibatches=case.minibatches,
        num_updates_per_batch=case.epochs,
        normalize_observations=True,
        clipping_epsilon=case.clip,
        gae_lambda=case.trace,
        max_grad_norm=case.gradient_norm,
        network_factory=functools.partial(
            networks.make_ppo_networks,
            policy_hidden_layer_sizes=(case.hidden,),
            value_hidden_layer_sizes=(case.hidden,),
            activation=jax.nn.relu,
            distribution_type="normal",
            noise_std_type="log",
            init_noise_std=math.exp(case.log_std),
            mean_kernel_init_fn=jax.nn.initializers.orthogonal,
            mean_kernel_init_kwargs={"scale": 0.01},
        ),
        seed=case.seed,
        num_evals=calls + 1,
        run_evals=False,
        policy_params_fn=note,
    )


def _policy(parameters: Any) -> Policy:
    seen, actor, _ = parameters
    dense = actor["params"]["MLP_0"]["hidden_0"], actor["params"]["Dense_0"]
    layers = tuple((np.asarray(each["kernel"]), np.asarray(each["bias"])) for each in dense)
    return Policy(np.asarray(seen.mean), np.asarray(seen.std) ** 2, layers)


if __name__ == "__main__":
    main(train)

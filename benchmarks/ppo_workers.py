"""PPO by Archerfish, Stable-Baselines3 and Brax in one environment, each in a process that trains when asked to."""

import functools
import importlib
import json
import math
import os
import sys
import time
from collections.abc import Callable
from typing import Any

OURS, SB3, BRAX = "archerfish", "stable-baselines3", "brax"
ACTION_BOUND, CALLS, CHUNK = 5.0, 100_000, 4
"""Beyond what a trained policy commands; calls of Brax, more than there are turns; iterations in a call, as ours."""
Turn = Callable[[int], None]


def setting(observation: str) -> tuple[Any, Any]:
    """Return the environment that all train in, and the settings of PPO."""
    from archerfish.learning.config import TrainConfig
    from archerfish.learning.environment import make_environment
    from archerfish.robot import Robot
    from archerfish.task import Task

    robot, task = Robot.paper(), Task.load("paper").replace(command_limit="box")
    config = TrainConfig(trainer="ppo", observation=observation, reward="eq-8").resolved(robot, task)
    return make_environment(robot, task, config=config), config.ppo


def train_ours(environment: Any, config: Any, devices: int, turn: Turn) -> None:
    """Train as `archerfish.train` does."""
    from archerfish.learning import learner, shards
    from archerfish.learning.ppo import PPO

    jax: Any = importlib.import_module("jax")
    shards.claim_devices(devices)
    environment = jax.tree.map(jax.numpy.asarray, environment)
    state = shards.placed(PPO.begin(environment, config, jax.random.key(0)), config.shards, learner.SPLIT)
    while True:
        state, _ = jax.block_until_ready(PPO.advance(environment, config, state, CHUNK))
        turn(CHUNK * config.batch)


def train_sb3(environment: Any, config: Any, threads: int, turn: Turn) -> None:
    """Train by Stable-Baselines3 in its vector environment of ours."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    from archerfish.learning.stable_baselines import ShootingVecEnv

    torch: Any = importlib.import_module("torch")
    torch.set_num_threads(threads)

    class Turns(BaseCallback):  # type: ignore[misc]  # its package may be missing
        def _on_rollout_start(self) -> None:
            if self.num_timesteps:  # else nothing has been trained yet
                turn(config.batch)

        def _on_step(self) -> bool:
            return True

    envs = ShootingVecEnv(config.environments, environment=environment, action_bound=ACTION_BOUND, staggered=True)
    model = PPO(
        "MlpPolicy",
        VecNormalize(envs, norm_reward=False),
        learning_rate=config.actor_learning_rate,
        n_steps=config.rollout,
        batch_size=config.batch // config.minibatches,
        n_epochs=config.epochs,
        gamma=config.discount,
        gae_lambda=config.trace,
        clip_range=config.clip,
        max_grad_norm=config.gradient_norm,
        policy_kwargs={
            "net_arch": [config.hidden],
            "activation_fn": torch.nn.ReLU,
            "log_std_init": config.log_std,
        },
        seed=0,
        device="cpu",
    )
    model.learn(CALLS * config.batch, callback=Turns())


def train_brax(environment: Any, config: Any, devices: int, turn: Turn) -> None:
    """Train by Brax, with our environment in the place of its own."""
    jax: Any = importlib.import_module("jax")
    jax.config.update("jax_num_cpu_devices", devices)
    if not hasattr(jax, "device_put_replicated"):  # Brax calls it once; it is gone from JAX
        jax.device_put_replicated = _replicated
    networks: Any = importlib.import_module("brax.training.agents.ppo.networks")
    importlib.import_module("brax.training.agents.ppo.train").train(
        environment=brax_environment(environment),
        wrap_env=False,  # its wrapper would begin every engagement at the same target
        num_timesteps=CALLS * CHUNK * config.batch,
        num_evals=CALLS + 1,
        run_evals=False,
        policy_params_fn=lambda steps, *_: turn(CHUNK * config.batch) if steps else None,
        num_envs=config.environments,
        episode_length=50,
        unroll_length=config.rollout,
        batch_size=config.environments // config.minibatches,
        num_minibatches=config.minibatches,
        num_updates_per_batch=config.epochs,
        learning_rate=config.actor_learning_rate,
        entropy_cost=config.entropy,
        discounting=config.discount,
        gae_lambda=config.trace,
        clipping_epsilon=config.clip,
        max_grad_norm=config.gradient_norm,
        normalize_observations=True,
        network_factory=functools.partial(
            networks.make_ppo_networks,
            policy_hidden_layer_sizes=(config.hidden,),
            value_hidden_layer_sizes=(config.hidden,),
            activation=jax.nn.relu,
            distribution_type="normal",
            noise_std_type="log",
            init_noise_std=math.exp(config.log_std),
            mean_kernel_init_fn=jax.nn.initializers.orthogonal,
            mean_kernel_init_kwargs={"scale": 0.01},
        ),
    )


def brax_environment(environment: Any) -> Any:
    """Return our environment as Brax has them: a batch of engagements that replaces those that end by itself."""
    jax: Any = importlib.import_module("jax")
    base: Any = importlib.import_module("brax.envs.base")
    environment = jax.tree.map(jax.numpy.asarray, environment)

    def drawn(key: Any, batch: int) -> tuple[Any, Any]:
        keys, shapes = jax.random.split(key), ((environment.normals, batch), (environment.uniforms, batch))
        return jax.random.normal(keys[0], shapes[0]).T, jax.random.uniform(keys[1], shapes[1]).T

    class Shooting(base.Env):  # type: ignore[misc]
        action_size, backend = 2, "none"
        observation_size = environment.begin(*drawn(jax.random.key(0), 1))[1].shape[-1]

        def reset(self, rng: Any) -> Any:
            """Begin a batch, staggered, with one key of each."""
            key, own = jax.random.split(rng[0])
            state, observation = environment.begin(*drawn(own, len(rng)))
            zero = jax.numpy.zeros(len(rng))
            info = {"truncation": zero, "episode_done": zero, "episode_metrics": {}, "key": key}
            return base.State(state, observation, zero, zero, {}, info)

        def step(self, state: Any, action: Any) -> Any:
            """Take one decision in all engagements."""
            inner, (key, noise, own) = state.pipeline_state, jax.random.split(state.info["key"], 3)
            # In four steps of five none ends, and nothing has to be drawn.
            fresh = jax.lax.cond(
                jax.numpy.any(inner.left <= 1),
                lambda: environment.fresh(*drawn(own, len(action))),
                lambda: (inner, state.obs),
            )
            normals = jax.random.normal(noise, (environment.normals, len(action))).T
            action = jax.numpy.clip(action, -ACTION_BOUND, ACTION_BOUND)
            inner, step = environment.step(inner, action, normals, fresh)
            ended = jax.numpy.float32(step.truncated)
            facts = {"pipeline_state": inner, "obs": step.observation, "reward": step.reward, "done": ended}
            return state.replace(**facts, info={**state.info, "truncation": ended, "key": key})

    return Shooting()


def _replicated(tree: Any, devices: list[Any]) -> Any:
    jax: Any = importlib.import_module("jax")
    mesh = jax.sharding.Mesh(devices, ("device",))
    place = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("device"))
    return jax.tree.map(lambda each: jax.device_put(jax.numpy.stack([each] * len(devices)), place), tree)


def work(name: str, threads: int, observation: str) -> None:
    """Train for as long as a parent asks on standard input, in turns of so many seconds."""
    import_jax: Any = importlib.import_module("archerfish.compiled").import_jax
    import_jax()
    begun, seconds, done = time.perf_counter(), 0.0, 0

    def turn(decisions: int) -> None:
        nonlocal begun, seconds, done
        done += decisions
        if time.perf_counter() - begun < seconds:
            return
        print(json.dumps([done, time.perf_counter() - begun]), flush=True)
        line = sys.stdin.readline()
        if not line:
            os._exit(0)
        begun, seconds, done = time.perf_counter(), float(line), 0

    trainer = {OURS: train_ours, SB3: train_sb3, BRAX: train_brax}[name]
    trainer(*setting(observation), threads, turn)

"""Training by gradients through the simulator: the reward's own slope, where PPO estimates one from trials.

The simulator is differentiable, so the mean reward of a short window of decisions is a function of the policy's weights
like any other: the window is played, and the gradient comes back through all its steps of environment and network.
Adam follows it. The states go on from window to window, the gradient does not.

What it can't see: anything that jumps, such as a hit that is not smoothed, and what comes of a window's decisions after
its end.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array

from archerfish.controllers.network import Normaliser, normalise
from archerfish.learning.gradient_config import GradientConfig
from archerfish.learning.guard import LIMITS, first_fault, is_bad
from archerfish.learning.held_gradient import held
from archerfish.learning.normalisation import empty_normaliser, merge
from archerfish.learning.ppo import Environment, Learner, Metrics, iterations_in_shards, orthogonal_layers
from archerfish.learning.shards import AXIS, averaged, earliest, own_key
from archerfish.learning.training import Trainer
from archerfish.learning.update import Actor, action_mean, adam_step, begin_networks

LAST_RATE = 0.05
"""Share of the learning rate that annealing leaves: less than PPO's, for the last milliradians need small steps."""


class Sizes(NamedTuple):
    """What the compiled program depends on, named as in `GradientConfig`; another set compiles anew."""

    environments: int
    window: int
    shards: int


class Hyper(NamedTuple):
    """What may change without compiling anew; scalars, named as in `GradientConfig`."""

    learning_rate: Array
    anneal_over: Array
    gradient_norm: Array
    engagement_norm: Array


class Played(NamedTuple):
    """What a window leaves."""

    state: Any
    """Of the environments."""
    observation: Array
    """For the next decision, shape (B, n)."""
    observations: Array
    """Before each decision, shape (W, B, n)."""
    mean_reward: Array
    """Per decision, shape ()."""
    hit_share: Array
    """Share of the decisions that hit, shape ()."""


def begin_learner(environment: Environment, config: GradientConfig, key: Array, actions: int = 2) -> Learner:
    """Begin training.

    Args:
      environment: where.
      config: settings.
      key: PRNG key; is consumed.
      actions: numbers of an action.

    Returns:
      A learner without a critic, and whose actor has no standard deviations: it always acts as its mean.
    """
    learner: Learner = _begin(environment, key, config.environments, config.widths, actions)
    return learner


@partial(jax.jit, static_argnames=("batch", "hidden", "actions"))
def _begin(environment: Environment, key: Array, batch: int, hidden: tuple[int, ...], actions: int) -> Learner:
    key, weights, noise = jax.random.split(key, 3)
    state, observation = environment.begin(*jax.tree.map(lambda each: each[0].T, _draws(environment, 1, batch, noise)))
    layers = orthogonal_layers(weights, (environment.observed, *hidden, actions), last_gain=0.01)
    return Learner(
        networks=begin_networks(Actor(layers, jnp.zeros(0)), critic=()),
        normaliser=empty_normaliser(observation.shape[-1]),
        environment=state,
        observation=observation,
        key=key,
        iteration=jnp.int32(0),
    )


@partial(jax.jit, static_argnames=("size", "count"))
def iterate(
    environment: Environment, settings: Hyper, learner: Learner, size: Sizes, count: int
) -> tuple[Learner, Metrics]:
    """Play and follow the gradient `count` times.

    Args:
      environment: where to train; its arrays are arguments, so another world of the same shapes compiles nothing.
      settings: traced settings.
      learner: where training stands.
      size: of the windows; compiles once per set.
      count: iterations.

    Returns:
      The learner, of before the first bad iteration if there is one, and metrics of shape (count,).
    """
    return iterations_in_shards(_iteration, environment, settings, learner, size, count)


def _iteration(environment: Environment, settings: Hyper, learner: Learner, size: Sizes) -> tuple[Learner, Metrics]:
    key, noise = jax.random.split(learner.key)
    draws = _draws(environment, size.window, size.environments, own_key(noise))
    networks = learner.networks
    start = (learner.normaliser, learner.environment, learner.observation)
    gradient, played = jax.grad(window_loss, has_aux=True)(
        networks.actor, environment, *start, draws, settings.engagement_norm
    )
    gradient, mean_reward, hit_share = averaged((gradient, played.mean_reward, played.hit_share), AXIS)
    rate = settings.learning_rate * jnp.maximum(1.0 - learner.iteration / settings.anneal_over, LAST_RATE)
    actor, moments = adam_step(networks.actor, gradient, networks.actor_moments, rate, settings)
    norm = optax.tree.norm(gradient)
    bad = jnp.stack(
        [
            is_bad(played.observations, LIMITS["observation"]) | is_bad(played.observation, LIMITS["observation"]),
            is_bad(played.mean_reward, LIMITS["reward"]),
            is_bad(norm, LIMITS["gradient"]),
        ]
    )
    nothing = jnp.float32(0.0)
    metrics = Metrics(
        mean_reward=mean_reward,
        value_error=nothing,
        divergence=nothing,
        clipped_share=nothing,
        std=nothing,
        gradient_norm=norm,
        hit_share=hit_share,
        fault=earliest(first_fault(bad, ("observation", "reward", "gradient"))),
    )
    advanced = Learner(
        networks=networks._replace(actor=actor, actor_moments=moments),
        # The statistics change between iterations only, and no gradient goes through them.
        normaliser=merge(learner.normaliser, played.observations.reshape(-1, played.observations.shape[-1]), AXIS),
        environment=played.state,
        observation=played.observation,
        key=key,
        iteration=learner.iteration + 1,
    )
    return advanced, metrics


def window_loss(
    actor: Actor,
    environment: Environment,
    normaliser: Normaliser,
    state: Any,
    observation: Array,
    draws: tuple[Array, Array],
    engagement_norm: Array | float = jnp.inf,
) -> tuple[Array, Played]:
    """Play a window and return the negative of its mean reward, to be differentiated by the actor.

    Args:
      actor: the policy; acts as its mean.
      environment: where.
      normaliser: of the observations.
      state: of the environments.
      observation: for the first decision, shape (B, n).
      draws: normal and uniform ones for the environment, shapes (W, normals, B) and (W, uniforms, B).
      engagement_norm: see `GradientConfig`.
    """
    # The loss is a mean: each reward has this share in it.
    limit = jnp.asarray(engagement_norm / draws[0].shape[0] / len(observation))

    def decide(carry: tuple[Any, Array], draws: tuple[Array, Array]) -> tuple[tuple[Any, Array], tuple[Array, ...]]:
        state, observation = carry
        action = action_mean(actor, held(normalise(normaliser, observation), limit))
        state, outcome = environment.step(state, action, *(each.T for each in draws))
        return (state, outcome.observation), (observation, outcome.reward, outcome.hit)

    (state, following), (observations, rewards, hits) = jax.lax.scan(decide, (state, observation), draws)
    mean_reward = jnp.mean(rewards)
    hit_share = jnp.mean(jax.lax.stop_gradient(hits).astype(jnp.float32))
    return -mean_reward, Played(state, following, observations, mean_reward, hit_share)


def _draws(environment: Environment, window: int, batch: int, key: Array) -> tuple[Array, Array]:
    """Draw the noise of a window, in columns as PPO does."""
    keys = jax.random.split(key)
    return (
        jax.random.normal(keys[0], (window, environment.normals, batch)),
        jax.random.uniform(keys[1], (window, environment.uniforms, batch)),
    )


def _advance(environment: Environment, config: GradientConfig, learner: Learner, count: int) -> tuple[Learner, Metrics]:
    settings = Hyper(
        learning_rate=jnp.float32(config.learning_rate),
        anneal_over=jnp.float32(config.iterations if config.anneal else 1e9),
        gradient_norm=jnp.float32(config.gradient_norm),
        engagement_norm=jnp.float32(config.engagement_norm),
    )
    size = Sizes(config.environments, config.window, config.shards)
    advanced: tuple[Learner, Metrics] = iterate(environment, settings, learner, size, count)
    return advanced


GRADIENT = Trainer(begin_learner, _advance)
"""Gradients through the simulator."""

"""Proximal policy optimisation (PPO2), eqs (9) and (10), with the paper's network and settings as defaults.

One call of `iterate` is one compiled program: rollouts in a batch of environments, advantages, several epochs of
clipped updates, for a number of iterations. Everything that a run may want to vary without compiling anew (learning
rates, discount, the world, the scenario) is an argument.

Readings of the paper: the "attenuation factors" 0.001 and 0.003 are learning rates, and the critic estimates the value
of a state (docs/errata.md).
"""

from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import optax
from jax import Array

from archerfish.controllers.network import Layer, Normaliser, forward, normalise
from archerfish.learning.advantages import advantages
from archerfish.learning.config import PpoConfig
from archerfish.learning.gaussian import entropy, log_probability


class Environment(Protocol):
    """What PPO trains in: a pytree with pure functions; randomness enters as drawn arrays."""

    @property
    def normals(self) -> int:
        """Standard normals that a step needs per batch member."""

    @property
    def uniforms(self) -> int:
        """Uniform draws that a step needs per batch member."""

    def begin(self, normals: Any, uniforms: Any) -> tuple[Any, Any]:
        """Begin a batch: state and first observations."""

    def step(self, state: Any, action: Any, normals: Any, uniforms: Any) -> tuple[Any, Any]:
        """Advance a batch: state and outcome (see `simulation.environment.Outcome`)."""


class Hyper(NamedTuple):
    """What may change without compiling anew; scalars."""

    actor_learning_rate: Array
    critic_learning_rate: Array
    anneal_over: Array
    clip: Array
    discount: Array
    trace: Array
    entropy: Array
    gradient_norm: Array
    log_std_floor: Array


class Sizes(NamedTuple):
    """What the compiled program depends on; another set compiles anew."""

    environments: int
    rollout: int
    minibatches: int
    epochs: int


def sizes(config: PpoConfig) -> Sizes:
    """Take the sizes out of a configuration."""
    return Sizes(config.environments, config.rollout, config.minibatches, config.epochs)


def hyper(config: PpoConfig) -> Hyper:
    """Take the traced settings out of a configuration."""
    return Hyper(
        *(
            jnp.float32(value)
            for value in (
                config.actor_learning_rate,
                config.critic_learning_rate,
                config.iterations if config.anneal else 1e9,
                config.clip,
                config.discount,
                config.trace,
                config.entropy,
                config.gradient_norm,
                config.log_std_floor,
            )
        )
    )


class Actor(NamedTuple):
    """The policy's distribution: a network for the mean, one free standard deviation per action."""

    layers: tuple[Layer, ...]
    log_std: Array


class Learner(NamedTuple):
    """Everything that training needs to go on."""

    actor: Actor
    critic: tuple[Layer, ...]
    actor_moments: Any
    critic_moments: Any
    normaliser: Normaliser
    environment: Any
    observation: Array
    key: Array
    iteration: Array


class Metrics(NamedTuple):
    """One number per iteration."""

    mean_reward: Array
    """Mean reward per decision."""
    value_error: Array
    """Mean squared error of the value over its variance."""
    divergence: Array
    """Estimate of the Kullback–Leibler divergence of the update."""
    clipped_share: Array
    """Share of the samples that the clipping of eq (10) touched."""
    std: Array
    """Mean standard deviation of the actions."""


class Batch(NamedTuple):
    """One rollout, flattened for the updates; observations are normalised."""

    observation: Array
    action: Array
    log_probability: Array
    advantage: Array
    target: Array


_adam = optax.scale_by_adam(eps=1e-5)


def make_learner(environment: Environment, config: PpoConfig, key: Array, actions: int = 2) -> Learner:
    """Begin training.

    Args:
      environment: where.
      config: settings.
      key: PRNG key; is consumed.
      actions: numbers of an action.
    """
    keys = jax.random.split(key, 5)
    state, observation = environment.begin(
        jax.random.normal(keys[0], (config.environments, environment.normals)),
        jax.random.uniform(keys[1], (config.environments, environment.uniforms)),
    )
    size = observation.shape[-1]
    # Orthogonal weights; the small last layer of the actor begins with actions near zero.
    actor = Actor(
        _orthogonal(keys[2], (size, config.hidden, actions), 0.01), jnp.full(actions, jnp.float32(config.log_std))
    )
    critic = _orthogonal(keys[3], (size, config.hidden, 1), 1.0)
    return Learner(
        actor=actor,
        critic=critic,
        actor_moments=_adam.init(actor),
        critic_moments=_adam.init(critic),
        normaliser=Normaliser(jnp.zeros(size), jnp.ones(size), jnp.float32(0)),
        environment=state,
        observation=observation,
        key=keys[4],
        iteration=jnp.int32(0),
    )


def _orthogonal(key: Array, sizes: tuple[int, ...], last_gain: float) -> tuple[Layer, ...]:
    gains = [2.0**0.5] * (len(sizes) - 2) + [last_gain]
    keys = jax.random.split(key, len(gains))
    shapes = zip(sizes[:-1], sizes[1:], strict=True)
    return tuple(
        Layer(jax.nn.initializers.orthogonal(gain)(each, shape, jnp.float32), jnp.zeros(shape[1]))
        for each, shape, gain in zip(keys, shapes, gains, strict=True)
    )


@partial(jax.jit, static_argnames=("size", "count"))
def iterate(
    environment: Environment, settings: Hyper, learner: Learner, size: Sizes, count: int
) -> tuple[Learner, Metrics]:
    """Run a number of iterations in one compiled program.

    Args:
      environment: where to train; its arrays are arguments, so another world of the same shapes compiles nothing.
      settings: traced settings.
      learner: where training stands.
      size: of the batches; compiles once per set.
      count: iterations.

    Returns:
      The learner and metrics of shape (count,).
    """
    return jax.lax.scan(
        lambda learner, _: _iteration(environment, settings, learner, size), learner, length=count
    )


def _iteration(
    environment: Environment, settings: Hyper, learner: Learner, size: Sizes
) -> tuple[Learner, Metrics]:
    key, noise, order = jax.random.split(learner.key, 3)
    learner, batch, rewards, normaliser = _rollout(environment, settings, learner, size, noise)
    progress = jnp.minimum(learner.iteration / settings.anneal_over, 0.9)

    def minibatch(learner: Learner, rows: Array) -> tuple[Learner, Array]:
        return _update(settings, learner, jax.tree.map(lambda each: each[rows], batch), 1.0 - progress)

    rows = size.environments * size.rollout
    orders = jax.vmap(lambda key: jax.random.permutation(key, rows))(jax.random.split(order, size.epochs))
    learner, measures = jax.lax.scan(minibatch, learner, orders.reshape(size.epochs * size.minibatches, -1))
    value_error, divergence, clipped = jnp.mean(measures, axis=0)
    metrics = Metrics(rewards, value_error, divergence, clipped, jnp.mean(jnp.exp(learner.actor.log_std)))
    return learner._replace(key=key, normaliser=normaliser, iteration=learner.iteration + 1), metrics


def _rollout(
    environment: Environment, settings: Hyper, learner: Learner, size: Sizes, key: Array
) -> tuple[Learner, Batch, Array, Normaliser]:
    """Act for a while with the current policy, and judge what came of it."""
    keys = jax.random.split(key, 3)
    shape = (size.rollout, size.environments)
    # All noise of a rollout in three calls: many small ones cost a quarter of the time.
    draws = (
        jax.random.normal(keys[0], (*shape, learner.actor.log_std.shape[0])),
        jax.random.normal(keys[1], (*shape, environment.normals)),
        jax.random.uniform(keys[2], (*shape, environment.uniforms)),
    )
    std = jnp.exp(learner.actor.log_std)

    def act(carry: tuple[Any, Array], draws: tuple[Array, Array, Array]) -> tuple[tuple[Any, Array], Any]:
        state, observation = carry
        normal = normalise(learner.normaliser, observation)
        mean = forward(learner.actor.layers, normal)
        action = mean + std * draws[0]
        state, outcome = environment.step(state, action, draws[1], draws[2])
        chance = log_probability(action, mean, learner.actor.log_std)
        return (state, outcome.observation), (observation, normal, action, chance, outcome)

    (state, observation), (raw, normal, action, chance, outcome) = jax.lax.scan(
        act, (learner.environment, learner.observation), draws
    )
    values = forward(learner.critic, normal)[..., 0]
    next_values = forward(learner.critic, normalise(learner.normaliser, outcome.final_observation))[..., 0]
    gained = advantages(
        outcome.reward,
        values,
        next_values,
        outcome.terminated,
        outcome.truncated,
        settings.discount,
        settings.trace,
    )
    batch = Batch(normal, action, chance, gained, gained + values)
    flat = jax.tree.map(lambda each: each.reshape(-1, *each.shape[2:]), batch)
    # The statistics change between iterations only: rollout and updates see the same numbers.
    normaliser = _merge(learner.normaliser, raw.reshape(-1, raw.shape[-1]))
    return learner._replace(environment=state, observation=observation), flat, jnp.mean(outcome.reward), normaliser


def _merge(normaliser: Normaliser, observations: Array) -> Normaliser:
    """Add a batch to the running mean and variance (Chan's parallel formula)."""
    mean, variance, count = jnp.mean(observations, axis=0), jnp.var(observations, axis=0), observations.shape[0]
    total = normaliser.count + count
    share, shift = count / total, mean - normaliser.mean
    spread = (1 - share) * normaliser.variance + share * variance + share * (1 - share) * shift**2
    return Normaliser(normaliser.mean + share * shift, spread, total)


def _update(settings: Hyper, learner: Learner, batch: Batch, rate: Array) -> tuple[Learner, Array]:
    """Take one gradient step of the actor and one of the critic."""
    (_, (divergence, clipped)), actor_gradient = jax.value_and_grad(_actor_loss, has_aux=True)(
        learner.actor, batch, settings
    )
    value_error, critic_gradient = jax.value_and_grad(_critic_loss)(learner.critic, batch)
    actor, actor_moments = _adam_step(
        learner.actor, actor_gradient, learner.actor_moments, rate * settings.actor_learning_rate, settings
    )
    critic, critic_moments = _adam_step(
        learner.critic, critic_gradient, learner.critic_moments, rate * settings.critic_learning_rate, settings
    )
    actor = actor._replace(log_std=jnp.maximum(actor.log_std, settings.log_std_floor))
    learner = learner._replace(
        actor=actor, critic=critic, actor_moments=actor_moments, critic_moments=critic_moments
    )
    relative = 2.0 * value_error / (jnp.var(batch.target) + 1e-8)
    return learner, jnp.stack([relative, divergence, clipped])


def _actor_loss(actor: Actor, batch: Batch, settings: Hyper) -> tuple[Array, tuple[Array, Array]]:
    """The negative of the clipped objective, eq (10), with advantages normalised over the minibatch."""
    mean = forward(actor.layers, batch.observation)
    log_ratio = log_probability(batch.action, mean, actor.log_std) - batch.log_probability
    ratio = jnp.exp(log_ratio)
    advantage = (batch.advantage - jnp.mean(batch.advantage)) / (jnp.std(batch.advantage) + 1e-8)
    bounded = jnp.clip(ratio, 1.0 - settings.clip, 1.0 + settings.clip)
    objective = jnp.mean(jnp.minimum(ratio * advantage, bounded * advantage))
    divergence = jnp.mean(ratio - 1.0 - log_ratio)
    clipped = jnp.mean(jnp.abs(ratio - 1.0) > settings.clip)
    return -objective - settings.entropy * entropy(actor.log_std), (divergence, clipped)


def _critic_loss(critic: tuple[Layer, ...], batch: Batch) -> Array:
    values = forward(critic, batch.observation)[..., 0]
    return 0.5 * jnp.mean((values - batch.target) ** 2)


def _adam_step(parameters: Any, gradient: Any, moments: Any, rate: Array, settings: Hyper) -> tuple[Any, Any]:
    """Scale the gradient to its largest norm and take an Adam step."""
    norm = optax.global_norm(gradient)
    factor = jnp.minimum(1.0, settings.gradient_norm / (norm + 1e-8))
    change, moments = _adam.update(jax.tree.map(lambda each: each * factor, gradient), moments)
    return jax.tree.map(lambda parameter, each: parameter - rate * each, parameters, change), moments

"""Proximal policy optimisation (PPO2), eqs (9) and (10), with the paper's network and settings as defaults.

One call of `iterate` is one compiled program: rollouts in a batch of environments, advantages, several epochs of
clipped updates, for a number of iterations, in shards that average their gradients. Everything that a run may want to
vary without compiling anew (learning rates, discount, the world, the scenario) is an argument.
"""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from archerfish.controllers.network import Layer, Normaliser, forward, normalise
from archerfish.learning.advantages import advantages
from archerfish.learning.config import PpoConfig
from archerfish.learning.gaussian import log_probability
from archerfish.learning.guard import LIMITS, any_bad, first_fault, guarded, is_bad, rollout_fault
from archerfish.learning.minibatches import shuffled_minibatches
from archerfish.learning.normalisation import empty_normaliser, merge
from archerfish.learning.shards import AXIS, averaged, earliest, over_shards, own_key
from archerfish.learning.update import (
    Actor,
    Batch,
    Hyper,
    Measures,
    Networks,
    action_mean,
    begin_networks,
    normalised,
    update,
)


class Environment(Protocol):
    """What PPO trains in: a pytree with pure functions; randomness enters as drawn arrays."""

    @property
    def normals(self) -> int:
        """Standard normals that a step needs per batch member."""

    @property
    def uniforms(self) -> int:
        """Uniform draws that a step needs per batch member."""

    @property
    def observed(self) -> int:
        """How many of an observation's numbers the policy sees, the first ones; the critic sees all."""

    def begin(self, normals: Any, uniforms: Any) -> tuple[Any, Any]:
        """Begin a batch: state, whose arrays all have the batch's dimension first, and first observations."""

    def step(self, state: Any, action: Any, normals: Any, uniforms: Any) -> tuple[Any, Any]:
        """Advance a batch: state and outcome (see `simulation.environment.Outcome`)."""


class Sizes(NamedTuple):
    """What the compiled program depends on, named as in `PpoConfig`; another set compiles anew."""

    environments: int
    rollout: int
    minibatches: int
    epochs: int
    shards: int


def sizes(config: PpoConfig) -> Sizes:
    """Take the sizes out of a configuration."""
    return Sizes(config.environments, config.rollout, config.minibatches, config.epochs, config.shards)


class Learner(NamedTuple):
    """Everything that training needs to go on."""

    networks: Networks
    """Actor and critic."""
    normaliser: Normaliser
    """Of the observations."""
    environment: Any
    """State of the environments."""
    observation: Array
    """For the next decision, shape (B, n)."""
    key: Array
    """PRNG key of the next iteration."""
    iteration: Array
    """Iterations done, shape ()."""


_SPLIT: dict[str, Any] = {name: name in ("environment", "observation") for name in Learner._fields}
SPLIT = Learner(**_SPLIT)
"""What each shard has a part of."""


class Metrics(NamedTuple):
    """One number per iteration, shape (K,) over K of them."""

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
    gradient_norm: Any = np.float32(0.0)
    """Mean norm of the gradients before they are scaled, the larger of actor's and critic's."""
    hit_share: Any = np.float32(np.nan)
    """Share of the rollout's decisions that hit; NaN in an environment that does not tell."""
    fault: Any = np.int32(0)
    """What made the iteration bad, so that the learner stayed as it was: 0 nothing, else the place in `guard.WATCHED`
    from 1."""


def make_learner(environment: Environment, config: PpoConfig, key: Array, actions: int = 2) -> Learner:
    """Begin training.

    Args:
      environment: where.
      config: settings.
      key: PRNG key; is consumed.
      actions: numbers of an action.
    """
    log_std = jnp.float32(config.log_std)
    learner: Learner = _begin(environment, log_std, key, config.environments, config.hidden, actions)
    return learner


@partial(jax.jit, static_argnames=("batch", "hidden", "actions"))
def _begin(environment: Environment, log_std: Array, key: Array, batch: int, hidden: int, actions: int) -> Learner:
    keys = jax.random.split(key, 5)
    state, observation = environment.begin(
        jax.random.normal(keys[0], (batch, environment.normals)),
        jax.random.uniform(keys[1], (batch, environment.uniforms)),
    )
    size = observation.shape[-1]
    # Orthogonal weights; the small last layer of the actor begins with actions near zero.
    layers = orthogonal_layers(keys[2], (environment.observed, hidden, actions), last_gain=0.01)
    actor = Actor(layers, jnp.full(actions, log_std))
    critic = orthogonal_layers(keys[3], (size, hidden, 1), last_gain=1.0)
    return Learner(
        networks=begin_networks(actor, critic),
        normaliser=empty_normaliser(size),
        environment=state,
        observation=observation,
        key=keys[4],
        iteration=jnp.int32(0),
    )


def orthogonal_layers(key: Array, widths: tuple[int, ...], last_gain: float) -> tuple[Layer, ...]:
    """Draw the layers of a network: orthogonal weights, no biases.

    Args:
      key: PRNG key; is consumed.
      widths: numbers that go in, neurons of each hidden layer, numbers that come out.
      last_gain: scale of the last layer's weights; √2 of the others'.
    """
    gains = [2.0**0.5] * (len(widths) - 2) + [last_gain]
    keys = jax.random.split(key, len(gains))
    shapes = itertools.pairwise(widths)
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
      The learner, of before the first bad iteration if there is one, and metrics of shape (count,).
    """
    return iterations_in_shards(_iteration, environment, settings, learner, size, count)


def iterations_in_shards(
    iteration: Callable[..., tuple[Learner, Metrics]],
    environment: Environment,
    settings: Any,
    learner: Learner,
    size: Any,
    count: int,
) -> tuple[Learner, Metrics]:
    """Repeat an iteration in all shards, up to the first bad one.

    Args:
      iteration: environment, settings, learner, sizes of a shard → learner, metrics; any trainer's.
      environment: where to train.
      settings: traced settings, as the iteration takes them.
      learner: where training stands.
      size: of the whole, with `environments` and `shards`.
      count: iterations.
    """
    own = size._replace(environments=size.environments // size.shards)

    def shard(environment: Environment, settings: Any, learner: Learner) -> tuple[Learner, Metrics]:
        return jax.lax.scan(
            guarded(lambda learner: iteration(environment, settings, learner, own)), learner, length=count
        )

    run = over_shards(shard, size.shards, (False, False, SPLIT), (SPLIT, False))
    done: tuple[Learner, Metrics] = run(environment, settings, learner)
    return done


def _iteration(environment: Environment, settings: Hyper, learner: Learner, size: Sizes) -> tuple[Learner, Metrics]:
    key, own = jax.random.split(learner.key)
    noise, order = jax.random.split(own_key(own))
    acted = _rollout(environment, settings, learner, size, noise)
    progress = jnp.minimum(learner.iteration / settings.anneal_over, 0.9)
    actions = learner.networks.actor.log_std.size

    def minibatch(networks: Networks, columns: Array) -> tuple[Networks, tuple[Measures, Array]]:
        networks, measures = update(settings, networks, _of_columns(columns, actions), 1.0 - progress, AXIS)
        return networks, (measures, _update_faults(networks, measures))

    def epoch(networks: Networks, rows: Array) -> tuple[Networks, tuple[Measures, Array]]:
        # Dealt out once an epoch: a gather per minibatch and field costs a tenth of the training.
        columns = jnp.swapaxes(acted.table[rows], 1, 2)
        columns = columns.at[:, _ADVANTAGE].set(normalised(columns[:, _ADVANTAGE], AXIS))
        return jax.lax.scan(minibatch, networks, columns)

    parts = shuffled_minibatches(order, len(acted.table), size.epochs, size.minibatches)
    networks, (measures, bad) = jax.lax.scan(epoch, learner.networks, parts)
    spoilt = first_fault(bad.reshape(-1, len(UPDATED)), UPDATED)
    fault = jnp.where(acted.fault == 0, spoilt, acted.fault)
    metrics = Metrics(
        acted.mean_reward,
        **jax.tree.map(jnp.mean, measures)._asdict(),
        std=jnp.mean(jnp.exp(networks.actor.log_std)),
        hit_share=acted.hit_share,
        fault=fault,
    )
    advanced = acted.learner._replace(networks=networks, key=key, iteration=learner.iteration + 1)
    return advanced, metrics


UPDATED = ("gradient", "log_std", "weights")
"""What may go wrong in a gradient step, in this order."""


def _update_faults(networks: Networks, measures: Measures) -> Array:
    trained = (networks.actor.layers, networks.critic)
    return jnp.stack(
        [
            is_bad(measures.gradient_norm, LIMITS["gradient"]),
            is_bad(networks.actor.log_std, LIMITS["log_std"]),
            any_bad(trained, LIMITS["weights"]),
        ]
    )


class _Acted(NamedTuple):
    """What came of acting for a while."""

    learner: Learner
    table: Array
    """A row for each decision, see `_of_columns`."""
    mean_reward: Array
    hit_share: Array
    fault: Array


def _rollout(environment: Environment, settings: Hyper, learner: Learner, size: Sizes, key: Array) -> _Acted:
    """Act for a while with the current policy, and judge what came of it."""
    actor, critic = learner.networks.actor, learner.networks.critic
    std = jnp.exp(actor.log_std)[None, :]

    def act(carry: tuple[Any, Array], draws: tuple[Array, Array, Array]) -> tuple[tuple[Any, Array], Any]:
        state, observation = carry
        normal = normalise(learner.normaliser, observation)
        mean = action_mean(actor, normal)
        noise, normals, uniforms = (each.T for each in draws)
        action = mean + std * noise
        state, outcome = environment.step(state, action, normals, uniforms)
        chance = log_probability(action, mean, actor.log_std)
        # Here and not for all steps at once: so little stays in the processor's cache.
        value = forward(critic, normal)[..., 0]
        next_value = forward(critic, normalise(learner.normaliser, outcome.final_observation))[..., 0]
        return (state, outcome.observation), (observation, normal, action, chance, outcome, value, next_value)

    (state, observation), (raw, normal, action, chance, outcome, values, next_values) = jax.lax.scan(
        act, (learner.environment, learner.observation), _draws(environment, size, std.size, key)
    )
    gained = advantages(
        outcome.reward,
        values,
        next_values,
        outcome.terminated,
        outcome.truncated,
        settings.discount,
        settings.trace,
    )
    numbers = jnp.stack([chance, gained, gained + values], axis=-1)
    ones = jnp.ones((*gained.shape, 1))
    table = jnp.concatenate([ones, normal, action, numbers], axis=-1)
    table = table.reshape(-1, table.shape[-1])
    # The statistics change between iterations only: rollout and updates see the same numbers.
    normaliser = merge(learner.normaliser, raw.reshape(-1, raw.shape[-1]), AXIS)
    return _Acted(
        learner=learner._replace(environment=state, observation=observation, normaliser=normaliser),
        table=table,
        mean_reward=averaged(jnp.mean(outcome.reward), AXIS),
        hit_share=averaged(jnp.mean(outcome.hit.astype(jnp.float32)), AXIS),
        fault=earliest(rollout_fault(raw, action, outcome.reward, outcome.final_observation, observation)),
    )


_ADVANTAGE = -2
"""Its column in the table, see `_of_columns`."""


def _of_columns(columns: Array, actions: int) -> Batch:
    """Take a batch out of columns of one, observation, action, log-probability, advantage and target."""
    seen = len(columns) - actions - 3
    return Batch(columns[:seen], columns[seen:-3].T, *columns[-3:])


def _draws(environment: Environment, size: Sizes, actions: int, key: Array) -> tuple[Array, Array, Array]:
    """Draw the noise of actions and environments for a rollout in three calls: many small ones cost a quarter more.

    The numbers of a step lie in columns, `action_noise.T`: to draw a few in a row, many times, takes several times as
    long.
    """
    keys = jax.random.split(key, 3)
    return (
        jax.random.normal(keys[0], (size.rollout, actions, size.environments)),
        jax.random.normal(keys[1], (size.rollout, environment.normals, size.environments)),
        jax.random.uniform(keys[2], (size.rollout, environment.uniforms, size.environments)),
    )

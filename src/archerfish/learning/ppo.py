"""Proximal policy optimisation (PPO2), eqs (9) and (10), with the paper's network and settings as defaults.

Readings of the paper: the "attenuation factors" 0.001 and 0.003 are learning rates, and the critic estimates the value
of a state (docs/paper.md).
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array

from archerfish.arrays import lift
from archerfish.controllers.policy.network import Layer, forward, normalise
from archerfish.learning import learner as learners
from archerfish.learning.config import PpoConfig
from archerfish.learning.environment import Environment
from archerfish.learning.learner import Actor, Learner, Metrics, Trainer, magnitude, optimiser_step, updated
from archerfish.learning.shards import averaged, own_key

LAST_RATE = 0.1
"""Share of the learning rates that annealing leaves."""
_ADVANTAGE = -2
"""Its column in a table of decisions."""
_SETTINGS = ("actor_learning_rate", "critic_learning_rate", "clip", "discount", "trace", "entropy", "gradient_norm",
             "log_std_floor")  # fmt: skip


class Batch(NamedTuple):
    """Decisions and what came of them.

    A column of the observations is a decision: on a CPU the two large matrix products of a gradient then read and write
    along memory, which takes a fifth off their time. Biases are the weights of the ones before the observation, which
    takes off a tenth: they cost no pass of their own, forward and back.
    """

    observation: Array  # ones, then the normalised observation, then what the critic alone sees, (1 + n + h, B)
    action: Array  # as drawn, (B, 2)
    log_probability: Array  # of the action when it was drawn, (B,)
    advantage: Array  # A of eq (9), normalised, (B,)
    target: Array  # what the critic should have returned, (B,)


def _iteration(
    environment: Environment, settings: dict[str, Array], learner: Learner, sizes: dict[str, int]
) -> tuple[Learner, Metrics, Metrics]:
    key, own = jax.random.split(learner.key)
    noise, order = jax.random.split(own_key(own))
    acted, table, metrics, watched = _rollout(environment, settings, learner, sizes, noise)
    rate = jnp.maximum(1.0 - learner.iteration / settings["anneal_over"], LAST_RATE)

    def minibatch(networks: Any, columns: Array) -> tuple[Any, Metrics]:
        actions = learner.actor.log_std.size
        seen = len(columns) - actions - 3
        return _update(settings, networks, Batch(columns[:seen], columns[seen:-3].T, *columns[-3:]), rate)

    def epoch(networks: Any, rows: Array) -> tuple[Any, Metrics]:
        # Dealt out once an epoch: a gather per minibatch and field costs a tenth of the training.
        columns = jnp.swapaxes(table[rows], 1, 2)
        columns = columns.at[:, _ADVANTAGE].set(normalised(columns[:, _ADVANTAGE]))
        return jax.lax.scan(minibatch, networks, columns)

    parts = shuffled_minibatches(order, len(table), sizes["epochs"], sizes["minibatches"])
    (actor, critic, moments), measured = jax.lax.scan(epoch, (learner.actor, learner.critic, learner.moments), parts)
    watched["gradient"] = jnp.max(measured["gradient_norm"])
    metrics |= jax.tree.map(jnp.mean, measured) | {"std": jnp.mean(jnp.exp(actor.log_std))}
    after = acted._replace(actor=actor, critic=critic, moments=moments, key=key, iteration=learner.iteration + 1)
    return after, metrics, watched


PPO = Trainer(_iteration, _SETTINGS, sizes=("environments", "rollout", "minibatches", "epochs", "shards"), draws=True)
"""Eqs (9) and (10)."""


def _rollout(
    environment: Environment, settings: dict[str, Array], learner: Learner, sizes: dict[str, int], key: Array
) -> tuple[Learner, Array, Metrics, Metrics]:
    """Act for a while; the table has a row per decision: one, observation, action, and the rest of a `Batch`."""
    actor, critic = learner.actor, learner.critic
    std, (keys, batch) = jnp.exp(actor.log_std)[None, :], (jax.random.split(key, 3), sizes["environments"])

    def act(carry: tuple[Any, Array], draws: tuple[Array, Array]) -> tuple[tuple[Any, Array], Any]:
        state, observation = carry
        inputs = jnp.concatenate([observation, state.hidden], axis=-1)  # of the critic; the actor takes the first ones
        normal = normalise(learner.normaliser, inputs)
        mean = actor.mean(normal)
        action = mean + std * draws[0].T
        state, step = environment.step(state, action, draws[1].T, fresh)
        chosen = log_probability(action, mean, actor.log_std)
        # Here and not for all steps at once: so little stays in the processor's cache.
        value = forward(critic, normal)[..., 0]
        final = jnp.concatenate([step.final_observation, step.hidden], axis=-1)
        next_value = forward(critic, normalise(learner.normaliser, final))[..., 0]
        hit = step.shot.fired & (step.shot.margin >= 0.0)
        after = (step.reward, value, next_value, step.terminated, step.truncated)
        return (state, step.observation), (inputs, normal, action, chosen, after, hit, magnitude(final))

    # Columns: to draw a few numbers in a row, many times, takes several times as long.
    of_action = jax.random.normal(keys[0], (sizes["rollout"], std.size, batch))
    of_world = jax.random.normal(keys[1], (sizes["rollout"], environment.normals, batch))
    fresh = learners.fresh_engagements(environment, keys[2], batch)
    (state, observation), played = jax.lax.scan(act, (learner.environment, learner.observation), (of_action, of_world))
    raw, normal, action, chosen, kept, hits, final = played
    rewards, values, *rest = kept
    gained = advantages(rewards, values, *rest, discount=settings["discount"], trace=settings["trace"])
    numbers = jnp.stack([chosen, gained, gained + values], axis=-1)
    table = jnp.concatenate([jnp.ones((*gained.shape, 1)), normal, action, numbers], axis=-1)
    # The statistics change between iterations only: rollout and updates see the same numbers.
    normaliser = updated(learner.normaliser, raw)
    acted = learner._replace(environment=state, observation=observation, normaliser=normaliser)
    mean_reward, hit_share = averaged((jnp.mean(rewards), jnp.mean(jnp.float32(hits))))
    watched = {"observation": magnitude(raw, observation, state.hidden, final), "action": magnitude(action)}
    watched["reward"] = magnitude(rewards)
    return acted, table.reshape(-1, table.shape[-1]), {"mean_reward": mean_reward, "hit_share": hit_share}, watched


def advantages(
    rewards: Array,
    values: Array,
    next_values: Array,
    terminated: Array,
    truncated: Array,
    *,
    discount: Array | float,
    trace: Array | float,
) -> Array:
    """Estimate the advantage A of eq (9) by an exponentially weighted sum of temporal differences.

        δ_t = r_t + γ (1 − terminated_t) V(s'_t) − V(s_t),    A_t = δ_t + γ λ (1 − ended_t) A_{t+1}

    s'_t is the state that follows within the same engagement, so a truncated step bootstraps from the final
    observation, never from the first one of the next engagement; a terminated step bootstraps from nothing. Both cut
    the trace.

    Args:
      rewards: shape (T, B).
      values: V(s_t), shape (T, B).
      next_values: V(s'_t), shape (T, B).
      terminated: shape (T, B).
      truncated: shape (T, B).
      discount: γ.
      trace: λ.

    Returns:
      Advantages, shape (T, B).
    """
    delta = rewards + discount * jnp.where(terminated, 0.0, next_values) - values
    carried = discount * trace * jnp.where(terminated | truncated, 0.0, 1.0)

    def backwards(following: Array, step: tuple[Array, Array]) -> tuple[Array, Array]:
        current = step[0] + step[1] * following
        return current, current

    _, result = jax.lax.scan(backwards, jnp.zeros_like(delta[0]), (delta, carried), reverse=True)
    return result


def normalised(advantage: Array) -> Array:
    """Shift and scale the advantages of each minibatch, shape (M, B) in each shard, to mean 0 and variance 1."""
    mean = averaged(jnp.mean(advantage, axis=-1, keepdims=True))
    variance = averaged(jnp.mean((advantage - mean) ** 2, axis=-1, keepdims=True))
    return (advantage - mean) / (jnp.sqrt(variance) + 1e-8)


def shuffled_minibatches(key: Array, rows: int, epochs: int, parts: int) -> Array:
    """Deal the rows of a batch into equal parts, in a new order for every epoch.

    Random bits with the row's number in the lowest places, sorted: one sort of plain integers, nine times as fast on a
    CPU as `jax.random.permutation`, which took a fifth of a training. Rows whose random bits agree stay in order; with
    18 random bits beside the number of 12,800 rows that happens to one pair in 260,000.

    Args:
      key: PRNG key; is consumed.
      rows: of the batch, a multiple of `parts`.
      epochs: passes over the batch.
      parts: minibatches per epoch.

    Returns:
      Row numbers, shape (epochs, parts, rows / parts).
    """
    places = (rows - 1).bit_length()
    numbers = jnp.arange(rows, dtype=jnp.uint32)[None, :]
    tagged = jax.random.bits(key, (epochs, rows)) >> places << places | numbers
    orders: Array = jnp.sort(tagged, axis=-1) & (2**places - 1)
    return orders.reshape(epochs, parts, rows // parts)


def _update(settings: dict[str, Array], networks: Any, batch: Batch, rate: Array) -> tuple[Any, Metrics]:
    """Take a gradient step of the actor and one of the critic, each with its own learning rate."""
    actor, critic, (actor_moments, critic_moments) = networks
    slope = jax.value_and_grad(actor_loss, has_aux=True)
    (_, (divergence, clipped)), actor_gradient = slope(actor, batch, settings["clip"], settings["entropy"])
    error, critic_gradient = jax.value_and_grad(critic_loss)(critic, batch)
    moments = jnp.mean(batch.target), jnp.mean(batch.target**2)
    actor_gradient, critic_gradient, error, (mean, square), divergence, clipped = averaged(
        (actor_gradient, critic_gradient, error, moments, divergence, clipped)
    )
    largest, actor_rate = settings["gradient_norm"], rate * settings["actor_learning_rate"]
    actor, actor_moments = optimiser_step(
        PpoConfig.optimiser, actor, actor_gradient, actor_moments, actor_rate, largest
    )
    critic_rate = rate * settings["critic_learning_rate"]
    critic, critic_moments = optimiser_step(
        PpoConfig.optimiser, critic, critic_gradient, critic_moments, critic_rate, largest
    )
    actor = actor._replace(log_std=jnp.maximum(actor.log_std, settings["log_std_floor"]))
    measured = {
        "value_error": 2.0 * error / (jnp.maximum(square - mean**2, 0.0) + 1e-8),
        "divergence": divergence,
        "clipped_share": clipped,
        "gradient_norm": jnp.maximum(optax.tree.norm(actor_gradient), optax.tree.norm(critic_gradient)),
    }
    return (actor, critic, (actor_moments, critic_moments)), measured


def actor_loss(actor: Actor, batch: Batch, clip: Array, weight: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the negative of the clipped objective of eq (10).

        L = mean[min(ρ A, clip(ρ, 1 − ε, 1 + ε) A)],    ρ = π(a | s) / π_old(a | s)

    Args:
      actor: the policy π.
      batch: B decisions.
      clip: ε.
      weight: of the entropy bonus, which the paper does not have.

    Returns:
      −L, and estimates of the Kullback–Leibler divergence from π_old and of the share of samples that are clipped.
    """
    mean = forward_columns(actor.layers, batch.observation[: 1 + actor.layers[0].weight.shape[0]])
    log_ratio = log_probability(batch.action, mean.T, actor.log_std) - batch.log_probability
    ratio = jnp.exp(log_ratio)
    bounded = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
    objective = jnp.mean(jnp.minimum(ratio * batch.advantage, bounded * batch.advantage))
    entropy = jnp.sum(actor.log_std + 0.5 * (1.0 + math.log(2.0 * math.pi)), axis=-1)
    divergence, clipped = jnp.mean(ratio - 1.0 - log_ratio), jnp.mean(jnp.abs(ratio - 1.0) > clip)
    return -objective - weight * entropy, (divergence, clipped)


def critic_loss(critic: tuple[Layer, ...], batch: Batch) -> Array:
    """Return half the mean squared error of the values."""
    values = forward_columns(critic, batch.observation)[0]
    return 0.5 * jnp.mean((values - batch.target) ** 2)


def forward_columns(layers: tuple[Layer, ...], inputs: Array) -> Array:
    """Run a network of two layers as `forward` does on columns of one and inputs, shape (1 + n, B) → (outputs, B)."""
    first, last = layers
    hidden = jax.nn.relu(jnp.concatenate([first.bias[None, :], first.weight]).T @ inputs)
    outputs: Array = last.weight.T @ hidden + last.bias[:, None]
    return outputs


def log_probability(action: Array, mean: Array, log_std: Array) -> Array:
    """Return the logarithm of the normal density of an action.

    Args:
      action: shape B + (n,).
      mean: shape B + (n,).
      log_std: logarithms of the standard deviations, shape (n,).

    Returns:
      Shape B.
    """
    log_std = lift(log_std, action)
    scaled = (action - mean) * jnp.exp(-log_std)
    return jnp.sum(-0.5 * scaled**2 - log_std - 0.5 * math.log(2.0 * math.pi), axis=-1)

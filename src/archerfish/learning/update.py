"""One gradient step of the actor and one of the critic, eqs (9) and (10).

Readings of the paper: the "attenuation factors" 0.001 and 0.003 are learning rates, and the critic estimates the value
of a state (docs/errata.md).
"""

from typing import Any, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
import optax
from jax import Array

from archerfish.controllers.network import Layer, forward
from archerfish.learning.config import PpoConfig
from archerfish.learning.gaussian import entropy, log_probability
from archerfish.learning.shards import averaged

Parameters = TypeVar("Parameters")

ADAM = optax.scale_by_adam(eps=1e-5)
"""Scales gradients to steps; the learning rates come after it, so that they may change without compiling anew."""


class Hyper(NamedTuple):
    """What may change without compiling anew; scalars, named as in `PpoConfig`."""

    actor_learning_rate: Array
    critic_learning_rate: Array
    anneal_over: Array
    clip: Array
    discount: Array
    trace: Array
    entropy: Array
    gradient_norm: Array
    log_std_floor: Array


class NormLimit(Protocol):
    """Settings that hold the largest norm of a gradient."""

    @property
    def gradient_norm(self) -> Array:
        """Largest norm, shape ()."""


class Actor(NamedTuple):
    """The policy's distribution: a network for the mean, one free standard deviation per action."""

    layers: tuple[Layer, ...]
    """Of the mean's network, the first takes the observation."""
    log_std: Array
    """Logarithm of the standard deviation of each action, shape (2,); shape (0,) if it always acts as its mean."""


class Networks(NamedTuple):
    """What is trained, with the moments that Adam keeps of its gradients."""

    actor: Actor
    """The policy's distribution."""
    critic: tuple[Layer, ...]
    """Layers of the value's network."""
    actor_moments: Any
    """Adam's moments of the actor's gradients."""
    critic_moments: Any
    """Adam's moments of the critic's gradients."""


class Batch(NamedTuple):
    """Decisions and what came of them.

    A column of the observations is a decision: on a CPU the two large matrix products of a gradient then read and write
    along memory, which takes a fifth off their time. Biases are the weights of the ones before the observation, which
    takes off a tenth: they cost no pass of their own, there and back.
    """

    observation: Array
    """Ones, and below them the normalised observation, shape (1 + n, B)."""
    action: Array
    """As drawn, shape (B, 2)."""
    log_probability: Array
    """Of the action when it was drawn, shape (B,)."""
    advantage: Array
    """A of eq (9), see `normalised`, shape (B,)."""
    target: Array
    """What the critic should have said, shape (B,)."""


class Measures(NamedTuple):
    """How an update went; scalars."""

    value_error: Array
    """Mean squared error of the value over its variance."""
    divergence: Array
    """Estimate of the Kullback–Leibler divergence of the policy from the one that acted."""
    clipped_share: Array
    """Share of the samples beyond the clipping range of eq (10)."""
    gradient_norm: Array
    """Norm of the gradient before it is scaled, the larger of actor's and critic's."""


def hyper(config: PpoConfig) -> Hyper:
    """Take the traced settings out of a configuration."""
    values = {name: getattr(config, name) for name in Hyper._fields if name != "anneal_over"}
    anneal_over = config.iterations if config.anneal else 1e9
    return Hyper(anneal_over=jnp.float32(anneal_over), **{name: jnp.float32(each) for name, each in values.items()})


def begin_networks(actor: Actor, critic: tuple[Layer, ...]) -> Networks:
    """Return networks whose gradients have not been seen yet."""
    return Networks(actor, critic, ADAM.init(actor), ADAM.init(critic))


def update(
    settings: Hyper, networks: Networks, batch: Batch, rate: Array, axis: str | None = None
) -> tuple[Networks, Measures]:
    """Take one gradient step of the actor and one of the critic, each with its own learning rate.

    Args:
      settings: clipping, learning rates, largest norm of a gradient, smallest standard deviation.
      networks: to be improved.
      batch: B decisions.
      rate: share of the learning rates that annealing has left, shape ().
      axis: of the shards, each with a batch of its own.
    """
    actor_slope = jax.value_and_grad(actor_loss, has_aux=True)
    (_, (divergence, clipped)), actor_gradient = actor_slope(networks.actor, batch, settings)
    value_error, critic_gradient = jax.value_and_grad(critic_loss)(networks.critic, batch)
    moments = jnp.mean(batch.target), jnp.mean(batch.target**2)
    actor_gradient, critic_gradient, value_error, (mean, square), divergence, clipped = averaged(
        (actor_gradient, critic_gradient, value_error, moments, divergence, clipped), axis
    )
    relative = 2.0 * value_error / (jnp.maximum(square - mean**2, 0.0) + 1e-8)
    actor, actor_moments = adam_step(
        networks.actor, actor_gradient, networks.actor_moments, rate * settings.actor_learning_rate, settings
    )
    critic, critic_moments = adam_step(
        networks.critic, critic_gradient, networks.critic_moments, rate * settings.critic_learning_rate, settings
    )
    actor = actor._replace(log_std=jnp.maximum(actor.log_std, settings.log_std_floor))
    norm = jnp.maximum(optax.tree.norm(actor_gradient), optax.tree.norm(critic_gradient))
    return Networks(actor, critic, actor_moments, critic_moments), Measures(relative, divergence, clipped, norm)


def normalised(advantage: Array, axis: str | None = None) -> Array:
    """Shift and scale advantages to mean 0 and standard deviation 1 over each minibatch.

    Args:
      advantage: A of eq (9), shape (M, B) for M minibatches.
      axis: of the shards, each with a part of every minibatch.
    """
    mean = averaged(jnp.mean(advantage, axis=-1, keepdims=True), axis)
    variance = averaged(jnp.mean((advantage - mean) ** 2, axis=-1, keepdims=True), axis)
    return (advantage - mean) / (jnp.sqrt(variance) + 1e-8)


def action_mean(actor: Actor, observation: Array) -> Array:
    """Return the mean of the actions, shape (B, 2).

    The actor sees the first numbers of an observation, as many as its network takes; any others, which a robot could
    not see, are for the critic alone.

    Args:
      actor: the policy.
      observation: normalised, shape (B, n).
    """
    mean: Array = forward(actor.layers, observation[..., : actor.layers[0].weight.shape[0]])
    return mean


def forward_columns(layers: tuple[Layer, ...], inputs: Array) -> Array:
    """Run a network of two layers as `forward` does on columns of one and inputs, shape (1 + n, B) → (outputs, B)."""
    first, last = layers
    hidden = jax.nn.relu(jnp.concatenate([first.bias[None, :], first.weight]).T @ inputs)
    outputs: Array = last.weight.T @ hidden + last.bias[:, None]
    return outputs


def actor_loss(actor: Actor, batch: Batch, settings: Hyper) -> tuple[Array, tuple[Array, Array]]:
    """Return the negative of the clipped objective of eq (10).

        L = mean[min(ρ A, clip(ρ, 1 − ε, 1 + ε) A)],    ρ = π(a | s) / π_old(a | s)

    Args:
      actor: the policy π.
      batch: B decisions.
      settings: ε and the weight of the entropy bonus, which the paper does not have and which is 0 by default.

    Returns:
      −L, and the divergence and clipped share of `Measures`.
    """
    mean = forward_columns(actor.layers, batch.observation[: 1 + actor.layers[0].weight.shape[0]])
    log_ratio = log_probability(batch.action, mean.T, actor.log_std) - batch.log_probability
    ratio = jnp.exp(log_ratio)
    bounded = jnp.clip(ratio, 1.0 - settings.clip, 1.0 + settings.clip)
    objective = jnp.mean(jnp.minimum(ratio * batch.advantage, bounded * batch.advantage))
    divergence = jnp.mean(ratio - 1.0 - log_ratio)
    clipped = jnp.mean(jnp.abs(ratio - 1.0) > settings.clip)
    return -objective - settings.entropy * entropy(actor.log_std), (divergence, clipped)


def critic_loss(critic: tuple[Layer, ...], batch: Batch) -> Array:
    """Half the mean squared error of the values."""
    values = forward_columns(critic, batch.observation)[0]
    return 0.5 * jnp.mean((values - batch.target) ** 2)


def adam_step(
    parameters: Parameters, gradient: Parameters, moments: Any, rate: Array, settings: NormLimit
) -> tuple[Parameters, Any]:
    """Scale a gradient to at most its largest norm and take an Adam step.

    Args:
      parameters: of one network.
      gradient: of its loss.
      moments: of its earlier gradients.
      rate: learning rate, shape ().
      settings: the largest norm.

    Returns:
      Parameters and moments after the step.
    """
    factor = jnp.minimum(1.0, settings.gradient_norm / (optax.tree.norm(gradient) + 1e-8))
    change, moments = ADAM.update(jax.tree.map(lambda each: each * factor, gradient), moments)
    return jax.tree.map(lambda parameter, each: parameter - rate * each, parameters, change), moments

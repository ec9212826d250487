"""What both trainers share: the learner, optimisers, the observations' statistics, and the watch over all numbers."""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import optax
from jax import Array
from optax.contrib import MuonDimensionNumbers, scale_by_muon

from archerfish.controllers.policy.network import Layer, Normaliser, forward
from archerfish.learning.config import MAX_LOG_STD
from archerfish.learning.environment import Environment
from archerfish.learning.shards import AXIS, averaged, largest, over_shards

ADAM = optax.scale_by_adam(eps=1e-5)
"""Scales gradients to steps; the learning rates come after it, so that they may change without compiling again."""
_MUON_SIZE = 0.2
"""Root mean square of Muon's steps in units of the learning rate, about that of Adam's (Liu et al. 2025)."""


def _muon_or_adam(parameters: Any) -> Any:
    """Return which optimiser updates each array: Muon the matrices before hidden neurons, Adam all else."""
    return jax.tree.map(lambda each: "muon" if each.ndim == 2 and min(each.shape) > ACTIONS else "adam", parameters)


def _scaled_to_adam(steps: Any, _: Any) -> Any:
    return jax.tree.map(lambda each: _MUON_SIZE * max(each.shape) ** 0.5 * each, steps)


def _dimension_numbers(matrices: Any) -> Any:
    return jax.tree.map(lambda _: MuonDimensionNumbers(), matrices)


_ORTHOGONAL = optax.chain(scale_by_muon(weight_dimension_numbers=_dimension_numbers), optax.stateless(_scaled_to_adam))
MUON = optax.partition({"muon": _ORTHOGONAL, "adam": ADAM}, _muon_or_adam)
"""Muon (Jordan et al. 2024): makes the mean gradient of each hidden matrix orthogonal, so that rare directions are
learned as fast as frequent ones."""
OPTIMISERS = {"adam": ADAM, "muon": MUON}
LEAST_VARIANCE = 1e-4
"""Of an observation, all of which are scaled to about one. What varies less is magnified no further: in float32 the
last bits of an angle would become a part of what the policy does, and no two libraries agree on those."""
WATCHED = {"observation": 1e8, "action": 1e8, "reward": 1e8, "gradient": 1e12, "log_std": MAX_LOG_STD, "weights": 1e6}
"""Largest magnitudes that a training continues with, in the order of cause and effect: far beyond any that learns."""
ACTIONS = 2
"""Numbers of an action."""
Metrics = dict[str, Array]
Parameters = TypeVar("Parameters")


class Actor(NamedTuple):
    """The policy's distribution: a network for the mean, a free standard deviation per action."""

    layers: tuple[Layer, ...]  # of the mean
    log_std: Array  # logarithm of the standard deviation of each action, (2,); (0,) if it always acts as its mean

    def mean(self, observation: Array) -> Array:
        """Return the mean of the actions for a normalised observation, shape (B, n) → (B, 2).

        Numbers beyond those that the network takes are for the critic alone.
        """
        mean: Array = forward(self.layers, observation[..., : self.layers[0].weight.shape[0]])
        return mean


class Learner(NamedTuple):
    """Everything that a training needs to continue."""

    actor: Actor
    critic: tuple[Layer, ...]  # empty without one
    moments: tuple[Any, Any]  # of the optimiser, for actor and critic
    normaliser: Normaliser
    environment: Any  # state of the environments
    observation: Array  # for the next decision, (B, n)
    key: Array  # PRNG key of the next iteration, ()
    iteration: Array  # iterations done, ()


SPLIT = Learner(**{name: name in ("environment", "observation") for name in Learner._fields})  # type: ignore[arg-type]
"""What each shard has a part of."""


@partial(jax.jit, static_argnames=("batch", "hidden", "critic", "optimiser"))
def begin_learner(
    environment: Environment,
    key: Array,
    log_std: Array,
    batch: int,
    hidden: tuple[int, ...],
    critic: bool,
    optimiser: str,
) -> Learner:
    """Begin a training: orthogonal weights, of which the small last layer of the actor begins with actions near zero.

    Args:
      environment: where.
      key: PRNG key; is consumed.
      log_std: of the actor, shape (2,) or (0,).
      batch: environments.
      hidden: neurons of each hidden layer.
      critic: whether there is one.
      optimiser: of `OPTIMISERS`.
    """
    keys = jax.random.split(key, 5)
    normals = jax.random.normal(keys[0], (batch, environment.normals))
    state, observation = environment.begin(normals, jax.random.uniform(keys[1], (batch, environment.uniforms)))
    actor = Actor(_orthogonal(keys[2], (observation.shape[-1], *hidden, ACTIONS), 0.01), log_std)
    size = observation.shape[-1] + state.hidden.shape[-1]
    value = _orthogonal(keys[3], (size, *hidden, 1), 1.0) if critic else ()
    nothing = Normaliser(jnp.zeros(size), jnp.ones(size), jnp.float32(0))
    moments = (OPTIMISERS[optimiser].init(actor), OPTIMISERS[optimiser].init(value))
    return Learner(actor, value, moments, nothing, state, observation, keys[4], jnp.int32(0))


def _orthogonal(key: Array, widths: tuple[int, ...], last_gain: float) -> tuple[Layer, ...]:
    gains = [2.0**0.5] * (len(widths) - 2) + [last_gain]
    keys = jax.random.split(key, len(gains))
    return tuple(
        Layer(jax.nn.initializers.orthogonal(gain)(each, shape, jnp.float32), jnp.zeros(shape[1]))
        for each, shape, gain in zip(keys, itertools.pairwise(widths), gains, strict=True)
    )


class Trainer(NamedTuple):
    """A way of training, by what it does in an iteration and the names of the settings that it needs."""

    iteration: Callable[..., tuple[Learner, Metrics, Metrics]]  # as of `iterate`
    scalars: tuple[str, ...]  # settings that are arguments of the compiled program
    sizes: tuple[str, ...]  # what a program is compiled for: whole numbers, and the optimiser's name
    draws: bool  # whether actions are drawn, and a critic judges them; else they are the mean

    def begin(self, environment: Environment, config: Any, key: Array) -> Learner:
        """Begin a training.

        Args:
          environment: where.
          config: settings of the trainer.
          key: PRNG key, shape (); is consumed.
        """
        log_std = jnp.full(2, jnp.float32(config.log_std)) if self.draws else jnp.zeros(0)
        sizes = config.environments, config.widths, self.draws
        begun: Learner = begin_learner(environment, key, log_std, *sizes, config.optimiser)
        return begun

    def advance(self, environment: Environment, config: Any, learner: Learner, count: int) -> tuple[Learner, Metrics]:
        """Run iterations; see `iterate`."""
        settings = {name: jnp.float32(getattr(config, name)) for name in self.scalars}
        settings["anneal_over"] = jnp.float32(config.iterations if config.anneal else 1e9)
        sizes = tuple((name, getattr(config, name)) for name in self.sizes)
        return iterate(self.iteration, environment, settings, learner, sizes, count)  # type: ignore[no-any-return]


def fresh_engagements(environment: Environment, key: Array, batch: int) -> Any:
    """Draw what replaces the engagements that end in a window, once for all its decisions.

    In the paper's task that is nothing, but to draw the paths of `any` at every step takes longer than all else.

    Args:
      environment: where.
      key: PRNG key, shape (); is consumed.
      batch: engagements.
    """
    keys = jax.random.split(key)
    normals = jax.random.normal(keys[0], (batch, environment.normals))
    return environment.fresh(normals, jax.random.uniform(keys[1], (batch, environment.uniforms)))


def updated(normaliser: Normaliser, observations: Array) -> Normaliser:
    """Add observations, shape (T, B, n) in each shard, to the running mean and variance (Chan's parallel formula)."""
    rows = observations.reshape(-1, observations.shape[-1])
    mean = averaged(jnp.mean(rows, axis=0))
    variance = averaged(jnp.mean((rows - mean[None, :]) ** 2, axis=0))
    count = rows.shape[0] * jax.lax.axis_size(AXIS)
    total = normaliser.count + count
    share, shift = count / total, mean - normaliser.mean
    spread = (1 - share) * normaliser.variance + share * variance + share * (1 - share) * shift**2
    return Normaliser(normaliser.mean + share * shift, jnp.maximum(spread, LEAST_VARIANCE), total)


def optimiser_step(
    optimiser: str, parameters: Parameters, gradient: Parameters, moments: Any, rate: Array, largest_norm: Array
) -> tuple[Parameters, Any]:
    """Scale a gradient to at most a norm and take a step.

    Args:
      optimiser: of `OPTIMISERS`.
      parameters: of one network.
      gradient: of its loss.
      moments: of its earlier gradients.
      rate: learning rate, shape ().
      largest_norm: shape ().

    Returns:
      Parameters and moments after the step.
    """
    factor = jnp.minimum(1.0, largest_norm / (optax.tree.norm(gradient) + 1e-8))
    change, moments = OPTIMISERS[optimiser].update(jax.tree.map(lambda each: each * factor, gradient), moments)
    return jax.tree.map(lambda parameter, each: parameter - rate * each, parameters, change), moments


def magnitude(*trees: Any) -> Array:
    """Return the largest magnitude in trees of floats, shape (); not a number where any is none."""
    return jnp.max(jnp.stack([jnp.max(jnp.abs(each)) for each in jax.tree.leaves(trees) if each.size]))


@partial(jax.jit, static_argnames=("iteration", "sizes", "count"))
def iterate(
    iteration: Callable[..., tuple[Learner, Metrics, Metrics]],
    environment: Environment,
    settings: dict[str, Array],
    learner: Learner,
    sizes: tuple[tuple[str, Any], ...],
    count: int,
) -> tuple[Learner, Metrics]:
    """Run iterations of a trainer in all shards as one compiled program, up to the first bad one.

    A bad iteration leaves the learner as it was, so that those after it begin where it began, and are bad in the same
    way: nothing has to remember it.

    Args:
      iteration: (environment, settings, learner, sizes of a shard) → learner, metrics, magnitudes by `WATCHED`.
      environment: where; its arrays are arguments, so another world of the same shapes compiles nothing.
      settings: of the trainer, by name.
      learner: where the training is.
      sizes: settings that a program is compiled for, with "environments" and "shards"; compiled once per set.
      count: iterations.

    Returns:
      The learner, of before the first bad iteration, and metrics of shape (count,); "watched" is (count, w).
    """
    own: dict[str, Any] = dict(sizes)
    own["environments"] //= own["shards"]

    def shard(environment: Environment, settings: dict[str, Array], learner: Learner) -> tuple[Learner, Metrics]:
        def body(learner: Learner, _: None) -> tuple[Learner, Metrics]:
            after, metrics, watched = iteration(environment, settings, learner, own)
            weights = magnitude(after.actor, after.critic, after.normaliser[:2])
            found = {"log_std": magnitude(after.actor.log_std, jnp.zeros(1)), "weights": weights, **watched}
            magnitudes = largest(jnp.stack([found.get(name, jnp.float32(0.0)) for name in WATCHED]))
            good = jnp.all(magnitudes <= jnp.array(list(WATCHED.values())))
            after = jax.tree.map(lambda new, old: jax.lax.select(good, new, old), after, learner)
            return after, {**metrics, "watched": magnitudes}

        return jax.lax.scan(body, learner, length=count)

    run = over_shards(shard, own["shards"], (False, False, SPLIT), (SPLIT, False))
    return run(environment, settings, learner)  # type: ignore[no-any-return]

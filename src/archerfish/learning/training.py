"""A whole training: iterations in compiled chunks, with a report to the caller between them."""

import hashlib
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from archerfish.controllers.policy import PolicyController
from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import Environment, Learner, Metrics, iterate, make_learner, sizes
from archerfish.learning.update import hyper
from archerfish.records.errors import InputError
from archerfish.sensing.observers import AnyObserver

CHUNK = 4
"""Iterations per compiled call; between calls the caller hears of the progress and may stop."""


class TrainingConfig(Protocol):
    """What every way of training has to say of itself."""

    @property
    def iterations(self) -> int:
        """Updates of a whole run."""

    @property
    def batch(self) -> int:
        """Decisions of an iteration, over all environments."""


class Trainer(NamedTuple):
    """A way of training: what it begins with, and how it goes on; both compile what they run."""

    begin: Callable[[Environment, Any, Array], Any]
    """Environment, configuration, PRNG key → learner: a tree of arrays with `iteration`, `networks.actor`, and
    `normaliser`."""
    advance: Callable[[Environment, Any, Any, int], tuple[Any, Metrics]]
    """Environment, configuration, learner, iterations K → learner, metrics of shape (K,)."""


def _advance_ppo(environment: Environment, config: PpoConfig, learner: Learner, count: int) -> tuple[Learner, Metrics]:
    advanced: tuple[Learner, Metrics] = iterate(environment, hyper(config), learner, sizes(config), count)
    return advanced


PPO = Trainer(make_learner, _advance_ppo)
"""Eqs (9) and (10)."""


class Curve(NamedTuple):
    """How a training went, one number per iteration, shape (K,)."""

    steps: NDArray[np.int64]
    """Decisions trained for so far."""
    mean_reward: NDArray[np.float32]
    """Mean reward per decision [m]."""
    metrics: Metrics
    """Everything that was measured."""


class Trained(NamedTuple):
    """What a training leaves."""

    learner: Learner
    """Where it stands."""
    curve: Curve
    """How it went."""


def train(
    environment: Environment,
    config: TrainingConfig,
    seed: int,
    progress: Callable[[int, Metrics], None] = lambda *_: None,
    trainer: Trainer = PPO,
) -> Trained:
    """Train a policy; the same seed gives the same weights, bit for bit, on the same machine and versions.

    Args:
      environment: where; NumPy arrays will do.
      config: settings, of the kind that the trainer takes.
      seed: of everything random.
      progress: hears of the decisions trained for and of the latest metrics; an exception from it ends the training.
      trainer: how.

    Raises:
      InputError: if the training diverges to numbers that are not finite.
    """
    environment = jax.tree.map(jax.numpy.asarray, environment)
    learner = trainer.begin(environment, config, jax.random.key(seed))
    collected: list[Metrics] = []
    for start in range(0, config.iterations, CHUNK):
        learner, metrics = trainer.advance(environment, config, learner, CHUNK)
        collected.append(jax.tree.map(np.asarray, metrics))
        if not all(np.all(np.isfinite(each)) for each in collected[-1]):
            raise InputError(
                f"training diverged after {start * config.batch} decisions: the rewards or the networks are not "
                "finite; lower the learning rates"
            )
        progress((start + CHUNK) * config.batch, collected[-1])
    joined: Metrics = jax.tree.map(lambda *parts: np.concatenate(parts), *collected)
    steps = config.batch * np.arange(1, len(joined.mean_reward) + 1)
    return Trained(learner, Curve(steps, np.asarray(joined.mean_reward), joined))


def trained_policy(observer: AnyObserver, learner: Learner) -> PolicyController:
    """Return the policy of a learner as a controller: its mean action, in NumPy."""
    layers, normaliser = learner.networks.actor.layers, learner.normaliser
    seen = layers[0].weight.shape[0]
    normaliser = normaliser._replace(mean=normaliser.mean[:seen], variance=normaliser.variance[:seen])
    policy = PolicyController(observer, normaliser, layers)
    in_numpy: PolicyController = jax.tree.map(np.asarray, policy)
    return in_numpy


def weights_hash(learner: Learner) -> str:
    """Return the SHA-256 of the actor's and critic's weights."""
    digest = hashlib.sha256()
    leaves: list[Any] = jax.tree.leaves((learner.networks.actor, learner.networks.critic))
    for leaf in leaves:
        digest.update(np.asarray(leaf).tobytes())
    return digest.hexdigest()

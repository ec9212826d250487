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
from archerfish.learning.guard import WATCHED
from archerfish.learning.ppo import SPLIT, Environment, Learner, Metrics, iterate, make_learner, sizes
from archerfish.learning.shards import claim_devices, placed
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

    @property
    def shards(self) -> int:
        """Parts that the environments are split into."""


class Trainer(NamedTuple):
    """A way of training: what it begins with, and how it goes on; both compile what they run."""

    begin: Callable[[Environment, Any, Array], Any]
    """Environment, configuration, PRNG key → learner: a tree of arrays with `iteration`, `networks.actor`, and
    `normaliser`."""
    advance: Callable[[Environment, Any, Any, int], tuple[Any, Metrics]]
    """Environment, configuration, learner, iterations K → learner, metrics of shape (K,). With `guard.guarded` around
    its iterations, it stops at the first bad one; without, a bad one costs all of the call."""


def decisions(config: TrainingConfig) -> int:
    """Return the decisions of a whole run: of its updates, in whole compiled calls."""
    return -(-config.iterations // CHUNK) * CHUNK * config.batch


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


class Standing(NamedTuple):
    """Where a training stands: all that going on, to the bit, needs."""

    learner: Any
    """What the trainer goes on with."""
    parts: tuple[Metrics, ...]
    """What was measured so far, in order, a compiled call or more each."""

    @property
    def iterations(self) -> int:
        """Iterations done."""
        return sum(len(part.mean_reward) for part in self.parts)

    @property
    def metrics(self) -> Metrics:
        """All that was measured, shape (K,)."""
        return joined(self.parts)


class Course(NamedTuple):
    """What a caller does in the course of a training."""

    resume: Callable[[Standing], Standing] = lambda fresh: fresh
    """Takes where the training begins, and returns where it goes on: there, or at a checkpoint."""
    watch: Callable[[Standing], None] = lambda _: None
    """Hears after every compiled call where the training stands; an exception from it ends the training."""
    enough: Callable[[Standing], bool] = lambda _: False
    """Asked before every compiled call whether to stop; a function of where the training stands and nothing else, so
    that a training that was interrupted stops where it would have stopped."""


class Trained(NamedTuple):
    """What a training leaves."""

    learner: Learner
    """Where it stands."""
    curve: Curve
    """How it went."""


_LOOK = "look at the plants, the other records and the motion that it is given: this comes from the simulated robot"
REMEDIES = {"observation": _LOOK, "reward": _LOOK, "action": "lower the learning rates or the log_std"}
"""What was bad first → what to do, where it is not to lower the learning rates."""


class DivergenceError(InputError):
    """A training met a number that is not finite, or will soon not be."""

    def __init__(self, standing: Standing, first: str, decisions: int) -> None:
        iteration = standing.iterations + 1
        super().__init__(
            f"training diverged after {decisions} decisions, in iteration {iteration}: {first} not finite, or growing "
            f"beyond all bounds; {REMEDIES.get(first, 'lower the learning rates')}"
        )
        self.standing = standing
        """Before the bad iteration."""
        self.iteration = iteration
        """The bad one, from 1."""
        self.first = first
        """What was bad first, one of `guard.WATCHED`, or "metrics" where the trainer does not tell."""


def train(
    environment: Environment,
    config: TrainingConfig,
    seed: int,
    progress: Callable[[int, Metrics], None] = lambda *_: None,
    trainer: Trainer = PPO,
    course: Course = Course(),  # noqa: B008 (a NamedTuple never changes)
) -> Trained:
    """Train a policy; the same seed gives the same weights, bit for bit, on the same machine and versions.

    JAX makes a device for each shard out of the processor, unless it computed something before: then they share one.

    Args:
      environment: where; NumPy arrays will do.
      config: settings, of the kind that the trainer takes.
      seed: of everything random.
      progress: hears of the decisions trained for and of the latest metrics; an exception from it ends the training.
      trainer: how.
      course: where to go on, who watches, and when it is enough.

    Raises:
      DivergenceError: if a number is not finite; it holds where the training stood before.
    """
    claim_devices(config.shards)
    environment = jax.tree.map(jax.numpy.asarray, environment)
    standing = course.resume(Standing(trainer.begin(environment, config, jax.random.key(seed)), ()))
    standing = standing._replace(learner=placed(standing.learner, config.shards, SPLIT))
    while standing.iterations < config.iterations and not course.enough(standing):
        learner, metrics = trainer.advance(environment, config, standing.learner, CHUNK)
        standing = _checked(standing, learner, jax.tree.map(np.asarray, metrics), config.batch)
        progress(standing.iterations * config.batch, standing.parts[-1])
        course.watch(standing)
    return Trained(standing.learner, curve(standing, config.batch))


def curve(standing: Standing, batch: int) -> Curve:
    """Return how a training went up to where it stands.

    Args:
      standing: where.
      batch: decisions of an iteration.
    """
    metrics = standing.metrics
    steps = batch * np.arange(1, len(metrics.mean_reward) + 1)
    return Curve(steps, np.asarray(metrics.mean_reward), metrics)


def joined(parts: tuple[Metrics, ...]) -> Metrics:
    """Join metrics of shapes (K1,), (K2,), … to one of shape (K1 + K2 + …,)."""
    if not parts:
        return _metrics({name: np.zeros(0, np.float32) for name in Metrics._fields})
    together: Metrics = jax.tree.map(lambda *each: np.concatenate(each), *parts)
    return together


def _metrics(arrays: dict[str, Any]) -> Metrics:
    return Metrics(**arrays)


def _checked(before: Standing, learner: Any, metrics: Metrics, batch: int) -> Standing:
    """Return where a training stands after a compiled call.

    Raises:
      DivergenceError: if an iteration was bad. A trainer whose scan is not `guarded` is taken back to before the call.
    """
    count = len(metrics.mean_reward)
    # What a trainer does not measure has the default of its field, which has no iterations.
    metrics = _metrics({name: np.broadcast_to(each, (count,)) for name, each in metrics._asdict().items()})
    faults = np.flatnonzero(metrics.fault)
    if len(faults):
        good: Metrics = jax.tree.map(lambda each: each[: faults[0]], metrics)
        standing = Standing(learner, (*before.parts, good))
        raise DivergenceError(standing, WATCHED[metrics.fault[faults[0]] - 1], standing.iterations * batch)
    told = [each for name, each in metrics._asdict().items() if name != "hit_share"]
    weights = jax.tree.leaves((learner.networks, learner.normaliser))
    if not all(np.all(np.isfinite(each)) for each in (*told, *map(np.asarray, weights))):
        raise DivergenceError(before, "metrics", before.iterations * batch)
    return Standing(learner, (*before.parts, metrics))


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

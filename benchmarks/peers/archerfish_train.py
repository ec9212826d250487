"""Adapter: our own training, as `archerfish train` runs it."""

from functools import partial

import jax
from training_protocol import Case, Log, Policy, main, shooting_environment

from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import SPLIT, Learner, iterate, make_learner, sizes
from archerfish.learning.shards import claim_devices, placed
from archerfish.learning.training import CHUNK
from archerfish.learning.update import hyper


def train(case: Case, log: Log) -> None:
    """Train with two learning rates, several iterations per compiled call."""
    shared = {name: getattr(case, name) for name in PpoConfig.__dataclass_fields__ if name in Case._fields}
    config = PpoConfig(**shared, actor_learning_rate=case.learning_rate)
    claim_devices(config.shards)
    environment = jax.tree.map(jax.numpy.asarray, shooting_environment())
    log.begin()
    # Placed at once, as `archerfish train` does it: else the second call would be compiled anew.
    learner = placed(make_learner(environment, config, jax.random.key(case.seed)), config.shards, SPLIT)
    for done in range(CHUNK, max(case.iterations, CHUNK) + 1, CHUNK):
        learner, _ = jax.block_until_ready(iterate(environment, hyper(config), learner, sizes(config), CHUNK))
        log.passed(done * case.batch, partial(_policy, learner))


def _policy(learner: Learner) -> Policy:
    normaliser, layers = learner.normaliser, learner.networks.actor.layers
    return Policy(normaliser.mean, normaliser.variance, tuple((each.weight, each.bias) for each in layers))


if __name__ == "__main__":
    main(train)

"""Whole trainings in the shooting environment: reproducible, stoppable, and not compiled more often than needed."""

import re
from dataclasses import replace

import jax
import numpy as np
import pytest

from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import Metrics, iterate
from archerfish.learning.training import CHUNK, Trained, train, trained_policy, weights_hash
from archerfish.records.errors import InputError
from archerfish.simulation.environment import ShootingEnvironment


@pytest.fixture(scope="module")
def trained(shooting: ShootingEnvironment, tiny: PpoConfig) -> Trained:
    return train(shooting, tiny, seed=0)


def test_the_same_seed_gives_the_same_weights_twice(
    shooting: ShootingEnvironment, tiny: PpoConfig, trained: Trained
) -> None:
    again = train(shooting, tiny, seed=0)
    assert weights_hash(again.learner) == weights_hash(trained.learner)
    np.testing.assert_array_equal(again.curve.mean_reward, trained.curve.mean_reward)


def test_other_seeds_give_other_weights(shooting: ShootingEnvironment, tiny: PpoConfig, trained: Trained) -> None:
    hashes = {weights_hash(train(shooting, tiny, seed).learner) for seed in (1, 2)}
    assert len(hashes | {weights_hash(trained.learner)}) == 3


def test_learning_rates_steps_and_world_compile_nothing_anew(
    shooting: ShootingEnvironment, shooting_under_gate: ShootingEnvironment, tiny: PpoConfig, trained: Trained
) -> None:
    before = iterate._cache_size()
    train(shooting, replace(tiny, actor_learning_rate=1e-4, clip=0.1, discount=0.5, entropy=0.01), seed=0)
    train(shooting, replace(tiny, steps=4 * tiny.steps), seed=0)
    under_gate = train(shooting_under_gate, tiny, seed=0)
    assert iterate._cache_size() == before
    assert weights_hash(under_gate.learner) != weights_hash(trained.learner)


def test_progress_hears_of_every_chunk_and_may_stop_the_training(
    shooting: ShootingEnvironment, tiny: PpoConfig, trained: Trained
) -> None:
    class StopError(Exception):
        pass

    heard: list[int] = []

    def stop_at_the_second(steps: int, metrics: Metrics) -> None:
        heard.append(steps)
        assert metrics.mean_reward.shape == (CHUNK,)
        if len(heard) == 2:
            raise StopError

    with pytest.raises(StopError):
        train(shooting, replace(tiny, steps=10 * tiny.steps), seed=0, progress=stop_at_the_second)
    assert heard == [CHUNK * 32, 2 * CHUNK * 32]


def test_the_curve_counts_the_decisions_of_every_iteration(tiny: PpoConfig, trained: Trained) -> None:
    np.testing.assert_array_equal(trained.curve.steps, 32 * np.arange(1, tiny.iterations + 1))
    assert all(np.shape(each) == (tiny.iterations,) for each in trained.curve.metrics)
    assert np.all(trained.curve.mean_reward < 0)


def test_a_training_that_diverges_is_refused(shooting: ShootingEnvironment, tiny: PpoConfig) -> None:
    config = replace(tiny, actor_learning_rate=1e38, critic_learning_rate=1e38, anneal=False)
    with pytest.raises(InputError, match=re.escape("training diverged after 0 decisions")):
        train(shooting, config, seed=0)


def test_the_trained_policy_is_in_numpy(shooting: ShootingEnvironment, trained: Trained) -> None:
    policy = trained_policy(shooting.observer, trained.learner)
    assert all(isinstance(leaf, np.ndarray | np.generic) for leaf in jax.tree.leaves(policy))

"""A training split into shards: the same arithmetic as of one, wherever the shards run."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from archerfish.learning import gradient, ppo, shards
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient import GRADIENT
from archerfish.learning.gradient_config import GradientConfig
from archerfish.learning.normalisation import empty_normaliser, merge
from archerfish.learning.ppo import make_learner
from archerfish.learning.shards import AXIS, averaged, earliest, over_shards, own_key
from archerfish.learning.training import CHUNK, PPO, Course, DivergenceError, Standing, Trainer, train
from archerfish.learning.update import Batch, hyper, normalised, update
from archerfish.simulation.environment import ShootingEnvironment


@pytest.fixture(params=["a device each", "one device"])
def place(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "one device":
        only = jax.devices()[:1]
        monkeypatch.setattr(shards.jax, "devices", lambda: only)
    else:
        assert len(jax.devices()) >= 2


def test_a_shard_has_its_part_of_what_is_split_and_the_whole_of_the_rest(place: None) -> None:
    def shard(part: Any, whole: Any) -> Any:
        return {"split": part + whole, "mean": averaged(jnp.mean(part), AXIS), "first": earliest(jnp.int32(part[0]))}

    run = over_shards(shard, 2, (True, False), {"split": True, "mean": False, "first": False})
    found = jax.jit(run)(jnp.arange(6.0), jnp.float32(10.0))
    np.testing.assert_array_equal(found["split"], np.arange(6.0) + 10.0)
    # Of the codes 0 and 3 that the shards have, 0 stands for none.
    assert (float(found["mean"]), int(found["first"])) == (2.5, 3)


def test_the_mean_of_a_tree_has_its_shapes(place: None) -> None:
    def shard(part: Any) -> Any:
        tree = {"a": part[0], "b": (part[0, :2], jnp.outer(part[0], part[0]))}
        return averaged(tree, AXIS)

    rows = np.random.default_rng(0).standard_normal((2, 3)).astype(np.float32)
    found = jax.jit(over_shards(shard, 2, (True,), False))(rows)
    np.testing.assert_allclose(found["a"], rows.mean(0), rtol=1e-6)
    np.testing.assert_allclose(found["b"][0], rows[:, :2].mean(0), rtol=1e-6)
    np.testing.assert_allclose(found["b"][1], np.mean([np.outer(row, row) for row in rows], 0), rtol=1e-6)


def test_shards_draw_numbers_of_their_own(place: None) -> None:
    def shard(key: Any) -> Any:
        return jax.random.normal(own_key(key), (4,))

    first, second = np.split(np.asarray(jax.jit(over_shards(shard, 2, (False,), True))(jax.random.key(0))), 2)
    assert not np.any(first == second)


def test_moments_of_shards_are_those_of_all_observations(place: None) -> None:
    observations = np.random.default_rng(1).normal(3.0, 2.0, (40, 5)).astype(np.float32)

    def shard(rows: Any) -> Any:
        return merge(merge(empty_normaliser(5), rows, AXIS), rows, AXIS)

    found = jax.jit(over_shards(shard, 2, (True,), False))(observations)
    np.testing.assert_allclose(found.mean, observations.mean(0), rtol=1e-5)
    np.testing.assert_allclose(found.variance, observations.var(0), rtol=1e-5)
    assert found.count == 80


def test_a_gradient_step_in_shards_is_that_of_the_whole_minibatch(
    place: None, shooting: ShootingEnvironment, tiny: PpoConfig
) -> None:
    settings, networks = hyper(tiny), make_learner(shooting, tiny, jax.random.key(0)).networks
    generator = np.random.default_rng(2)
    shapes = ((1 + shooting.observed, 16), (16, 2), (16,), (16,), (16,))
    batch = Batch(*(jnp.asarray(generator.standard_normal(shape), jnp.float32) for shape in shapes))
    alone = batch._replace(advantage=normalised(batch.advantage[None])[0])
    expected, measured = update(settings, networks, alone, jnp.float32(1.0))
    columns = (batch.observation.T, *batch[1:])

    def shard(settings: Any, networks: Any, rows: Any) -> Any:
        own = Batch(rows[0].T, *rows[1:])
        own = own._replace(advantage=normalised(own.advantage[None], AXIS)[0])
        return update(settings, networks, own, jnp.float32(1.0), AXIS)

    found, measures = jax.jit(over_shards(shard, 2, (False, False, True), False))(settings, networks, columns)
    for ours, theirs in zip(jax.tree.leaves(found.actor), jax.tree.leaves(expected.actor), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
    for ours, theirs in zip(jax.tree.leaves(found.critic), jax.tree.leaves(expected.critic), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
    assert float(measures.gradient_norm) == pytest.approx(float(measured.gradient_norm), rel=1e-4)
    assert float(measures.value_error) == pytest.approx(float(measured.value_error), rel=1e-4)
    assert float(measures.divergence) == pytest.approx(float(measured.divergence), rel=1e-4)


def test_a_training_learns_alike_wherever_its_shards_run(
    shooting: ShootingEnvironment, tiny: PpoConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    apart = train(shooting, tiny, seed=0)
    only = jax.devices()[:1]
    jax.clear_caches()
    monkeypatch.setattr(shards.jax, "devices", lambda: only)
    together = train(shooting, tiny, seed=0)
    jax.clear_caches()
    # The same draws and the same minibatches: but for rounding, which grows with every update, the same training.
    np.testing.assert_allclose(together.curve.mean_reward[:3], apart.curve.mean_reward[:3], rtol=1e-3)


@pytest.mark.parametrize("trainer", [PPO, GRADIENT], ids=["ppo", "gradient"])
def test_a_training_of_several_calls_compiles_one_program(
    shooting: ShootingEnvironment, tiny: PpoConfig, trainer: Trainer
) -> None:
    config = tiny if trainer is PPO else GradientConfig(2 * CHUNK * 8 * 4, environments=8, window=4, hidden=8)
    compiled = ppo.iterate if trainer is PPO else gradient.iterate
    jax.clear_caches()
    train(shooting, config, seed=0, trainer=trainer)
    assert compiled._cache_size() == 1


@pytest.mark.parametrize("trainer", [PPO, GRADIENT], ids=["ppo", "gradient"])
@pytest.mark.parametrize("member", [0, 7])
def test_a_fault_in_one_shard_is_named_by_its_cause(
    shooting: ShootingEnvironment, tiny: PpoConfig, trainer: Trainer, member: int
) -> None:
    config = tiny if trainer is PPO else GradientConfig(2 * CHUNK * 8 * 4, environments=8, window=4, hidden=8)

    def spoil(standing: Standing) -> Standing:
        learner = standing.learner
        return standing._replace(learner=learner._replace(observation=learner.observation.at[member].set(jnp.nan)))

    with pytest.raises(DivergenceError) as caught:
        train(shooting, config, seed=0, trainer=trainer, course=Course(resume=spoil))
    assert (caught.value.first, caught.value.iteration) == ("observation", 1)


def test_seeds_are_trained_side_by_side_in_one_program(shooting: ShootingEnvironment, tiny: PpoConfig) -> None:
    keys = jax.random.split(jax.random.key(0), 2)
    learners = jax.vmap(lambda key: make_learner(shooting, tiny, key))(keys)
    advance = jax.vmap(lambda learner: ppo.iterate(shooting, hyper(tiny), learner, ppo.sizes(tiny), 1)[1])
    together = jax.jit(advance)(learners)
    alone = ppo.iterate(shooting, hyper(tiny), make_learner(shooting, tiny, keys[1]), ppo.sizes(tiny), 1)[1]
    np.testing.assert_allclose(together.mean_reward[1], alone.mean_reward, rtol=1e-4)

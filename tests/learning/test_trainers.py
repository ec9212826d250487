"""The two trainers, part by part against calculations by hand, and the defaults of their settings."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish as af
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.learning.config import GradientConfig, PpoConfig, TrainConfig

jax = pytest.importorskip("jax")
jnp = jax.numpy

from archerfish.learning import gradient, learner, ppo  # noqa: E402
from archerfish.learning.shards import AXIS, averaged, largest, over_shards, placed  # noqa: E402

PAPER, INFANTRY = af.Robot.paper(), af.Robot.load("tests/infantry")
SMALL = {"environments": 32, "hidden": 16}


def in_shards(function, *arguments):
    """Run a function with the axis of the shards, the leading one of every argument."""
    return jax.vmap(function, axis_name=AXIS)(*arguments)


def test_advantages_stop_at_both_ends_and_bootstrap_from_the_truncated_one():
    columns = np.array([[1.0, 0.5, 0.2, 0, 0], [2.0, 0.25, 0.4, 0, 1], [3.0, 1.0, 0.8, 1, 0]])
    reward, value, following, terminated, truncated = (jnp.asarray(each)[:, None] for each in columns.T)
    ends = terminated > 0, truncated > 0
    found = ppo.advantages(reward, value, following, *ends, discount=0.5, trace=0.8)
    deltas = [1.0 + 0.5 * 0.2 - 0.5, 2.0 + 0.5 * 0.4 - 0.25, 3.0 - 1.0]
    assert_allclose(found[:, 0], [deltas[0] + 0.5 * 0.8 * deltas[1], deltas[1], deltas[2]], rtol=1e-6)


def test_the_objective_is_that_of_eq_10():
    layers = (Layer(jnp.zeros((1, 3)), jnp.zeros(3)), Layer(jnp.zeros((3, 2)), jnp.array([0.5, -0.5])))
    actor = learner.Actor(layers, jnp.log(jnp.array([0.5, 2.0])))
    action, advantage, before = np.array([[0.7, 0.1], [0.4, -2.0]]), np.array([1.5, -0.5]), np.array([-2.3, -1.5])
    scaled = (action - [0.5, -0.5]) / [0.5, 2.0]
    density = np.sum(-0.5 * scaled**2 - np.log([0.5, 2.0]) - 0.5 * np.log(2.0 * np.pi), axis=1)
    ratio = np.exp(density - before)
    assert ratio[0] > 1.2 and ratio[1] < 0.8  # so that both are clipped
    expected = np.minimum(ratio * advantage, np.clip(ratio, 0.8, 1.2) * advantage).mean()
    entropy = np.sum(np.log([0.5, 2.0]) + 0.5 * np.log(2.0 * np.pi * np.e))
    batch = ppo.Batch(jnp.ones((2, 2)), *map(jnp.asarray, (action, before, advantage)), jnp.array([1.0, 2.0]))
    loss, (divergence, clipped) = ppo.actor_loss(actor, batch, 0.2, 0.1)
    assert float(loss) == pytest.approx(-expected - 0.1 * entropy, rel=1e-5)
    assert float(divergence) == pytest.approx(np.mean(ratio - 1.0 - np.log(ratio)), rel=1e-4)
    assert float(clipped) == np.mean(np.abs(ratio - 1.0) > 0.2)
    critic = (*layers[:1], Layer(jnp.zeros((3, 1)), jnp.array([0.5])))
    assert float(ppo.critic_loss(critic, batch)) == pytest.approx(0.5 * np.mean([0.25, 2.25]))


def test_minibatches_are_all_rows_in_another_order_each_epoch():
    parts = np.asarray(ppo.shuffled_minibatches(jax.random.key(0), 60, 3, 4))
    assert parts.shape == (3, 4, 15)
    assert np.array_equal(np.sort(parts.reshape(3, -1), axis=1), np.tile(np.arange(60), (3, 1)))
    assert len({tuple(each.ravel()) for each in parts}) == 3


def test_statistics_and_advantages_are_those_of_all_shards_together():
    rng, start = np.random.default_rng(0), Normaliser(jnp.zeros(3), jnp.ones(3), jnp.float32(0))
    rows = [rng.normal([0.0, 5.0, 1.0], [1.0, 2.0, 0.0], (2, 4, 5, 3)).astype(np.float32) for _ in range(2)]
    found = jax.tree.map(lambda each: jnp.stack([each] * 2), start)
    for each in rows:
        found = in_shards(learner.updated, found, each)
    together = np.concatenate([each.reshape(-1, 3) for each in rows])
    assert_allclose(found.mean[0], together.mean(0), atol=1e-5)
    assert_allclose(found.variance[1], np.maximum(together.var(0), learner.LEAST_VARIANCE), rtol=1e-4)
    assert found.count.tolist() == [80, 80]
    advantage = rng.normal(3.0, 2.0, (2, 4, 6)).astype(np.float32)
    whole = in_shards(ppo.normalised, advantage)
    assert_allclose(np.mean(whole, axis=(0, 2)), 0.0, atol=1e-6)
    assert_allclose(np.std(whole, axis=(0, 2)), 1.0, rtol=1e-5)
    assert np.isinf(in_shards(largest, jnp.array([1.0, np.nan]))).all()
    assert_allclose(in_shards(averaged, (jnp.array([1.0, 3.0]),))[0], 2.0)


def test_adam_takes_steps_of_the_rate_and_large_gradients_are_scaled():
    parameters = (jnp.array([1.0, -1.0]),)
    moments = learner.ADAM.init(parameters)
    gradient_of, rate = (jnp.array([30.0, -40.0]),), jnp.float32(0.1)
    (after,), moments = learner.optimiser_step("adam", parameters, gradient_of, moments, rate, jnp.float32(0.5))
    assert_allclose(after, [0.9, -0.9], rtol=1e-3)
    assert_allclose(moments.mu[0], 0.1 * np.array([0.3, -0.4]), rtol=1e-4)


WIDTHS = ((12, 24), (24, 16), (16, 2))


def test_muon_takes_orthogonal_steps_in_hidden_matrices_and_those_of_adam_elsewhere():
    rng, rate, largest = np.random.default_rng(0), jnp.float32(1e-3), jnp.float32(1.0)
    zero, gradient = (
        learner.Actor(
            tuple(Layer(*(jnp.float32(make(shape)) for shape in (pair, pair[1:]))) for pair in WIDTHS),
            jnp.zeros(0),
        )
        for make in (np.zeros, rng.standard_normal)
    )
    after = {}
    for name, optimiser in learner.OPTIMISERS.items():
        after[name] = learner.optimiser_step(name, zero, gradient, optimiser.init(zero), rate, largest)[0].layers
    for ours, adam, slope in zip(after["muon"], after["adam"], gradient.layers, strict=True):
        assert_allclose(ours.bias, adam.bias)
        if ours.weight.shape[1] > learner.ACTIONS:
            singular = np.linalg.svd(ours.weight, compute_uv=False) / (1e-3 * 0.2 * max(ours.weight.shape) ** 0.5)
            assert 0.6 < singular.min() < singular.max() < 1.3
            assert np.sum(ours.weight * slope.weight) < 0.0
        else:
            assert_allclose(ours.weight, adam.weight)


def test_the_gradient_of_an_engagement_is_clipped_alone():
    def loss(rows):
        return jnp.sum(gradient.clip_cotangent(rows, jnp.float32(1.0)) * jnp.array([[3.0, 4.0], [0.3, 0.4]]))

    assert_allclose(jax.grad(loss)(jnp.ones((2, 2))), [[0.6, 0.8], [0.3, 0.4]], rtol=1e-6)


def test_the_gradient_of_a_window_is_its_slope(quick_jit):
    # Seven decisions of engagements of five and ten: the gradient also stops where another engagement begins.
    task = af.Task.load("dynamic").replace(lengths_s=(0.1, 0.2), short_share=0.5)
    environment, rng = af.make_environment(PAPER, task), np.random.default_rng(0)
    config = GradientConfig(environments=8, hidden=8, layers=1, shards=1, optimiser="adam")
    state = gradient.GRADIENT.begin(jax.tree.map(jnp.asarray, environment), config, jax.random.key(1))
    fresh = environment.fresh(rng.standard_normal((8, environment.normals)), rng.random((8, environment.uniforms)))
    normals = rng.standard_normal((7, environment.normals, 8))

    def double(array):
        array = np.asarray(array)
        return jnp.asarray(array, jnp.float64 if array.dtype.kind == "f" else array.dtype)

    with jax.enable_x64(True):
        given = jax.tree.map(double, (environment, state._replace(key=jnp.zeros(())), normals, fresh))
        run = quick_jit(jax.value_and_grad(gradient.window_loss, has_aux=True))

        def loss(actor):
            return run(actor, *given, jnp.inf)

        actor = given[1].actor
        for _ in range(3):
            along = jax.tree.map(lambda each: double(rng.standard_normal(each.shape)), actor)
            near = [jax.tree.map(lambda a, d, by=by: a + by * d, actor, along) for by in (1e-6, -1e-6)]
            (ahead, _), (behind, _) = (loss(each)[0] for each in near)
            pairs = zip(jax.tree.leaves(loss(actor)[1]), jax.tree.leaves(along), strict=True)
            assert sum(float(jnp.sum(a * b)) for a, b in pairs) == pytest.approx(float(ahead - behind) / 2e-6, rel=1e-4)
        ended = np.asarray(loss(actor)[0][1][0].left) > 5
        assert ended.any()


def test_iterations_end_with_the_one_before_the_first_bad_one_in_any_shard():
    def iteration(environment, settings, before, sizes):
        assert sizes["environments"] == 2
        after = before._replace(iteration=before.iteration + 1, observation=before.observation * 2.0)
        wrong = (before.iteration == 2) & (before.observation[0, 0] < 0.0)
        return after, {"number": after.iteration}, {"reward": jnp.where(wrong, jnp.nan, 1.0)}

    actor, rows = learner.Actor((), jnp.zeros(2)), jnp.array([[1.0], [2.0], [-3.0], [4.0]])
    nothing = Normaliser(jnp.zeros(1), jnp.ones(1), jnp.float32(0))
    state = learner.Learner(actor, (), (), nothing, jnp.zeros((4, 0)), rows, jax.random.key(0), jnp.int32(0))
    sizes, state = (("environments", 4), ("shards", 2)), placed(state, 2, learner.SPLIT)
    kept, metrics = learner.iterate(iteration, (), {}, state, sizes, 4)
    assert (int(kept.iteration), metrics["number"].tolist()) == (2, [1, 2, 3, 3])
    assert_array_equal(kept.observation, 4.0 * rows)
    assert np.isinf(metrics["watched"][:, 2]).tolist() == [False, False, True, True]
    programs = learner.iterate._cache_size()
    learner.iterate(iteration, (), {}, kept, sizes, 4)
    assert learner.iterate._cache_size() == programs  # compiled once, also with an empty part of the state


@pytest.mark.parametrize("count", [1, 2, 4])  # there are two devices; four shards run side by side on one
def test_shards_have_parts_of_what_is_split_and_agree_on_the_rest(count):
    run = over_shards(lambda rows, w: (averaged(jnp.mean(rows) * w), 2.0 * rows), count, (True, False), (False, True))
    rows = jnp.arange(8.0)
    mean, twice = run(placed(rows, count, True), jnp.float32(3.0))
    assert float(mean) == pytest.approx(3.0 * 3.5)
    assert_allclose(twice, 2.0 * rows)


DEFAULTS = [
    (PAPER, "any", {}, ("gradient", "multimodel", "smooth-hit", 0.0, 18_000_000)),
    (INFANTRY, "strafe", {}, ("gradient", "multimodel", "smooth-hit", 0.0, 18_000_000)),
    (PAPER, "kinds", {}, ("gradient", "multimodel", "smooth-hit", 0.0, 9_000_000)),
    (PAPER, "paper", {}, ("gradient", "history", "smooth-hit", 0.5, 4_000_000)),
    (INFANTRY, "paper", {}, ("gradient", "tracked", "smooth-hit", 0.35, 8_000_000)),
    (PAPER, "paper", {"observation": "paper"}, ("ppo", "paper", "eq-8", 0.5, 2_000_000)),
    (INFANTRY, "paper", {"observation": "paper"}, ("ppo", "paper", "eq-8", 0.5, 1_200_000)),
    (INFANTRY, "paper", {"trainer": "ppo"}, ("ppo", "tracked", "hit", 0.35, 2_000_000)),
    (PAPER, "paper", {"still_share": 0.2, "reward": "hit"}, ("gradient", "history", "hit", 0.2, 4_000_000)),
]


@pytest.mark.parametrize(("robot", "task", "given", "expected"), DEFAULTS)
def test_what_is_not_given_follows_robot_and_task(robot, task, given, expected):
    found = TrainConfig(**given).resolved(robot, af.Task.load(task))
    assert (found.trainer, found.observation, found.reward, found.settings.steps) == (*expected[:3], expected[4])
    assert (found.gradient.optimiser, found.gradient.hidden) == (("adam", 256) if task == "paper" else ("muon", 480))
    assert found.still_share == pytest.approx(expected[3])
    assert found.ppo.discount == (0.9 if given.get("observation") == "paper" and robot is INFANTRY else 0.95)


FAULTS = [
    (GradientConfig, {"environments": 33}, "environments = 33 must divide into 2 parts"),
    (GradientConfig, {"hidden": 2, "layers": 3}, "3 layers halve 2 neurons to none"),
    (GradientConfig, {"learning_rate": 0.0}, "learning_rate: expected float > 0"),
    (PpoConfig, {"minibatches": 7}, "environments × rollout = 12800 must divide into 14 parts"),
    (PpoConfig, {"log_std": -5.0}, "log_std of at least log_std_floor"),
    (PpoConfig, {"clip": math.nan}, "clip: expected"),
    (TrainConfig, {"trainer": "sac"}, "trainer: invalid enum value 'sac', expected one of gradient, ppo;"),
    (GradientConfig, {"lr": 1}, "GradientConfig: there is no field lr; fields are steps, environments, window"),
    (TrainConfig, {"ppo": {"epoch": 3}}, "PpoConfig: there is no field epoch; perhaps you meant epochs"),
]


@pytest.mark.parametrize(("kind", "given", "complaint"), FAULTS)
def test_wrong_settings_are_named(kind, given, complaint, refused):
    refused(complaint, kind, **given)

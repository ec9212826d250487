"""One gradient step, against hand calculations."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from archerfish.controllers.network import Layer, forward
from archerfish.learning.config import PpoConfig
from archerfish.learning.gaussian import log_probability
from archerfish.learning.update import (
    ADAM,
    Actor,
    Batch,
    Hyper,
    Networks,
    actor_loss,
    adam_step,
    begin_networks,
    forward_columns,
    hyper,
    normalised,
    update,
)

take_step, loss_of = jax.jit(update), jax.jit(actor_loss)
slope_of = jax.jit(jax.grad(actor_loss, has_aux=True))
SETTINGS = hyper(PpoConfig())
CENTRAL = -math.log(2 * math.pi)
"""Logarithm of the density of two standard normals at their mean."""


def standard_actor() -> Actor:
    """Mean 0 and standard deviation 1, whatever is observed."""
    return Actor((Layer(jnp.zeros((3, 4)), jnp.zeros(4)), Layer(jnp.zeros((4, 2)), jnp.zeros(2))), jnp.zeros(2))


def batch_with(ratios: list[float], advantages: list[float]) -> Batch:
    """Actions at the mean of `standard_actor` whose probability was such that eq (10) sees these ratios."""
    count = len(ratios)
    return Batch(
        observation=jnp.ones((1 + 3, count)),
        action=jnp.zeros((count, 2)),
        log_probability=CENTRAL - jnp.log(jnp.array(ratios)),
        advantage=jnp.array(advantages),
        target=jnp.zeros(count),
    )


def random_batch(seed: int = 0) -> Batch:
    keys = jax.random.split(jax.random.key(seed), 5)
    shapes = ((3, 16), (16, 2), (16,), (16,), (16,))
    observation, *others = (jax.random.normal(key, shape) for key, shape in zip(keys, shapes, strict=True))
    return Batch(jnp.concatenate([jnp.ones((1, 16)), observation]), *others)


def random_networks() -> Networks:
    return begin_networks(Actor(random_layers(1, outputs=2), jnp.full(2, -1.0)), random_layers(2, outputs=1))


def random_layers(seed: int, outputs: int) -> tuple[Layer, ...]:
    first, last = jax.random.split(jax.random.key(seed))
    return (
        Layer(jax.random.normal(first, (3, 8)), jnp.zeros(8)),
        Layer(jax.random.normal(last, (8, outputs)), jnp.zeros(outputs)),
    )


def largest_change(before: Any, after: Any) -> float:
    pairs = zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True)
    return max(float(jnp.max(jnp.abs(a - b))) for a, b in pairs)


def test_the_clipped_objective_of_eq_10_by_hand() -> None:
    # ε = 0.2.
    #   ρ      A    ρ A    clip(ρ) A   min
    #   1.5    1    1.5      1.2       1.2
    #   0.5    1    0.5      0.8       0.5
    #   1.5   −1   −1.5     −1.2      −1.5
    #   0.9   −1   −0.9     −0.9      −0.9
    loss, (divergence, clipped) = loss_of(standard_actor(), batch_with([1.5, 0.5, 1.5, 0.9], [1, 1, -1, -1]), SETTINGS)
    assert float(loss) == pytest.approx(-(1.2 + 0.5 - 1.5 - 0.9) / 4, abs=1e-6)
    assert float(clipped) == 0.75
    by_hand = sum(ratio - 1 - math.log(ratio) for ratio in (1.5, 0.5, 1.5, 0.9)) / 4
    assert float(divergence) == pytest.approx(by_hand, abs=1e-6)


def test_a_network_of_columns_is_that_of_rows() -> None:
    batch, layers = random_batch(), random_layers(3, outputs=2)
    layers = tuple(layer._replace(bias=jnp.arange(1.0, 1.0 + len(layer.bias))) for layer in layers)
    rows = forward(layers, batch.observation[1:].T)
    np.testing.assert_allclose(forward_columns(layers, batch.observation), rows.T, rtol=1e-5, atol=1e-5)


def test_advantages_are_normalised_over_each_minibatch() -> None:
    found = normalised(jnp.array([[107.0, 107.0, 93.0, 93.0], [0.0, 2.0, 2.0, 0.0]]))
    np.testing.assert_allclose(found, [[1, 1, -1, -1], [-1, 1, 1, -1]], atol=1e-5)


def test_a_sample_that_is_clipped_and_good_has_no_gradient() -> None:
    beyond, _ = slope_of(standard_actor(), batch_with([1.5, 0.5, 1.5, 0.5], [1, -1, 1, -1]), SETTINGS)
    within, _ = slope_of(standard_actor(), batch_with([1.1, 0.9, 1.1, 0.9], [1, -1, 1, -1]), SETTINGS)
    assert float(optax.tree.norm(beyond)) == 0.0
    assert float(optax.tree.norm(within)) > 0.0


def test_the_entropy_bonus_is_counted_by_its_weight() -> None:
    batch = batch_with([1.0] * 4, [1, -1, 1, -1])
    without = loss_of(standard_actor(), batch, SETTINGS)[0]
    with_bonus = loss_of(standard_actor(), batch, SETTINGS._replace(entropy=jnp.float32(0.5)))[0]
    assert float(without - with_bonus) == pytest.approx(0.5 * (1 + math.log(2 * math.pi)), rel=1e-5)


def test_actor_and_critic_learn_at_rates_of_their_own() -> None:
    # The first step of Adam has the size of the learning rate wherever the gradient is not small.
    networks = random_networks()
    after, _ = take_step(SETTINGS, networks, random_batch(), jnp.float32(1.0))
    assert largest_change(networks.actor, after.actor) == pytest.approx(1e-3, rel=0.01)
    assert largest_change(networks.critic, after.critic) == pytest.approx(3e-3, rel=0.01)


def test_annealing_scales_both_rates() -> None:
    networks = random_networks()
    after, _ = take_step(SETTINGS, networks, random_batch(), jnp.float32(0.1))
    assert largest_change(networks.actor, after.actor) == pytest.approx(1e-4, rel=0.01)
    assert largest_change(networks.critic, after.critic) == pytest.approx(3e-4, rel=0.01)


@pytest.mark.parametrize(("norm", "kept"), [(0.3, 0.3), (0.5, 0.5), (40.0, 0.5)])
def test_a_gradient_is_scaled_to_the_largest_norm(norm: float, kept: float) -> None:
    parameters = {"a": jnp.zeros(3), "b": jnp.zeros((2, 2))}
    gradient = {"a": norm * jnp.array([0.6, 0.0, 0.0]), "b": norm * jnp.array([[0.0, 0.8], [0.0, 0.0]])}
    _, moments = adam_step(parameters, gradient, ADAM.init(parameters), jnp.float32(1e-3), SETTINGS)
    # Adam's first moment begins as a tenth of the gradient that it was given.
    given = jax.tree.map(lambda each: 10.0 * each, moments.mu)
    assert float(optax.tree.norm(given)) == pytest.approx(kept, rel=1e-5)
    assert float(given["a"][0] / given["b"][0, 1]) == pytest.approx(0.75, rel=1e-5)


def test_a_huge_error_of_the_critic_does_not_slow_the_actor() -> None:
    networks, batch = random_networks(), random_batch()
    calm, _ = take_step(SETTINGS, networks, batch, jnp.float32(1.0))
    upset, _ = take_step(SETTINGS, networks, batch._replace(target=1e4 * batch.target), jnp.float32(1.0))
    assert largest_change(calm.actor, upset.actor) == 0.0


@pytest.mark.parametrize("floor", [-1.0, -1.0005])
def test_the_standard_deviation_never_falls_below_its_floor(floor: float) -> None:
    settings = SETTINGS._replace(log_std_floor=jnp.float32(floor))
    networks, lowest = random_networks(), []
    # The mean action was better than those around it, so the actor wants to be surer of itself.
    actor = standard_actor()._replace(log_std=networks.actor.log_std)
    action = jnp.array([[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0]])
    chance = log_probability(action, jnp.zeros((4, 2)), actor.log_std)
    batch = batch_with([1.0] * 4, [3, -1, -1, -1])._replace(action=action, log_probability=chance)
    learning = begin_networks(actor, networks.critic)
    for _ in range(5):
        learning, _ = take_step(settings, learning, batch, jnp.float32(1.0))
        lowest.append(float(jnp.min(learning.actor.log_std)))
    assert min(lowest) == pytest.approx(floor, abs=1e-6)


def test_without_annealing_the_learning_rates_stay() -> None:
    assert float(hyper(PpoConfig(anneal=False)).anneal_over) > 1e8
    assert float(hyper(PpoConfig()).anneal_over) == PpoConfig().iterations


def test_every_traced_setting_is_that_of_the_configuration() -> None:
    config = PpoConfig(clip=0.3, discount=0.8, trace=0.7, entropy=0.1, gradient_norm=2.0, log_std_floor=-2.0)
    found = Hyper(*(float(each) for each in hyper(config)))
    for name in ("actor_learning_rate", "clip", "discount", "trace", "entropy", "gradient_norm", "log_std_floor"):
        np.testing.assert_allclose(getattr(found, name), getattr(config, name), rtol=1e-6)

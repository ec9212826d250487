"""Training by gradients: against finite differences, in environments whose best policy is known, and as a whole."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from archerfish.controllers.network import forward, normalise
from archerfish.learning.checkpoint import read_checkpoint, write_checkpoint
from archerfish.learning.gradient import GRADIENT, begin_learner, iterate, window_loss
from archerfish.learning.gradient_config import GradientConfig
from archerfish.learning.ppo import Learner
from archerfish.learning.training import CHUNK, Trained, train, trained_policy, weights_hash
from archerfish.records.errors import InputError
from archerfish.simulation.environment import Outcome, ShootingEnvironment

TINY = GradientConfig(steps=2 * CHUNK * 8 * 4, environments=8, window=4, hidden=8)
"""Two compiled calls of `train`."""


def test_the_gradient_is_that_of_finite_differences(shooting_under_gate: ShootingEnvironment) -> None:
    # Seven decisions of engagements of five: the gradient must also stop where another engagement begins.
    environment = shooting_under_gate
    learner = begin_learner(environment, replace(TINY, environments=4), jax.random.key(0))
    generator = np.random.default_rng(0)
    draws = generator.standard_normal((7, environment.normals, 4)), generator.random((7, environment.uniforms, 4))
    with jax.enable_x64(True):
        environment, learner = jax.tree.map(in_double_precision, (environment, learner._replace(key=None)))
        actor, normaliser = learner.networks.actor, learner.normaliser
        begun = learner.environment._replace(step=learner.environment.step.astype(int))
        start = (environment, normaliser, begun, learner.observation, jax.tree.map(jnp.asarray, draws))
        slope = jax.jit(jax.value_and_grad(window_loss, has_aux=True))

        def loss(actor: Any) -> float:
            return float(slope(actor, *start)[0][0])

        gradient = slope(actor, *start)[1]
        for _ in range(5):
            way = jax.tree.map(lambda each: jnp.asarray(generator.standard_normal(each.shape)), actor)
            ahead, behind = (jax.tree.map(lambda a, b, e=e: a + e * b, actor, way) for e in (1e-7, -1e-7))
            found = sum(float(jnp.sum(a * b)) for a, b in zip(*map(jax.tree.leaves, (gradient, way)), strict=True))
            assert found == pytest.approx((loss(ahead) - loss(behind)) / 2e-7, rel=1e-4)


def in_double_precision(array: Array) -> Array:
    return array.astype(jnp.float64) if jnp.issubdtype(array.dtype, jnp.floating) else array


class LateState(NamedTuple):
    kind: Array
    """Of the episode, −1 or 1, shape (B,)."""
    action: Array
    """The one before, shape (B, 2)."""
    step: Array
    """Decisions taken in the episode, shape (B,)."""


class Late(NamedTuple):
    """Episodes in which an action counts a decision later: what is best is only known from beyond the next step.

    The observation is (kind, 3). The reward is the squared distance of the action before from the goal, negated.
    """

    length: Array
    """Decisions per episode."""
    goal: Array
    """The best action of kind 1, and the negative of that of kind −1, shape (2,)."""

    @property
    def observed(self) -> int:
        return 2

    @property
    def normals(self) -> int:
        return 1

    @property
    def uniforms(self) -> int:
        return 1

    def begin(self, normals: Array, uniforms: Array) -> tuple[LateState, Array]:
        batch = uniforms.shape[0]
        kind = jnp.where(uniforms[:, 0] < 0.5, -1.0, 1.0)
        state = LateState(kind, self.goal[None, :] * kind[:, None], jnp.arange(batch) % 2)
        return state, self.see(state)

    def step(self, state: LateState, action: Array, normals: Array, uniforms: Array) -> tuple[LateState, Outcome]:
        distance = state.action - self.goal[None, :] * state.kind[:, None]
        going_on = LateState(state.kind, action, state.step + 1)
        ended = going_on.step >= self.length
        fresh, _ = self.begin(normals, uniforms)
        following = jax.tree.map(
            lambda new, old: jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old), fresh, going_on
        )
        reward = -jnp.sum(distance**2, axis=-1)
        return following, Outcome(self.see(following), self.see(going_on), reward, ended & False, ended)

    def see(self, state: LateState) -> Array:
        return jnp.stack([state.kind, jnp.full_like(state.kind, 3.0)], axis=-1)


LATE = Late(np.array(6), np.array([0.5, -0.3], np.float32))


@pytest.fixture(scope="module")
def solved() -> Learner:
    config = GradientConfig(steps=240 * 32 * 4, environments=32, window=4, hidden=16, learning_rate=1e-2)
    return train(LATE, config, seed=0, trainer=GRADIENT).learner


def test_an_action_is_credited_with_what_it_does_a_decision_later(solved: Learner) -> None:
    seen = normalise(solved.normaliser, jnp.array([[-1.0, 3.0], [1.0, 3.0]]))
    actions = forward(solved.networks.actor.layers, seen)
    np.testing.assert_allclose(actions, [[-0.5, 0.3], [0.5, -0.3]], atol=0.02)


def test_the_normaliser_has_met_every_observation_once(solved: Learner) -> None:
    assert float(solved.normaliser.count) == 240 * 32 * 4
    np.testing.assert_allclose(solved.normaliser.mean, [0.0, 3.0], atol=0.05)
    np.testing.assert_allclose(solved.normaliser.variance, [1.0, 0.0], atol=0.01)


@pytest.fixture(scope="module")
def trained(shooting: ShootingEnvironment) -> Trained:
    return train(shooting, TINY, seed=0, trainer=GRADIENT)


def test_the_same_seed_gives_the_same_weights_and_another_one_others(
    shooting: ShootingEnvironment, trained: Trained
) -> None:
    again, other = (train(shooting, TINY, seed, trainer=GRADIENT) for seed in (0, 1))
    assert weights_hash(again.learner) == weights_hash(trained.learner)
    np.testing.assert_array_equal(again.curve.mean_reward, trained.curve.mean_reward)
    assert weights_hash(other.learner) != weights_hash(trained.learner)


def test_learning_rate_steps_and_world_compile_nothing_anew(
    shooting: ShootingEnvironment, shooting_under_gate: ShootingEnvironment, trained: Trained
) -> None:
    before = iterate._cache_size()
    config = replace(TINY, learning_rate=1e-4, gradient_norm=1.0, anneal=False, steps=4 * TINY.steps)
    train(shooting, config, seed=0, trainer=GRADIENT)
    under_gate = train(shooting_under_gate, TINY, seed=0, trainer=GRADIENT)
    assert iterate._cache_size() == before
    assert weights_hash(under_gate.learner) != weights_hash(trained.learner)


def test_engagements_go_on_from_window_to_window(shooting: ShootingEnvironment) -> None:
    # Eight engagements of five decisions, begun staggered; four windows of four decisions later each is 16 further.
    learner = begin_learner(shooting, TINY, jax.random.key(0))
    begun = np.asarray(learner.environment.step)
    assert set(begun) == {0, 1, 2, 3, 4}
    learner, _ = GRADIENT.advance(shooting, TINY, learner, CHUNK)
    np.testing.assert_array_equal(learner.environment.step, (begun + 4 * CHUNK) % 5)


def test_a_learner_is_read_back_and_goes_on_as_if_nothing_had_been(
    tmp_path: Path, shooting: ShootingEnvironment, trained: Trained
) -> None:
    half_way, _ = GRADIENT.advance(shooting, TINY, begin_learner(shooting, TINY, jax.random.key(0)), CHUNK)
    write_checkpoint(tmp_path / "checkpoint.json", half_way, {})
    restored, _ = read_checkpoint(tmp_path / "checkpoint.json", begin_learner(shooting, TINY, jax.random.key(9)))
    resumed, _ = GRADIENT.advance(shooting, TINY, restored, CHUNK)
    assert weights_hash(resumed) == weights_hash(trained.learner)


def test_a_training_that_diverges_is_refused(shooting: ShootingEnvironment) -> None:
    with pytest.raises(InputError, match=re.escape("training diverged after 0 decisions")):
        train(shooting, replace(TINY, learning_rate=1e38, anneal=False), seed=0, trainer=GRADIENT)


def test_the_trained_policy_is_in_numpy(shooting: ShootingEnvironment, trained: Trained) -> None:
    policy = trained_policy(shooting.observer, trained.learner)
    assert all(isinstance(leaf, np.ndarray | np.generic) for leaf in jax.tree.leaves(policy))

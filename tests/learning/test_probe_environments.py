"""Environments so simple that the solution is known, each of which only one part of the algorithm can solve.

All are one record with other numbers in it, so that one compiled program trains in every one of them.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from archerfish.controllers.network import forward, normalise
from archerfish.learning.config import PpoConfig
from archerfish.learning.ppo import Learner
from archerfish.learning.training import train
from archerfish.simulation.environment import Outcome


class ProbeState(NamedTuple):
    kind: Array
    """Of the episode, −1 or 1, drawn at its beginning; shape (B,)."""
    step: Array
    """Decisions taken in it, shape (B,)."""


class Probe(NamedTuple):
    """Episodes of a few decisions; the observation is (kind of the episode, decisions taken in it).

    The count stays at that of the last decision: where the time is up, the world goes on as it was.
    """

    length: Array
    """Decisions per episode."""
    terminates: Array
    """Whether nothing follows an episode; otherwise its time is only up."""
    always: Array
    """Reward of every decision."""
    if_positive: Array
    """Reward of every decision in an episode of kind 1."""
    at_end: Array
    """Reward of the last decision."""
    weight: Array
    """Of the squared distance of the action from the goal, taken off the reward."""
    goal: Array
    """The best action, shape (2,)."""
    goal_by_kind: Array
    """What an episode's kind adds to it, shape (2,)."""

    @property
    def observed(self) -> int:
        return 2

    @property
    def normals(self) -> int:
        return 1

    @property
    def uniforms(self) -> int:
        return 1

    def begin(self, normals: Array, uniforms: Array) -> tuple[ProbeState, Array]:
        state = ProbeState(jnp.where(uniforms[:, 0] < 0.5, -1.0, 1.0), jnp.zeros(uniforms.shape[0]))
        return state, self.see(state)

    def step(self, state: ProbeState, action: Array, normals: Array, uniforms: Array) -> tuple[ProbeState, Outcome]:
        going_on = ProbeState(state.kind, state.step + 1.0)
        ended = going_on.step >= self.length
        distance = action - self.goal[None, :] - self.goal_by_kind[None, :] * state.kind[:, None]
        reward = self.always + self.if_positive * (state.kind > 0) + self.at_end * ended
        reward = reward - self.weight * jnp.sum(distance**2, axis=-1)
        fresh, first = self.begin(normals, uniforms)
        following = jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, going_on)
        observation = jnp.where(ended[:, None], first, self.see(going_on))
        terminated = ended & (self.terminates > 0)
        return following, Outcome(observation, self.see(going_on), reward, terminated, ended & ~terminated)

    def see(self, state: ProbeState) -> Array:
        return jnp.stack([state.kind, jnp.minimum(state.step, self.length - 1.0)], axis=-1)


def probe(**numbers: Any) -> Probe:
    plain = dict.fromkeys(Probe._fields, 0.0) | {"length": 1.0, "goal": (0.0, 0.0), "goal_by_kind": (0.0, 0.0)}
    return Probe(**{name: np.array(value, np.float32) for name, value in (plain | numbers).items()})


CONFIG = PpoConfig(
    steps=240 * 32 * 8,
    environments=32,
    rollout=8,
    minibatches=2,
    epochs=4,
    hidden=16,
    actor_learning_rate=1e-2,
    critic_learning_rate=1e-2,
    discount=0.8,
    trace=0.95,
)


def solve(**numbers: Any) -> Learner:
    return train(probe(**numbers), CONFIG, seed=0).learner


def values(learner: Learner, *observations: tuple[float, float]) -> np.ndarray:
    return run(learner, learner.networks.critic, observations)[:, 0]


def actions(learner: Learner, *observations: tuple[float, float]) -> np.ndarray:
    return run(learner, learner.networks.actor.layers, observations)


def run(learner: Learner, network: Any, observations: tuple[tuple[float, float], ...]) -> np.ndarray:
    return np.asarray(forward(network, normalise(learner.normaliser, jnp.array(observations))))


def test_the_value_of_a_constant_reward_is_learnt() -> None:
    learner = solve(always=1.0, terminates=1.0)
    np.testing.assert_allclose(values(learner, (-1, 0), (1, 0)), 1.0, atol=0.05)


def test_a_reward_one_decision_later_is_discounted() -> None:
    learner = solve(at_end=1.0, length=2.0, terminates=1.0)
    np.testing.assert_allclose(values(learner, (1, 0), (1, 1)), [0.8, 1.0], atol=0.05)


def test_a_truncated_constant_reward_is_worth_all_that_would_follow() -> None:
    # r / (1 − γ) = 5. Episodes of kind −1 pay nothing: bootstrapping from the next episode would mix the two.
    learner = solve(if_positive=1.0, length=3.0)
    np.testing.assert_allclose(values(learner, (1, 0), (1, 1), (1, 2)), 5.0, atol=0.3)
    np.testing.assert_allclose(values(learner, (-1, 0), (-1, 1), (-1, 2)), 0.0, atol=0.3)


def test_a_terminated_constant_reward_is_worth_what_is_left_of_the_episode() -> None:
    learner = solve(if_positive=1.0, length=3.0, terminates=1.0)
    np.testing.assert_allclose(values(learner, (1, 0), (1, 1), (1, 2)), [1 + 0.8 + 0.64, 1.8, 1.0], atol=0.15)


def test_the_best_action_is_found() -> None:
    learner = solve(weight=1.0, goal=(0.5, -0.3), terminates=1.0)
    np.testing.assert_allclose(actions(learner, (-1, 0), (1, 0)), [[0.5, -0.3]] * 2, atol=0.05)
    assert float(np.exp(learner.networks.actor.log_std).max()) < 0.2


def test_the_best_action_depends_on_what_is_seen() -> None:
    learner = solve(weight=1.0, goal_by_kind=(0.5, -0.3), terminates=1.0)
    np.testing.assert_allclose(actions(learner, (-1, 0), (1, 0)), [[-0.5, 0.3], [0.5, -0.3]], atol=0.05)


@pytest.mark.parametrize("seed", [1, 2])
def test_other_seeds_find_it_too(seed: int) -> None:
    learner = train(probe(weight=1.0, goal_by_kind=(0.5, -0.3), terminates=1.0), CONFIG, seed).learner
    np.testing.assert_allclose(actions(learner, (-1, 0), (1, 0)), [[-0.5, 0.3], [0.5, -0.3]], atol=0.05)

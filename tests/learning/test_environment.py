"""The environment: engagements that end in their time, what replaces them, and what a decision is worth."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish as af
from archerfish.arrays import leaves, map_arrays
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.controllers.policy.policy import Policy
from archerfish.evaluation.rollout import run_engagements
from archerfish.learning.config import TrainConfig
from archerfish.learning.environment import HIDDEN
from archerfish.learning.reward import Reward
from archerfish.protocols import Shot

TASK = af.Task.load("dynamic").replace(lengths_s=(0.1, 0.3), short_share=0.5)
ENVIRONMENT = af.make_environment(task=TASK)
SHOT = {"plate": np.zeros(4, np.int32), "flight_time": np.zeros(4), "angle": np.zeros((4, 2))}


def draws(environment, batch, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.standard_normal((batch, environment.normals), np.float32)
    return normals, rng.random((batch, environment.uniforms), np.float32)


def test_every_engagement_lasts_its_own_length_and_the_first_ones_are_staggered():
    (state, _), count = ENVIRONMENT.begin(*draws(ENVIRONMENT, 40)), 40
    whole = np.round(state.world.engagement.duration / 0.02).astype(int)
    assert set(whole) == {5, 15}
    assert np.all((state.left > 0) & (state.left <= whole))
    assert len(set(state.left[whole == 15])) == 10
    left, lasted = state.left.copy(), np.zeros(count, int)
    for step in range(1, 60):
        fresh, (normals, _) = ENVIRONMENT.fresh(*draws(ENVIRONMENT, count, step)), draws(ENVIRONMENT, count, 99 + step)
        state, given = ENVIRONMENT.step(state, np.zeros((count, 2), np.float32), normals, fresh)
        lasted += 1
        ended = given.truncated
        assert_array_equal(lasted[ended], left[ended])
        assert not given.terminated.any()
        assert_array_equal(given.observation[~ended], given.final_observation[~ended])
        assert_array_equal(given.observation[ended], fresh[1][ended])
        for ours, theirs in zip(leaves(state), leaves(fresh[0]), strict=True):
            assert_array_equal(ours[ended], theirs[ended])
        assert not np.any(np.all(given.final_observation[ended] == fresh[1][ended], axis=-1))
        lasted[ended], left = 0, np.where(ended, state.left, left)


def test_a_policy_acts_in_the_environment_as_in_an_evaluation():
    rng, task = np.random.default_rng(5), af.Task.load("dynamic")
    environment = af.make_environment(task=task)
    size = sum(size for _, size in environment.observer.layout())
    layers = (Layer(rng.normal(0.0, 0.1, (size, 2)).astype(np.float32), np.zeros(2, np.float32)),)
    normaliser = Normaliser(np.zeros(size, np.float32), np.ones(size, np.float32), np.float32(0.0))
    policy = Policy(environment.observer, normaliser, layers)
    normals, uniforms = rng.standard_normal((6, 20, 6), np.float32), draws(environment, 6)[1]
    expected = run_engagements(environment.world, policy, environment.scenario.draw(uniforms), normals).shot
    fresh = environment.fresh(normals[:, -1], uniforms)
    state, observation = fresh
    for place in range(20):
        state, given = environment.step(state, policy.action(observation), normals[:, place], fresh)
        observation = given.observation
        assert_allclose(given.shot.miss, expected.miss[:, place], atol=1e-4)


def test_numpy_and_jax_step_alike(agree):
    environment = af.make_environment("tests/infantry", "dynamic")

    def run(environment, normals, uniforms, action):
        state, first = environment.begin(normals, uniforms)
        return first, environment.step(state, action, normals, environment.fresh(normals, uniforms))

    agree(run, environment, *draws(environment, 3), np.full((3, 2), 0.3), rtol=1e-3, atol=2e-3)


def test_rewards_are_those_of_eq_8_and_of_hits():
    miss = np.array([[0.03, 0.04], [0.0, 0.06], [0.3, -0.4], [np.nan, np.nan]])
    margin = np.array([0.01, 0.0, -0.44, -1e3])  # the last sends no pellet
    shot = Shot(fired=np.array([True, True, True, False]), miss=miss, margin=margin, **SHOT)
    weights = (1, 0, 0), (1, 0.1, 0), (0, 1, 0.01)
    rewards = [Reward(*map(np.asarray, (*each, 0.06)))(shot, None, None) for each in weights]
    assert_allclose(rewards[0], [-0.05, -0.06, -0.5, -1.06])
    assert_allclose(rewards[1], [0.05, 0.04, -0.5, -1.06])
    assert_allclose(rewards[2], [1 / (1 + np.exp(-1.0)), 0.5, 0.0, 0.0], atol=1e-12)


def test_a_users_reward_gets_shot_command_and_what_is_seen_after_it(refused):
    environment = af.make_environment(task=TASK, reward=lambda _, command, seen: seen.elapsed + command.angle[..., 1])
    state, _ = environment.begin(*draws(environment, 3))
    _, given = environment.step(state, np.zeros((3, 2), np.float32), draws(environment, 3)[0], (state, None))
    aim = environment.observer.view(state.memory).aim
    assert_allclose(given.reward, 0.02 + aim[:, 1], rtol=1e-5)
    refused("reward must be one of eq-8, hit, smooth-hit, or", af.make_environment, reward="nearest")
    refused("has no attribute 'margn'", af.make_environment, reward=lambda shot, *_: shot.margn)


@pytest.mark.parametrize(("trainer", "hidden"), [("gradient", 0), ("ppo", HIDDEN)])
def test_only_a_critic_sees_where_the_target_really_is(trainer, hidden):
    robot, task = af.Robot.load("tests/infantry"), af.Task.load("dynamic")
    environment = af.make_environment(robot, task, config=TrainConfig(trainer=trainer, observation="tracked"))
    state, _ = environment.begin(*draws(environment, 4))
    _, given = environment.step(state, np.zeros((4, 2), np.float32), draws(environment, 4)[0], (state, None))
    assert state.hidden.shape == given.hidden.shape == (4, hidden)
    if hidden:
        target = map_arrays(np.asarray, state.world.engagement.target)
        now, later = (target.at(np.full(4, each)).position[:, 0] for each in (0.0, 0.4))
        assert_allclose(state.hidden[:, :2], now[:, :2], rtol=1e-5)
        assert_allclose(state.hidden[:, -2:], 5.0 * (later - now)[:, :2], atol=1e-3)
        assert_allclose(given.hidden[:, :2], target.at(np.full(4, 0.02)).position[:, 0, :2], rtol=1e-5)


KINDS_OF = {None: ("paper", "history", "multimodel"), "tests/infantry": ("paper", "history", "tracked", "multimodel")}


@pytest.mark.parametrize("trainer", ["gradient", "ppo"])
@pytest.mark.parametrize(("robot", "kind"), [(robot, kind) for robot, kinds in KINDS_OF.items() for kind in kinds])
def test_an_observation_has_the_numbers_of_its_layout_and_no_others(robot, kind, trainer):
    environment = af.make_environment(robot, "dynamic", config=TrainConfig(observation=kind, trainer=trainer))
    _, observation = environment.fresh(*draws(environment, 2))
    assert observation.shape == (2, sum(size for _, size in environment.observer.layout()))

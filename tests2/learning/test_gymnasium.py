"""The environment for other libraries: no transition is lost, and wrong things are answered as users expect."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish2 as af
from archerfish2.simulation import picture

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("jax")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from archerfish2.learning.gymnasium import ShootingEnv, ShootingVectorEnv  # noqa: E402

ROOT, ID = Path(__file__).parents[2], "archerfish2:archerfish2/Shooting-v0"
TASK = af.Task.load("dynamic").replace(lengths_s=(0.1, 0.2), short_share=0.5)
FORKED = """
import warnings, gymnasium
warnings.simplefilter("ignore")
gymnasium.make("archerfish2:archerfish2/Shooting-v0", task="paper").reset(seed=0)
envs = gymnasium.make_vec("archerfish2/Shooting-v0", num_envs=2, vectorization_mode="async", task="paper")
print(envs.reset(seed=3)[0].shape, envs.step(envs.action_space.sample())[1].shape)
envs.close()
"""


@pytest.fixture(scope="module")
def environment():
    return af.make_environment(task=TASK)


def test_gymnasium_finds_no_fault_in_it_and_it_has_the_environment_of_a_training():
    env = gymnasium.make(ID, task="paper", render_mode="rgb_array")
    check_env(env.unwrapped)
    assert env.reset(seed=1)[0].shape == (35,)
    assert gymnasium.make(ID).reset(seed=1)[0].shape == (118,)  # as `train` takes it
    envs = gymnasium.make_vec(ID, num_envs=3, task="paper")
    assert isinstance(envs.unwrapped, ShootingVectorEnv)
    assert envs.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP


@pytest.mark.parametrize("steps", [60, pytest.param(10_000, marks=pytest.mark.slow)])
def test_no_transition_is_lost_or_repeated(environment, steps):
    envs = ShootingVectorEnv(3, environment=environment)
    singles = [ShootingEnv(environment=environment) for _ in range(3)]
    rng, (observation, _) = np.random.default_rng(0), envs.reset(seed=10)
    alone = [each.reset(seed=10 + place)[0] for place, each in enumerate(singles)]
    lengths, since = set(), np.zeros(3, int)
    for _ in range(steps):
        assert_allclose(observation, np.stack(alone), atol=2e-3)
        action = rng.uniform(-1.2, 1.2, (3, 2)).astype(np.float32)
        observation, reward, terminated, truncated, infos = envs.step(action)
        given = [each.step(own) for each, own in zip(singles, action, strict=True)]
        assert not terminated.any()
        assert_array_equal(truncated, [each[3] for each in given])
        assert_allclose(reward, [each[1] for each in given], atol=1e-3)
        assert_allclose(infos["miss"], [each[4]["miss"] for each in given], atol=1e-3)
        since += 1
        for place in range(3):
            alone[place] = given[place][0]
            if truncated[place]:
                assert_allclose(infos["final_obs"][place], alone[place], atol=2e-3)
                lengths.add(int(since[place]))
                alone[place], since[place] = singles[place].reset()[0], 0
    assert lengths == {5, 10}


def test_seeds_repeat_and_differ_and_a_batch_may_be_staggered(environment):
    envs = ShootingVectorEnv(3, environment=environment, staggered=True)
    first, again = envs.reset(seed=5)[0], envs.reset(seed=[5, 6, 7])[0]
    assert_array_equal(first, again)
    assert not np.array_equal(envs.reset()[0], first)
    assert len(np.unique(first, axis=0)) == 3
    ended = np.any([envs.step(np.zeros((3, 2), np.float32))[3] for _ in range(4)], axis=0)
    assert ended[2]  # of 5 or 10 decisions, 0.6 are cut off


def test_actions_beyond_the_bound_are_clipped_and_what_is_no_action_is_refused(environment, refused):
    env = ShootingEnv(environment=environment, action_bound=0.5)
    rewards = []
    for action in ([9.0, -9.0], np.array([0.5, -0.5]), np.array([1, -1])):  # lists, float64 and integers, too
        env.reset(seed=0)
        rewards.append(env.step(action)[1])
    assert rewards[0] == rewards[1] == rewards[2]
    for action in (np.zeros(3), np.zeros((1, 2)), np.array([np.nan, 0.0]), np.array(["a", "b"]), None):
        refused(r"an action must be finite numbers of shape \(2,\), pitch and yaw, got", env.step, action)
    refused("of shape .3, 2.,", ShootingVectorEnv(3, environment=environment).unwrapped._all.action, [0.0, 0.0], (3, 2))
    while not env.step(np.zeros(2, np.float32))[3]:
        pass
    for call in (env.step, ShootingEnv(environment=environment).step):
        with pytest.raises(gymnasium.error.ResetNeeded):
            call(np.zeros(2, np.float32))


def test_what_can_not_be_made_or_reset_is_named(environment, refused):
    refused("options robot, task, .*; got plant", ShootingEnv, plant="x")
    refused("got render_mode 'human'", ShootingEnv, "human")
    refused("an environment is given, so", ShootingEnv, environment=environment, task="paper")
    refused("action_bound must be finite and > 0, got 0", ShootingEnv, environment=environment, action_bound=0)
    refused("num_envs must be at least 1, got 0", ShootingVectorEnv, 0)
    envs = ShootingVectorEnv(2, environment=environment)
    refused("seed must be at least 0, got -1", envs.reset, seed=[0, -1])
    refused("seed must be one per environment: expected 2, got 3", envs.reset, seed=[1, 2, 3])
    refused("reset takes no options, got reset_mask", envs.reset, options={"reset_mask": [True]})


def test_a_picture_shows_gimbal_target_and_pellets(environment):
    envs = ShootingVectorEnv(3, render_mode="rgb_array", environment=environment)
    envs.reset(seed=0)
    before = envs.render()
    envs.step(np.ones((3, 2), np.float32))
    after = envs.render()
    assert before[0].shape == (picture.HEIGHT, picture.FIELD_WIDTH + picture.NEAR_WIDTH, 3)
    assert all(np.any(one != other) for one, other in zip(before, after, strict=True))
    drawn = picture.draw_picture((0.1, 0.2), (0.0, 0.0), (3.0, 0.0, 0.0), [(0.0, 0.0), (9.0, 9.0)], 0.06)
    rows, columns = np.nonzero(np.all(drawn[:, : picture.FIELD_WIDTH] == picture.GIMBAL, axis=-1))
    assert rows.mean() < picture.HEIGHT / 2  # muzzle up
    assert columns.mean() < picture.FIELD_WIDTH / 2  # to the left


def test_environments_in_forked_processes_answer():
    run = [sys.executable, "-c", FORKED]
    printed = subprocess.run(run, cwd=ROOT / "src", capture_output=True, text=True, timeout=60, check=True).stdout
    assert printed.split("\n")[0] == "(2, 35) (2,)"


def test_the_page_runs(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs2" / "gymnasium.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert sum("stable_baselines3" in each for each in blocks) == 1
    scope = {}
    for each in blocks:
        if "stable_baselines3" not in each:
            exec(each.replace("num_envs=64", "num_envs=4").replace("range(1000)", "range(20)"), scope)


def test_stable_baselines_trains_in_it_and_plays_in_an_evaluation(environment):
    stable_baselines3 = pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    from archerfish2.learning.stable_baselines import Player, ShootingVecEnv

    envs = ShootingVecEnv(4, environment=environment)
    model = stable_baselines3.PPO("MlpPolicy", envs, n_steps=8, batch_size=16).learn(64)
    cells = af.evaluate({"sb3": Player(model, environment.observer)}, task="static", engagements=2).cells
    assert [each.kind for each in cells] == ["user"] * 4

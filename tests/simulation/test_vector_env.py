from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("jax")
gymnasium = pytest.importorskip("gymnasium")

from archerfish.records.errors import InputError  # noqa: E402
from archerfish.simulation import registration  # noqa: E402, F401  # registers the environments
from archerfish.simulation.assembly import make_environment  # noqa: E402
from archerfish.simulation.draw_stream import BLOCK  # noqa: E402
from archerfish.simulation.gymnasium_env import ShootingEnv  # noqa: E402
from archerfish.simulation.vector_env import ShootingVectorEnv  # noqa: E402

LENGTH = 9
SEED = 40


def made() -> ShootingVectorEnv:
    return make_environment(decisions=LENGTH, command_limit="box")


def actions(steps: int, environments: int) -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.0, 1.0, (steps, environments, 2)).astype(np.float32)


def test_no_transition_is_lost_nor_made_up() -> None:
    """Step by step against single environments of the same seeds, over many ends and more than one block of draws."""
    environments, steps = 3, 4 * BLOCK
    vector = ShootingVectorEnv(environments, made())
    alone = [ShootingEnv(made()) for _ in range(environments)]
    seen, _ = vector.reset(seed=SEED)
    assert_allclose(seen, [env.reset(seed=SEED + i)[0] for i, env in enumerate(alone)], rtol=1e-4, atol=1e-4)
    for asked in actions(steps, environments):
        seen, reward, terminated, truncated, infos = vector.step(asked)
        assert not terminated.any()
        assert ("final_obs" in infos) == truncated.any()
        for i, env in enumerate(alone):
            final, own, _, ended, info = env.step(asked[i])
            assert ended == truncated[i]
            told = infos["final_info"] if ended else infos
            assert_allclose([reward[i], *told["miss"][i]], [own, *info["miss"]], rtol=1e-3, atol=1e-4)
            assert told["hit"][i] == info["hit"]
            if ended:
                assert infos["_final_obs"][i]
                assert_allclose(infos["final_obs"][i], final, rtol=1e-3, atol=1e-3)
                final, _ = env.reset()
            assert_allclose(seen[i], final, rtol=1e-3, atol=1e-3)


def test_gymnasium_makes_it_in_one_program() -> None:
    vector = gymnasium.make_vec("archerfish/Shooting-v0", num_envs=3, target="static")
    assert isinstance(vector.unwrapped, ShootingVectorEnv)
    assert vector.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.SAME_STEP
    observation, _ = vector.reset(seed=0)
    assert vector.observation_space.contains(observation)
    observation, reward, *_ = vector.step(vector.action_space.sample())
    assert vector.observation_space.contains(observation)
    assert reward.shape == (3,)


def test_gymnasium_counts_its_episodes() -> None:
    vector = gymnasium.wrappers.vector.RecordEpisodeStatistics(ShootingVectorEnv(3, made()))
    vector.reset(seed=0)
    rewards = []
    for asked in actions(LENGTH, 3):
        _, reward, _, _, infos = vector.step(asked)
        rewards.append(reward)
    assert infos["episode"]["l"].tolist() == [LENGTH] * 3
    assert_allclose(infos["episode"]["r"], np.sum(rewards, axis=0), rtol=1e-5)


def test_infos_are_those_of_gymnasium_s_own_vector_environment() -> None:
    mode = gymnasium.vector.AutoresetMode.SAME_STEP
    theirs = gymnasium.vector.SyncVectorEnv([lambda: ShootingEnv(made())] * 3, autoreset_mode=mode)
    ours = ShootingVectorEnv(3, made())
    for env in (theirs, ours):
        env.reset(seed=6)
    for asked in actions(2 * LENGTH, 3):
        expected, found = theirs.step(asked)[4], ours.step(asked)[4]
        assert same(expected, found)


def same(expected: object, found: object) -> bool:
    if isinstance(expected, dict):
        assert set(expected) == set(found)
        return all(same(expected[name], found[name]) for name in expected)
    expected, found = (np.stack(each) if each.dtype == object else each for each in (expected, found))
    assert expected.dtype == found.dtype
    return np.allclose(expected, found, rtol=1e-3, atol=1e-3)


def test_environments_differ_and_seeds_repeat() -> None:
    vector = ShootingVectorEnv(3, made())
    first, again, shifted = (vector.reset(seed=seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert len({each.tobytes() for each in first}) == 3
    assert np.array_equal(first[1:], shifted[:-1])
    assert np.array_equal(vector.reset(seed=[3, 2, 1])[0][2], first[0])
    assert not np.array_equal(vector.reset()[0], vector.reset()[0])


def test_what_is_handed_out_may_be_written_to() -> None:
    vector, untouched = ShootingVectorEnv(3, made()), ShootingVectorEnv(3, made())
    for each in (vector, untouched):
        each.reset(seed=0)
    given, kept = vector.step(np.zeros((3, 2)))[:4], untouched.step(np.zeros((3, 2)))[:4]
    for array, other in zip(given, kept, strict=True):
        assert array.flags.writeable
        assert np.array_equal(array, other)
        array[:] = 0
    # Nothing of it is the environment's own.
    for array, other in zip(vector.step(np.zeros((3, 2)))[:4], untouched.step(np.zeros((3, 2)))[:4], strict=True):
        assert np.array_equal(array, other)


def test_a_staggered_batch_holds_all_phases() -> None:
    vector = ShootingVectorEnv(3, made(), staggered=True)
    vector.reset(seed=0)
    ended = [vector.step(np.zeros((3, 2)))[3].sum() for _ in range(2 * LENGTH)]
    assert ended == [0, 0, 1] * (2 * LENGTH // 3)


def test_every_engagement_is_drawn_with_its_own_pellets() -> None:
    vector = ShootingVectorEnv(3, made(), render_mode="rgb_array", staggered=True)
    vector.reset(seed=0)
    for _ in range(LENGTH // 2):
        vector.step(np.zeros((3, 2)))
    pictures = vector.render()
    assert len(pictures) == 3
    assert not np.array_equal(*pictures[:2])


def test_an_environment_of_other_plants_may_be_handed_in(build_world: Callable) -> None:
    other = made()._replace(world=build_world(draws=2))
    vector = ShootingVectorEnv(3, other)
    vector.reset(seed=0)
    assert np.isfinite(vector.step(np.zeros((3, 2)))[0]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({"num_envs": 2, "render_mode": "human"}, 'must be "rgb_array" or None'),
    ],
)
def test_what_can_not_be_used_is_named(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ShootingVectorEnv(**options)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"seed": [1]}, "expected 3, got 1"),
        ({"seed": [1, -1, 2]}, "seed must be at least 0, got -1"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"options": {"reset_mask": np.array([True, False])}}, "reset_mask can't be used"),
        ({"options": {"target": "static"}}, "reset knows no options, got target"),
    ],
)
def test_a_reset_that_can_not_be_done_is_refused(given: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ShootingVectorEnv(3, made()).reset(**given)


@pytest.mark.parametrize("actions", [np.zeros(2), np.zeros((1, 2)), np.full((3, 2), np.nan)])
def test_actions_that_are_none_are_refused(actions: np.ndarray) -> None:
    env = ShootingVectorEnv(3, made())
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"finite numbers of shape \(3, 2\)"):
        env.step(actions)

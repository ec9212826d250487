import warnings
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("jax")
gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from archerfish.records.errors import InputError  # noqa: E402
from archerfish.simulation import gymnasium_env, window  # noqa: E402
from archerfish.simulation.assembly import make_environment  # noqa: E402
from archerfish.simulation.gymnasium_env import ShootingEnv  # noqa: E402
from archerfish.simulation.registration import ENVIRONMENTS  # noqa: E402


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gymnasium_env, "has_display", lambda: False)
    monkeypatch.setattr(window, "has_display", lambda: False)


def trajectory(env: gymnasium.Env, seed: int | None, steps: int = 120) -> list[tuple]:
    taken = [env.reset(seed=seed)]
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (steps, 2)).astype(np.float32)
    for action in actions:
        taken.append(env.step(action))
        if taken[-1][3]:
            taken.append(env.reset())
    return taken


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.usefixtures("headless")
def test_gymnasium_has_nothing_to_say_of_a_registered_environment(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(name).unwrapped)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_stable_baselines_has_nothing_to_say_of_a_registered_environment(name: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="Stable-Baselines3 is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(gymnasium.make(name, render_mode="rgb_array").unwrapped, skip_render_check=False)


def test_the_same_seed_gives_the_same_engagements_and_another_gives_others() -> None:
    env = gymnasium.make("archerfish/Shooting-v0").unwrapped
    first, again, other = (trajectory(env, seed) for seed in (3, 3, 4))
    for ours, theirs in zip(first, again, strict=True):
        assert np.array_equal(ours[0], theirs[0])
        assert [*map(str, ours[1:])] == [*map(str, theirs[1:])]
    assert not np.array_equal(first[0][0], other[0][0])


def test_an_engagement_is_truncated_when_its_time_is_up_and_never_terminated() -> None:
    env = gymnasium.make("archerfish/Shooting-v0", decisions=7)
    env.reset(seed=1)
    for _ in range(2):
        ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(7)]
        assert ends == [(False, False)] * 6 + [(False, True)]
        env.reset()


def test_engagements_that_follow_one_another_differ_also_when_the_first_is_given_up() -> None:
    env = ShootingEnv(decisions=3)
    begun = [env.reset(seed=5)[0], env.reset()[0]]
    env.step(np.zeros(2, np.float32))
    begun.append(env.reset()[0])
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
    begun.append(env.reset()[0])
    assert len({each.tobytes() for each in begun}) == 4


def test_reward_and_hit_follow_from_the_miss() -> None:
    env = ShootingEnv(command_limit="box")
    env.reset(seed=2)
    hits = []
    for _ in range(50):
        _, reward, _, _, info = env.step(np.zeros(2, np.float32))
        assert_allclose(reward, -np.linalg.norm(info["miss"]), rtol=1e-5)
        assert info["hit"] == (np.linalg.norm(info["miss"]) <= 0.06)
        hits.append(info["hit"])
    # The gimbal starts far from the target, and zero actions aim at it.
    assert 0 < sum(hits) < 50


def test_one_environment_does_in_numpy_what_the_adapter_does(draws_of: Callable) -> None:
    made = make_environment(command_limit="box", target="dynamic")
    env = ShootingEnv(made)
    observation, _ = env.reset(seed=11)
    normals, uniforms = draws_of(11, made)
    state, expected = made.fresh(normals[0], uniforms[0])
    assert_allclose(observation, expected[0], rtol=1e-4, atol=1e-4)
    for step in range(1, 30):
        action = np.array([0.1, -0.3], np.float32)
        observation, reward, *_, info = env.step(action)
        state, given = made.advance(state, action[None], normals[step])
        assert_allclose(observation, given.observation[0], rtol=1e-3, atol=1e-3)
        assert_allclose([reward, *info["miss"]], [given.reward[0], *given.miss[0]], rtol=1e-3, atol=1e-4)


def test_actions_beyond_the_space_are_clipped() -> None:
    env = ShootingEnv(command_limit="box", action_bound=2.0)
    taken = []
    for size in (2.0, 50.0):
        env.reset(seed=1)
        taken.append(env.step(np.full(2, size))[0])
    assert np.array_equal(*taken)
    assert env.action_space.high.tolist() == [2.0, 2.0]


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(3), r"shape \(2,\), pitch and yaw, got shape \(3,\)"),
        (0.0, r"got shape \(\)"),
        ([0.0, np.nan], "not finite"),
        ([np.inf, 0.0], "not finite"),
    ],
)
def test_an_action_that_is_none_is_refused_and_costs_nothing(action: object, message: str) -> None:
    env, untouched = ShootingEnv(), ShootingEnv()
    for each in (env, untouched):
        each.reset(seed=3)
    with pytest.raises(InputError, match=message):
        env.step(action)
    assert np.array_equal(env.step(np.zeros(2))[0], untouched.step(np.zeros(2))[0])


def test_a_reset_knows_seeds_from_0_and_no_options() -> None:
    with pytest.raises(InputError, match="seed must be at least 0, got -1"):
        ShootingEnv().reset(seed=-1)
    with pytest.raises(InputError, match="reset knows no options, got target"):
        ShootingEnv().reset(options={"target": "static"})


def test_a_picture_shows_the_engagement() -> None:
    env = gymnasium.make("archerfish/Shooting-v0", render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(np.zeros(2, np.float32))
    after = env.render()
    assert before.shape == after.shape
    assert before.dtype == np.uint8
    assert not np.array_equal(before, after)


@pytest.mark.usefixtures("headless")
def test_without_a_display_the_error_says_what_to_take_instead() -> None:
    with pytest.raises(InputError, match='needs a display, and there is none; take render_mode="rgb_array"'):
        gymnasium.make("archerfish/Shooting-v0", render_mode="human")


def test_a_window_shows_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []

    class Recorder:
        def __init__(self, title: str) -> None: ...

        def show(self, picture: np.ndarray) -> None:
            shown.append(picture)

        def close(self) -> None:
            shown.append(None)

    monkeypatch.setattr(gymnasium_env, "Window", Recorder)
    env = ShootingEnv(render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    env.close()
    assert len(shown) == 3
    assert shown[-1] is None


def test_stepping_before_the_beginning_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded):
        ShootingEnv().step(np.zeros(2, np.float32))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target": "flying"}, "target must be one of paper, static, dynamic, any, still, parabola, .*, got 'flying'"),
        ({"observation": "tracked"}, "needs a sensing record"),
        ({"decisions": 0}, "decisions must be at least 1, got 0"),
        ({"action_bound": 0.0}, "action_bound must be finite and > 0"),
        ({"render_mode": "ansi"}, "render_mode must be one of human, rgb_array, got 'ansi'"),
        ({"plant": "nowhere"}, "nowhere/pitch.json"),
    ],
)
def test_what_can_not_be_used_is_named(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ShootingEnv(**options)


def test_an_environment_and_options_to_make_one_are_refused() -> None:
    with pytest.raises(InputError, match="an environment is given, so target can't be"):
        ShootingEnv(make_environment(), target="static")


def test_targets_whose_motion_is_drawn_are_met_for_one_second_or_three() -> None:
    env = ShootingEnv(target="pass", observation="multimodel")
    lengths = set()
    for seed in range(8):
        observation, _ = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        steps, ended = 0, False
        while not ended:
            observation, _, terminated, ended, _ = env.step(np.zeros(2, np.float32))
            assert not terminated
            steps += 1
        lengths.add(steps)
    assert lengths == {50, 150}
    with pytest.raises(InputError, match=r"motion takes the place of eq \(7\), by which target 'pass' does not move"):
        make_environment(target="pass", motion="./mine.py:Away")

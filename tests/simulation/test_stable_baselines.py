import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("jax")
pytest.importorskip("gymnasium")

from archerfish.records.errors import InputError
from archerfish.simulation.assembly import make_environment
from archerfish.simulation.vector_env import ShootingVectorEnv

LENGTH = 5


@pytest.fixture
def both() -> tuple:
    pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    from archerfish.simulation.stable_baselines import ShootingVecEnv

    made = make_environment(decisions=LENGTH, command_limit="box")
    return ShootingVecEnv(3, environment=made, staggered=True), ShootingVectorEnv(3, made, staggered=True)


def test_ends_are_told_as_stable_baselines_wants_them(both: tuple) -> None:
    ours, plain = both
    ours.seed(4)
    assert_allclose(ours.reset(), plain.reset(seed=4)[0])
    for _ in range(2 * LENGTH):
        actions = np.random.default_rng(1).uniform(-1, 1, (3, 2)).astype(np.float32)
        observation, reward, done, infos = ours.step(actions)
        expected, own, _, truncated, told = plain.step(actions)
        assert_allclose(observation, expected)
        assert_allclose(reward, own)
        assert np.array_equal(done, truncated)
        for member, info in enumerate(infos):
            assert info["TimeLimit.truncated"] is bool(truncated[member])
            assert info["hit"] is bool(np.hypot(*info["miss"]) <= 0.06)
            assert ("terminal_observation" in info) == truncated[member]
            if truncated[member]:
                assert_allclose(info["terminal_observation"], told["final_obs"][member])


def test_films_have_the_rate_of_the_decisions_and_options_are_refused(both: tuple) -> None:
    assert both[0].metadata["render_fps"] == 50
    both[0].set_options({"target": "static"})
    with pytest.raises(InputError, match="reset knows no options"):
        both[0].reset()


def test_stable_baselines_trains_in_it(both: tuple) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    model = PPO("MlpPolicy", VecMonitor(both[0]), n_steps=2 * LENGTH, batch_size=15, n_epochs=1, device="cpu", seed=0)
    model.learn(4 * LENGTH * 3)
    assert model.ep_info_buffer[-1]["l"] == LENGTH


def test_without_the_package_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    monkeypatch.delitem(sys.modules, "archerfish.simulation.stable_baselines", raising=False)
    with pytest.raises(InputError, match="pip install stable-baselines3"):
        import archerfish.simulation.stable_baselines  # noqa: F401

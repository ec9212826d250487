"""A bad number ends a training within its iteration, is named, and leaves the learner of before."""

from collections.abc import Iterator
from importlib import util
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from archerfish.learning.checkpoint import read_checkpoint, write_checkpoint
from archerfish.learning.config import PpoConfig
from archerfish.learning.guard import WATCHED, rollout_fault
from archerfish.learning.ppo import make_learner
from archerfish.learning.training import (
    CHUNK,
    PPO,
    Course,
    DivergenceError,
    Standing,
    Trainer,
    train,
    trained_policy,
    weights_hash,
)
from archerfish.simulation.environment import ShootingEnvironment

_spec = util.spec_from_file_location("faults", Path(__file__).with_name("faults.py"))
assert _spec is not None
assert _spec.loader is not None
faults = util.module_from_spec(_spec)
_spec.loader.exec_module(faults)

STEPS = 4
"""Of a rollout in the tiny training."""
UPDATES = 4
"""Gradient steps in an iteration of it: two epochs of two minibatches."""


@pytest.fixture
def clean_caches() -> Iterator[None]:
    yield
    jax.clear_caches()


def diverged(environment: Any, config: PpoConfig, trainer: Trainer = PPO) -> DivergenceError:
    with pytest.raises(DivergenceError) as caught:
        train(environment, config, seed=0, trainer=trainer)
    return caught.value


# The fault strikes in iteration 6 of 8: inside the second compiled call, which has iterations before and after it.
CASES = [
    ("observation", {"observation": 5 * STEPS + 1}, "observation"),
    # What follows the last decision belongs to the next rollout, but the learner would keep it.
    ("last observation", {"observation": 6 * STEPS - 1}, "observation"),
    ("reward", {"reward": 5 * STEPS + 2}, "reward"),
    ("exploding reward", {"reward": 5 * STEPS + 2, "value": 1e30}, "reward"),
    ("infinite observation", {"observation": 5 * STEPS + 1, "value": np.inf}, "observation"),
]


@pytest.mark.parametrize(("options", "first"), [each[1:] for each in CASES], ids=[each[0] for each in CASES])
def test_a_bad_number_of_the_environment_stops_within_its_iteration(
    shooting: ShootingEnvironment, tiny: PpoConfig, options: dict[str, Any], first: str
) -> None:
    error = diverged(faults.faulty(shooting, **options), tiny)
    assert (error.iteration, error.first) == (6, first)
    assert "in iteration 6" in str(error)
    # No learning rate mends a plant, a record or a motion.
    assert "look at the plants" in str(error)
    assert "learning rates" not in str(error)
    assert_good(error.standing, shooting, 5)


@pytest.mark.parametrize("first", ["gradient", "log_std", "weights"])
def test_a_bad_update_stops_within_its_iteration(
    shooting: ShootingEnvironment,
    tiny: PpoConfig,
    first: str,
    monkeypatch: pytest.MonkeyPatch,
    clean_caches: None,
) -> None:
    # In the second of an iteration's gradient steps: those after it see NaN everywhere.
    faults.spoil_updates(monkeypatch, first, after=5 * UPDATES + 1)
    error = diverged(shooting, tiny)
    assert (error.iteration, error.first) == (6, first)
    assert str(error).endswith("lower the learning rates")
    assert_good(error.standing, shooting, 5)


def assert_good(standing: Standing, environment: ShootingEnvironment, iterations: int) -> None:
    assert standing.iterations == iterations
    assert int(standing.learner.iteration) == iterations
    plain = standing.learner._replace(key=jax.random.key_data(standing.learner.key))
    assert all(np.all(np.isfinite(each)) for each in jax.tree.leaves(plain) if each.dtype.kind == "f")
    policy = trained_policy(environment.observer, standing.learner)
    assert all(np.all(np.isfinite(each)) for each in jax.tree.leaves(policy))


def test_the_learner_of_before_is_the_one_that_an_untroubled_training_has_there(
    shooting: ShootingEnvironment, tiny: PpoConfig
) -> None:
    error = diverged(faults.faulty(shooting, reward=4 * STEPS), tiny)
    heard: list[Standing] = []
    train(faults.faulty(shooting), tiny, seed=0, course=Course(watch=heard.append))
    assert error.iteration == CHUNK + 1
    assert weights_hash(error.standing.learner) == weights_hash(heard[0].learner)


def test_a_checkpoint_of_before_reproduces_the_fault(
    tmp_path: Path, shooting: ShootingEnvironment, tiny: PpoConfig
) -> None:
    environment = faults.faulty(shooting, observation=5 * STEPS + 1)
    error = diverged(environment, tiny)
    write_checkpoint(tmp_path / "checkpoint.json", error.standing.learner, {})
    learner, _ = read_checkpoint(tmp_path / "checkpoint.json", make_learner(environment, tiny, jax.random.key(1)))
    again, metrics = PPO.advance(environment, tiny, learner, CHUNK)
    assert [WATCHED[code - 1] for code in metrics.fault] == ["observation"] * CHUNK
    assert weights_hash(again) == weights_hash(learner)


def test_a_trainer_without_a_guard_is_taken_back_to_before_the_call(
    shooting: ShootingEnvironment, tiny: PpoConfig
) -> None:
    def advance(environment: Any, config: Any, learner: Any, count: int) -> Any:
        advanced, metrics = PPO.advance(environment, config, learner, count)
        if int(learner.iteration) >= CHUNK:
            spoilt = jax.tree.map(lambda each: each * jnp.nan, advanced.networks.actor)
            advanced = advanced._replace(networks=advanced.networks._replace(actor=spoilt))
        return advanced, metrics

    error = diverged(shooting, tiny, Trainer(PPO.begin, advance))
    assert_good(error.standing, shooting, CHUNK)


def test_a_training_goes_on_from_a_standing_to_the_same_weights(shooting: ShootingEnvironment, tiny: PpoConfig) -> None:
    heard: list[Standing] = []
    whole = train(shooting, tiny, seed=0, course=Course(watch=heard.append))
    resumed = train(shooting, tiny, seed=0, course=Course(resume=lambda _: heard[0]))
    assert weights_hash(resumed.learner) == weights_hash(whole.learner)
    for ours, theirs in zip(resumed.curve.metrics, whole.curve.metrics, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    stopped = train(shooting, tiny, seed=0, course=Course(enough=lambda standing: standing.iterations == CHUNK))
    assert weights_hash(stopped.learner) == weights_hash(heard[0].learner)


@pytest.mark.parametrize(
    ("place", "first"),
    [
        (("observation", 1), "observation"),
        (("action", 1), "action"),
        (("reward", 0), "reward"),
        (("final", 0), "observation"),
    ],
)
def test_the_first_bad_array_of_a_rollout_is_named(place: tuple[str, int], first: str) -> None:
    arrays = {
        "observation": np.zeros((3, 2, 4), np.float32),
        "action": np.zeros((3, 2, 2), np.float32),
        "reward": np.zeros((3, 2), np.float32),
        "final": np.zeros((3, 2, 4), np.float32),
        "following": np.zeros((2, 4), np.float32),
    }
    assert int(rollout_fault(**arrays)) == 0
    # From then on everything is bad.
    name, step = place
    arrays[name][step, 1] = np.nan
    for each in ("observation", "action", "reward"):
        if name != "final":
            arrays[each][step + 1 :] = np.nan
    assert WATCHED[int(rollout_fault(**arrays)) - 1] == first

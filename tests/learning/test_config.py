import math
from typing import Any

import pytest

from archerfish.learning.config import PpoConfig
from archerfish.records.errors import InputError


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, 0) for name in ("steps", "environments", "rollout", "minibatches", "epochs", "shards", "hidden")),
        *((name, 0.0) for name in ("actor_learning_rate", "critic_learning_rate", "clip", "gradient_norm")),
        ("actor_learning_rate", math.nan),
        ("critic_learning_rate", math.inf),
        ("clip", -0.2),
        ("discount", 1.1),
        ("discount", math.nan),
        ("trace", -0.1),
        ("entropy", -1e-3),
        ("log_std", -5.0),
        ("log_std", math.nan),
        ("log_std_floor", -math.inf),
        ("log_std_floor", -20.1),
        ("log_std", 20.1),
        ("minibatches", 7),
        ("environments", 511),
        ("minibatches", 12800),
        ("rollout", 2049),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"\b{name}\b"):
        PpoConfig(**{name: value})


def test_the_paper_s_settings_are_the_default() -> None:
    config = PpoConfig()
    found = (config.hidden, config.actor_learning_rate, config.critic_learning_rate, config.clip)
    assert found == (256, 1e-3, 3e-3, 0.2)


@pytest.mark.parametrize(("steps", "iterations"), [(1, 1), (100, 1), (1000, 10), (1049, 10)])
def test_iterations_are_the_steps_in_whole_batches(steps: int, iterations: int) -> None:
    assert PpoConfig(steps=steps, environments=10, rollout=10, minibatches=5).iterations == iterations

import math
from typing import Any

import pytest

from archerfish.learning.gradient_config import GradientConfig
from archerfish.records.errors import InputError

NORMS = ("learning_rate", "gradient_norm", "engagement_norm")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, 0) for name in ("steps", "environments", "window", "hidden")),
        *((name, value) for name in NORMS for value in (0.0, -1.0, math.nan, math.inf)),
    ],
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"^{name} must be"):
        GradientConfig(**{name: value})


@pytest.mark.parametrize(("steps", "iterations"), [(1, 1), (100, 1), (1000, 10), (1049, 10)])
def test_iterations_are_the_steps_in_whole_windows(steps: int, iterations: int) -> None:
    assert GradientConfig(steps=steps, environments=10, window=10).iterations == iterations

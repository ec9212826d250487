from collections.abc import Callable, Sequence
from typing import Any

import pytest

from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.learning.config import PpoConfig
from archerfish.learning.gradient_config import GradientConfig


@pytest.fixture
def make_plan() -> Callable[..., Any]:
    """Return a plan for some seeds in some worlds, scored by four engagements."""

    pytest.importorskip("jax")
    from archerfish.cli.sweeping.parameters import Base
    from archerfish.cli.sweeping.run import Plan

    def make(seeds: Sequence[int] = (0, 1), worlds: Sequence[dict[str, Any]] = ({},)) -> Any:
        base = Base(
            load_setting(SettingFiles()),
            "paper",
            "history",
            4,
            "gate",
            "ppo",
            PpoConfig(steps=100),
            GradientConfig(steps=100),
        )
        return Plan(base, tuple(worlds), tuple(seeds), 4, 0, {})

    return make

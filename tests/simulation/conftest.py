from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.simulation.setting import make_world, paper_muzzle
from archerfish.simulation.shooting import ShootingWorld


@pytest.fixture(scope="session")
def build_world() -> Callable[..., ShootingWorld]:
    """Build the paper's world, with any number of posterior draws of its plants and any noise."""
    conditions = assumed_conditions()

    def build(command_limit: str = "box", draws: int = 0, noise: tuple[float, float] = (0.0, 0.0)) -> ShootingWorld:
        plants = printed_plants()
        if draws:
            # Draw i answers a command i + 1 times as strongly.
            gains = np.arange(1, draws + 1)[:, None, None]
            for axis, plant in plants.items():
                several = {name: np.repeat(getattr(plant, name)[None], draws, axis=0) for name in "ABCD"}
                plants[axis] = replace(plant, draws=several | {"B": gains * plant.B})
        return make_world(
            plants["pitch"], plants["yaw"], paper_muzzle(conditions), gate_limits(), command_limit, conditions, noise
        )

    return build

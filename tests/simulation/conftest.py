from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.simulation.environment import ShootingEnvironment
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


@pytest.fixture(scope="session")
def draws_of() -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Return the numbers of one environment's first steps, drawn as its seed says but in JAX's own words."""

    def draw(seed: int, environment: ShootingEnvironment) -> tuple[np.ndarray, np.ndarray]:
        import jax

        words = np.random.SeedSequence(seed).generate_state(2)
        key = jax.random.fold_in(jax.random.wrap_key_data(words, impl="threefry2x32"), 0)
        first, second = jax.random.split(key)
        normals = jax.random.normal(first, (64, environment.normals))
        uniforms = jax.random.uniform(second, (64, environment.uniforms))
        return np.asarray(normals)[:, None], np.asarray(uniforms)[:, None]

    return draw

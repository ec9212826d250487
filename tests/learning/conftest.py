"""A training that is tiny but real: the shooting environment at sizes that compile and run in seconds."""

import jax
import numpy as np
import pytest

from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.learning.config import PpoConfig
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.sensing.observation import make_observer
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.setting import make_scenario, make_world, paper_muzzle


def build_environment(command_limit: str = "box") -> ShootingEnvironment:
    conditions = assumed_conditions()
    record = paper_muzzle(conditions)
    world = make_world(
        **printed_plants(), muzzle=record, limits=gate_limits(), command_limit=command_limit, conditions=conditions
    )
    observer = single_precision(make_observer("history", muzzle_from_record(record), frames=2))
    environment = ShootingEnvironment(
        world, make_scenario(conditions, static_share=0.5), observer, np.asarray(5, np.int32)
    )
    return jax.tree.map(jax.numpy.asarray, environment)


@pytest.fixture(scope="session")
def shooting() -> ShootingEnvironment:
    return build_environment()


@pytest.fixture(scope="session")
def shooting_under_gate() -> ShootingEnvironment:
    return build_environment("gate")


@pytest.fixture(scope="session")
def tiny() -> PpoConfig:
    """Eight iterations: two compiled calls of `train`."""
    return PpoConfig(steps=8 * 8 * 4, environments=8, rollout=4, minibatches=2, epochs=2, hidden=8)

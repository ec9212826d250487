"""A paper's world and that of a robot with late commands and noisy sights, with a few engagements each."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import pytest

from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.simulation.environment import PureWorld
from archerfish.simulation.setting import make_world, paper_muzzle

CONDITIONS = assumed_conditions()
CAMERA = CameraRecord(
    rate_hz=80.0,
    time_offset=0.0,
    stamp_jitter=3e-4,
    bearing_sd=1.2e-3,
    elevation_sd=1.2e-3,
    range_sd=0.06,
    noise_range=4.0,
    miss_probability=0.02,
    outlier_share=0.0,
    latency=0.035,
    latency_jitter=0.003,
    latency_basis="exposure",
)
LINK = LinkRecord(feedback_rate_hz=1000.0, command_latency=0.012, command_latency_jitter=0.003, feedback_latency=0.002)


class Shooting(NamedTuple):
    """A world and trials of the eight cells."""

    world: PureWorld
    trials: Trials


@pytest.fixture(scope="session")
def shooting() -> Callable[..., Shooting]:
    """Build a world and draw engagements."""

    def build(limit: str = "gate", engagements: int = 2, *, robot: bool = False, seed: int = 0) -> Shooting:
        muzzle = replace(paper_muzzle(CONDITIONS), length=0.16, pitch_offset=1e-3, yaw_offset=-1e-3)
        world = make_world(
            **printed_plants(),
            muzzle=muzzle if robot else paper_muzzle(CONDITIONS),
            limits=gate_limits(),
            command_limit=limit,
            conditions=CONDITIONS,
            sensing=SensingRecord(CAMERA, LINK) if robot else None,
        )
        suites = table_suites(CONDITIONS)
        return Shooting(world, draw_trials(suites, engagements, CONDITIONS.decisions, seed, normals=world.normals))

    return build

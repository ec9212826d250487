from typing import Any

import numpy as np
import pytest

from archerfish2.paper.gimbal import printed_plants
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.robot import PartVerdict, Robot

NOISE = ("time_offset", "stamp_jitter", "bearing_sd", "elevation_sd", "range_sd", "miss_probability", "outlier_share")


@pytest.fixture(scope="session")
def robot() -> Robot:
    """A robot that has everything: draws with delays of their own, sensing, verdicts."""
    plants: Any = printed_plants()
    for axis, plant in plants.items():
        draws = {name: np.repeat(getattr(plant, name)[None], 3, axis=0) for name in "ABCD"}
        plants[axis] = plant.replace(draws=draws, draw_delays=np.arange(3))
    camera = CameraRecord(rate_hz=60.0, noise_range=3.0, **dict.fromkeys(NOISE, 0.1))
    sensing = SensingRecord(camera=camera, link=LinkRecord(feedback_rate_hz=500.0, command_latency=0.01))
    parts = {"pitch": PartVerdict(usable=True, headline="fits"), "yaw": PartVerdict(usable=False, headline="drifts")}
    paper = Robot.paper()
    muzzle = paper.muzzle.replace(intervals={"speed": (17.9, 18.1)})
    return paper.replace(name="mine", **plants, muzzle=muzzle, sensing=sensing, assumed=("muzzle",), parts=parts)

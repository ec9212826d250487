"""Robots and targets to test with."""

import copy
import tomllib
from typing import Any

import numpy as np
import pytest

from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import parse_robot, robot_path
from archerfish.virtual_robot.gimbal_physics import mujoco_installed
from archerfish.virtual_robot.robot import VirtualRobot

PHYSICS = ["linear", pytest.param("mujoco", marks=pytest.mark.skipif(not mujoco_installed(), reason="needs MuJoCo 4"))]


class Resting:
    """A plate that never moves."""

    def __init__(self, batch: int, place: tuple[float, float, float] = (3.0, 0.3, 0.0)) -> None:
        self.place = np.tile(np.array(place), (batch, 1))

    def position(self, time: np.ndarray) -> np.ndarray:
        assert time.shape == (len(self.place),)
        return self.place


def content_of(name: str) -> dict[str, Any]:
    """Return the tables of a robot that comes with the package."""
    return tomllib.loads(robot_path(name).read_text())


def changed(**values: float | str) -> RobotDescription:
    """Return the infantry robot with other values, named as gimbal__yaw__friction_n_m."""
    content = copy.deepcopy(content_of("infantry"))
    for path, value in values.items():
        *tables, key = path.split("__")
        table = content
        for each in tables:
            table = table[each]
        assert key in table
        table[key] = value
    return parse_robot(content, "changed")


QUIET = {
    "firmware__pitch__gyro_noise_rad_per_s": 0.0,
    "firmware__yaw__gyro_noise_rad_per_s": 0.0,
    "camera__lateral_sd_mm": 0.0,
    "camera__range_sd_percent": 0.0,
    "camera__miss_probability": 0.0,
    "camera__stamp_jitter_ms": 0.0,
}
"""A robot without noise."""


def resting_robot(description: RobotDescription, batch: int, physics: str, **options: Any) -> VirtualRobot:
    """Return robots that have just been reset at zero angles."""
    robot = VirtualRobot(description, batch, np.arange(batch), physics=physics, **options)
    robot.reset(np.zeros((batch, 2)), Resting(batch))
    return robot

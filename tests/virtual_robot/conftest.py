import pytest

from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import load_robot

from .made_robots import PHYSICS


@pytest.fixture(params=PHYSICS)
def physics(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="session")
def infantry() -> RobotDescription:
    return load_robot("infantry")

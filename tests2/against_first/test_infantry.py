"""The robot in tests2/infantry, number for number as the first edition identified it."""

from dataclasses import asdict
from pathlib import Path

import pytest
from numpy.testing import assert_equal

pytestmark = pytest.mark.against_first
pytest.importorskip("archerfish.records.plant")

from archerfish.records.limits import read_limits  # noqa: E402
from archerfish.records.muzzle import read_muzzle  # noqa: E402
from archerfish.records.plant import read_plant  # noqa: E402
from archerfish.records.sensing import read_sensing  # noqa: E402
from archerfish2.records.json_files import plain  # noqa: E402
from archerfish2.robot import RECORDS, Robot  # noqa: E402

READ = {"pitch": read_plant, "yaw": read_plant, "muzzle": read_muzzle, "sensing": read_sensing, "limits": read_limits}


@pytest.mark.parametrize("part", RECORDS)
def test_every_number_is_that_of_the_first_edition(reference, part) -> None:
    robot = Robot.load(Path(__file__).parents[1] / "infantry")
    expected = asdict(READ[part](reference / "infantry" / f"{part}.json"))
    quality = expected.pop("quality", None)
    assert quality is None or quality["usable"]
    assert_equal(plain(getattr(robot, part)), expected)
    assert len(robot.pitch.draws["A"]) == len(robot.yaw.draws["A"]) == 100
    assert (robot.name, robot.assumed, robot.parts) == ("infantry", (), {})

from pathlib import Path

import pytest

from archerfish2.robot import PartVerdict, Robot


@pytest.fixture(scope="session")
def robot():
    """A robot that has everything: draws with delays of their own, sensing, verdicts, something assumed."""
    found = Robot.load(Path(__file__).parents[1] / "infantry")
    plants = {"pitch": found.pitch, "yaw": found.yaw}
    for axis, each in plants.items():
        draws = {name: matrices[:3] for name, matrices in each.draws.items()}
        plants[axis] = each.replace(draws=draws, draw_delays=each.draw_delays[:3])
    parts = {"pitch": PartVerdict(usable=True, headline="fits"), "yaw": PartVerdict(usable=False, headline="drifts")}
    return found.replace(name="mine", **plants).replace(assumed=("muzzle",), parts=parts)

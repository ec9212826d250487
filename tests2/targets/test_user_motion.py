"""A user's motion: found and checked once, also of several plates."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.evaluation.suites import draw
from archerfish2.targets.user_motion import find_motion
from archerfish2.task import Task

CODE = """import numpy as np
from typing import Any, NamedTuple
import archerfish2.targets.motion as m
class One(NamedTuple):
    place: Any
    speed: Any
    def position(self, time): return self.place + (self.speed * time)[..., None]
class Pair(One):
    plates = 2
    def at(self, time):
        both, xp = m.disc(self, self.place).at(time), m.namespace(time)
        return m.Plates(*(xp.repeat(each, 2, axis=time.ndim) for each in both))
class Flat(One): position = lambda self, time: time[..., None]
class Sudden(One): position = lambda self, time: 0.0 * time[..., None] if time.max() > 0.0 else self.place
def mine(place, speed, uniforms): return """
FAULTS = {
    "Flat(place, speed)": r"Flat has positions of shape \(2, 5, 1, 1\) at times \(2, 5\), expected \(2, 5, 1, 3\)",
    "Sudden(place, speed)": "mine.py:mine: line 14: TracerBoolConversionError",
    "One(np.zeros(3), speed)": r"returns a One, expected a NamedTuple with position\(time\), each array as long as",
    "One(place, speed - 20.0)": "m after 0.08 s, expected numbers and x > 0; keep it before the gimbal",
}


@pytest.fixture
def mine(tmp_path, request):
    (tmp_path / "mine.py").write_text(CODE + request.param)
    return f"{tmp_path / 'mine.py'}:mine"


@pytest.mark.parametrize("mine", ["One(place, speed)", "Pair(place, speed)"], indirect=True)
def test_it_is_checked_once_and_moves_as_it_says(mine):
    found, cells = find_motion(mine), Task.load(mine).cells()
    assert find_motion(mine) is cells[4].scenario.motion is found
    target = draw(cells[4:5], 4, 0)[0].target
    one = getattr(target.target, "motion", target.target)
    position = target.at(np.full((3, 4), 0.7, np.float32)).position
    assert position.shape == (3, 4, target.plates, 3)
    assert_allclose(position, position * 0.0 + (one.place + 0.7 * one.speed[:, None])[:, None], atol=1e-6)


@pytest.mark.parametrize(("mine", "problem"), FAULTS.items(), indirect=["mine"])
def test_what_is_no_motion_is_refused(mine, problem, refused):
    pytest.importorskip("jax")
    refused(problem, lambda: Task.load(mine).scenario())

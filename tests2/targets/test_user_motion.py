"""A user's motion: found, checked once, and drawn beside targets that stand still."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.errors import InputError
from archerfish2.evaluation.suites import draw
from archerfish2.targets.user_motion import find_motion
from archerfish2.task import Task

CODE = """
import numpy as np
from typing import Any, NamedTuple
import archerfish2.targets.motion as m
calls = []
class One(NamedTuple):
    place: Any
    speed: Any
    def position(self, time): return self.place + (self.speed * time)[..., None]
class Pair(One):
    plates = 2
    def at(self, time):
        both = (m.namespace(time).repeat(each, 2, axis=time.ndim) for each in m.disc(self, self.place).at(time))
        return m.Plates(*both)
class Flat(One): position = lambda self, time: time[..., None]
class Sudden(One): position = lambda self, time: 0.0 * time[..., None] if time.max() > 0.0 else self.place
def mine(place, speed, uniforms): return calls.append(1) or """
FAULTS = {
    "Flat(place, speed)": "Flat has positions of shape (2, 5, 1, 1) at times (2, 5), expected (2, 5, 1, 3)",
    "Sudden(place, speed)": "mine.py:mine: line 16: TracerBoolConversionError",
    "One(np.zeros(3), speed)": "returns a One, expected a NamedTuple with position(time), each array as long as",
    "One(place, speed - 20.0)": "m after 0.08 s, expected numbers and x > 0; keep it before the gimbal",
}


@pytest.fixture
def mine(tmp_path, request) -> str:
    (tmp_path / "mine.py").write_text(CODE + request.param)
    return f"{tmp_path / 'mine.py'}:mine"


@pytest.mark.parametrize("mine", ["One(place, speed)", "Pair(place, speed)"], indirect=True)
def test_it_is_checked_once_and_still_targets_are_the_papers(mine) -> None:
    found = find_motion(mine)
    cells = Task.load(mine).cells()
    assert find_motion(mine) is cells[4].scenario.motion is found
    assert len(found.value.__globals__["calls"]) == 3  # in NumPy twice, traced once
    assert [each[:2] for each in cells[3:5]] == [("II", "static"), (None, "mine")]
    (ours, noise), (theirs, same) = draw(cells, 4, 0), draw(Task.load("paper").cells(), 4, 0)
    assert_array_equal(noise, same)
    position, expected = (each.target.at(np.full((3, 32), 0.7, np.float32)).position for each in (ours, theirs))
    assert_array_equal(position[:, :16], expected[:, :16] + np.zeros((ours.target.plates, 1), np.float32))
    moved = position[0, 16:, 0, 0] - ours.target.place[16:, 0]
    assert_allclose(moved, 0.7 * theirs.target.motion.speed[16:], atol=1e-6)


@pytest.mark.parametrize(("mine", "problem"), FAULTS.items(), indirect=["mine"])
def test_what_is_no_motion_is_refused_in_one_line(mine, problem) -> None:
    pytest.importorskip("jax")
    with pytest.raises(InputError) as error:
        Task.load(mine).scenario()
    assert problem in str(error.value).partition("\n")[0]

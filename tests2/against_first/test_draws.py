"""Engagements and normals of all cells, number for number as in the first edition."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

pytestmark = pytest.mark.against_first
pytest.importorskip("archerfish.evaluation.suites")

from archerfish.evaluation import suites as first  # noqa: E402
from archerfish.paper.conditions import assumed_conditions  # noqa: E402
from archerfish.simulation.scenario import LONG_S, SHORT, draw_engagement, engagement_length  # noqa: E402
from archerfish.simulation.setting import make_scenario  # noqa: E402
from archerfish.targets.drawn import drawn_motion  # noqa: E402
from archerfish.targets.own_motion import find_motion  # noqa: E402
from archerfish2.evaluation.draws import draw  # noqa: E402
from archerfish2.task import Task  # noqa: E402

CONDITIONS = assumed_conditions()
MOTION = """
from typing import Any, NamedTuple

class Departure(NamedTuple):
    start: Any
    velocity: Any

    def position(self, time):
        return self.start + self.velocity * time[..., None]

def draw(place, speed, uniforms):
    return Departure(place, 0.0 * place + speed[..., None] * (0.5 + uniforms[..., :1]))
"""


def first_motion(folder: Path) -> str:
    path = folder / "mine.py"
    path.write_text(MOTION)
    return f"{path}:draw"


def compare(task: Task, suites, length: float, purpose: str, plants: int, normals: int) -> None:
    cells = [each for each in task.cells() if each.length_s == length]
    assert [each.range_m for each in cells] == [each.range_m for each in suites]
    decisions = round(length / CONDITIONS.control_period_s)
    assert {each.decisions for each in cells} == {decisions}
    engagement, noise = draw(cells, 64, 3, purpose, normals, plants)
    expected = first.draw_trials(suites, 64, decisions, 3, purpose, normals)
    assert_array_equal(noise, expected.draws)
    assert_array_equal(engagement.start, expected.engagements.start)
    assert_array_equal(engagement.plant, expected.engagements.plant)
    assert_array_equal(engagement.duration, np.full(len(noise), length, np.float32))
    times = np.random.default_rng(4).uniform(-0.3, length, len(noise)).astype(np.float32)
    assert_array_equal(engagement.target.at(times).position[:, 0], expected.engagements.motion.position(times))


@pytest.mark.parametrize("purpose", ["evaluation", "tuning"])
def test_the_eight_cells_of_the_paper(purpose) -> None:
    compare(Task.load("paper"), first.table_suites(CONDITIONS, 30), 1.0, purpose, 30, 11)


@pytest.mark.parametrize("length", [1.0, 3.0])
@pytest.mark.parametrize("name", ["any", "kinds", "pass", "singer"])
def test_the_cells_of_motions(name, length) -> None:
    names = {} if name in ("any", "kinds") else {"names": (name,)}
    compare(Task.load(name), first.motion_suites(CONDITIONS, length, 1, **names), length, "evaluation", 1, 6)


def test_cells_of_a_users_motion(tmp_path) -> None:
    spec = first_motion(tmp_path)
    suites = first.table_suites(CONDITIONS, motion=find_motion(spec))
    compare(Task.load(spec), suites[4:], 1.0, "evaluation", 1, 6)  # without those that stand


@pytest.mark.parametrize("name", ["paper", "static", "dynamic", "kinds", "strafe"])
def test_engagements_of_a_training(name) -> None:
    if name in ("paper", "static", "dynamic"):
        share = {"paper": 0.5, "static": 1.0, "dynamic": 0.0}[name]
        expected = make_scenario(CONDITIONS, static_share=share, plants=7)
    else:
        lasting = dataclasses.replace(CONDITIONS, engagement_s=LONG_S)
        expected = make_scenario(lasting, plants=7, motion=drawn_motion({"kinds": "any"}.get(name, name)), short=SHORT)
    scenario = Task.load(name).scenario(7)
    assert scenario.uniforms == expected.uniforms
    uniforms = np.random.default_rng(5).random((64, scenario.uniforms), np.float32)
    ours, theirs = scenario.draw(uniforms), draw_engagement(expected, uniforms)
    assert_array_equal(ours.duration, engagement_length(expected, uniforms))
    assert_array_equal(ours.plant, theirs.plant)
    times = 0.5 * ours.duration
    assert_array_equal(ours.target.at(times).position[:, 0], theirs.motion.position(times))

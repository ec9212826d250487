"""Both editions shoot at the same targets, here and now; tests2/test_outcomes.py has more that was stored."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.against_first
pytest.importorskip("archerfish.evaluation.suites")

from archerfish2.controllers.registry import make_controller  # noqa: E402
from archerfish2.controllers.tuning import Tuning  # noqa: E402
from archerfish2.evaluation.draws import draw  # noqa: E402
from archerfish2.evaluation.run import count, count_perfect_aim  # noqa: E402
from archerfish2.evaluation.tuning import rates, search  # noqa: E402
from archerfish2.records.json_files import read_json  # noqa: E402
from archerfish2.robot import Robot  # noqa: E402
from archerfish2.simulation.world import make_world  # noqa: E402
from archerfish2.task import Task  # noqa: E402

HERE = Path(__file__).parent
PAPER = ("kalman", "kalman-tuned", "kalman-lq", "imm-lq", "parabola-lq", "no-lead", "oracle", "perfect")
CASES = [
    *(("paper", "gate", "paper", 20, each) for each in PAPER),
    ("paper", "los-2deg", "paper", 20, "kalman-lq"),
    *(("infantry", "gate", "paper", 20, each) for each in ("kalman", "kalman-lq", "imm-lq", "no-lead", "oracle")),
    ("infantry", "gate", "paper", 2, "parabola-lq"),  # takes the first edition milliseconds a decision
    ("infantry", "gate", "any", 2, "kalman-lq"),
]
"""Robot, command limit, targets, engagements per cell, controller by its name in the first edition."""


@pytest.fixture(scope="module")
def first(shared):
    """What write_outcomes.py has: the first edition's worlds, controllers and hits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(HERE))
        yield runpy.run_path(str(HERE / "write_outcomes.py"))


def load(name: str) -> Robot:
    return Robot.paper() if name == "paper" else Robot.load(HERE.parent / name)


@pytest.mark.parametrize(("name", "limit", "targets", "engagements", "controller"), CASES)
def test_every_shot_hits_where_it_hits_in_the_first_edition(first, name, limit, targets, engagements, controller):
    settings = first["tunings"](name, limit, targets)
    theirs = replace(first["evaluation"](name, limit, targets, 1.0, engagements), tuning=settings)
    entrant = None if controller == "perfect" else first["classical_entrant"](theirs, controller).controller
    expected = first["hits"](first["make_ground"](theirs), entrant)
    robot, task = load(name), Task.load(targets).replace(command_limit=limit, lengths_s=(1.0,))
    world, tuning = make_world(robot, task), settings.get(controller)
    drawn = draw(task.cells(), engagements, 0, "evaluation", world.normals, world.plants)
    if controller == "perfect":
        hit = count_perfect_aim(world, *drawn).hit
    else:
        ours = first["NAMES"].get(controller, controller) if name == "paper" else controller
        hit = count(world, make_controller(ours, robot, task, tuning and Tuning(**tuning._asdict())), *drawn).hit
    differ = (hit != expected).reshape(len(task.cells()), -1).sum(axis=1)
    assert np.all(differ <= np.ceil(1e-3 * hit.size / len(differ))), differ


@pytest.mark.parametrize("name", ["kalman", "kalman-lq", "imm-lq"])
def test_settings_are_tuned_to_those_of_the_first_edition(name) -> None:
    robot, task = load("infantry"), Task.load("paper")
    expected = read_json(HERE.parent / "outcomes" / "tuning.json")[name]
    rate = rates(name, robot, task)
    found, theirs = search(name, rate), Tuning(**expected["tuning"])
    assert abs(found.hit_rate - expected["hit_rate"]) <= 2e-4
    assert found.tuning == theirs or abs(rate(theirs) - expected["hit_rate"]) <= 2e-4

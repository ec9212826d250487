"""Every shot of the built-in controllers, as in the first edition (tests2/against_first/write_outcomes.py)."""

import base64
import functools
from pathlib import Path

import numpy as np
import pytest

from archerfish2.controllers.registry import make_controller
from archerfish2.controllers.tuning import Tuning
from archerfish2.evaluation import run
from archerfish2.evaluation.draws import draw
from archerfish2.records.json_files import read_json
from archerfish2.robot import Robot
from archerfish2.simulation.world import make_world
from archerfish2.task import Task

HERE = Path(__file__).parent
STORED = {path.stem: read_json(path) for path in sorted((HERE / "outcomes").glob("*.json")) if path.stem != "tuning"}
QUICK = {  # those that compile in `make test`; the others are in `make test-slow`, and live in `make test-first`
    *(("paper-gate", each) for each in STORED["paper-gate"]),
    *(("paper-box", each) for each in ("kalman", "kalman-paper", "perfect")),
    ("infantry", "kalman-lq"),
}
CASES = [
    pytest.param(name, each, marks=[pytest.mark.slow] * ((name, each) not in QUICK))
    for name, stored in STORED.items()
    for each in sorted(stored.keys() - {"setting"})
]


@functools.cache
def engagements(name):
    """Return robot, task, world, and engagements with their normals."""
    setting = STORED[name]["setting"]
    robot = Robot.paper() if setting["robot"] == "paper" else Robot.load(HERE / setting["robot"])
    task = Task.load(setting["task"]).replace(command_limit=setting["command_limit"], lengths_s=[setting["length_s"]])
    world = make_world(robot, task)
    drawn = draw(task.cells(), setting["shape"][1], setting["seed"], "evaluation", world.normals, world.plants)
    return robot, task, world, drawn


@pytest.mark.parametrize(("name", "controller"), CASES)
def test_a_controller_hits_where_it_hit_in_the_first_edition(name, controller, monkeypatch) -> None:
    pytest.importorskip("jax")
    monkeypatch.setattr(run, "LARGEST", 300)  # engagements of several parts
    robot, task, world, drawn = engagements(name)
    if robot.sensing:  # the first edition's trackers took the azimuth's noise for the elevation, too
        camera = robot.sensing.camera.replace(elevation_sd=robot.sensing.camera.bearing_sd)
        robot = robot.replace(sensing=robot.sensing.replace(camera=camera))
    stored, (cells, _, _) = STORED[name][controller], STORED[name]["setting"]["shape"]
    if controller == "perfect":
        hit = run.count_perfect_aim(world, *drawn).hit
    else:
        tuning = stored["tuning"] and Tuning(**stored["tuning"])
        hit = run.count(world, make_controller(controller, robot, task, tuning), *drawn).hit
    expected = np.unpackbits(np.frombuffer(base64.b64decode(stored["hits"]), np.uint8), count=hit.size)
    differ = (hit.ravel() != expected).reshape(cells, -1).sum(axis=1)
    # As many as the first edition differs from itself in batches of another size, twice; or 0.1 %.
    allowed = np.maximum(np.ceil(1e-3 * hit.size / cells), 2 * np.array(stored["differ"]))
    assert np.all(differ <= allowed), f"{differ.tolist()} shots of each cell differ, of {hit.size // cells}"

"""Every shot of the built-in controllers, as version 0.1, another implementation of the same formulas, shot it."""

import base64
import functools
import math
from pathlib import Path

import numpy as np
import pytest

from archerfish.arrays import map_arrays
from archerfish.controllers.registry import make_controller
from archerfish.controllers.tuning import Tuning
from archerfish.evaluation import run
from archerfish.evaluation.draws import draw
from archerfish.records.json_files import read_json
from archerfish.robot import Robot
from archerfish.simulation.world import make_world
from archerfish.task import Task

HERE = Path(__file__).parent
STORED = {path.stem: read_json(path) for path in sorted((HERE / "outcomes").glob("*.json")) if path.stem != "tuning"}
COMPILED = {("paper-gate", "perfect"), ("paper-gate", "kalman-lq"), ("infantry", "kalman-lq")}
"""Those that `make test` compiles; the others are compiled in `make test-slow`, and shoot in NumPy in both."""
PAIRS = [(name, controller) for name, stored in STORED.items() for controller in sorted(stored.keys() - {"setting"})]
CASES = [pytest.param(*pair, marks=[] if pair in COMPILED else [pytest.mark.slow]) for pair in PAIRS]
FEW = 80
"""Engagements of all cells together that shoot in NumPy."""


@functools.cache
def engagements(name):
    """Return robot, task, world, and engagements with their normals."""
    setting = STORED[name]["setting"]
    robot = Robot.paper() if setting["robot"] == "paper" else Robot.load(HERE / setting["robot"])
    task = Task.load(setting["task"]).replace(command_limit=setting["command_limit"], lengths_s=[setting["length_s"]])
    world = make_world(robot, task)
    drawn = draw(task.cells(), setting["shape"][1], setting["seed"], "evaluation", world.normals, world.plants)
    return robot, task, world, drawn


def built(name, controller):
    """Return a controller as it was when the outcomes were stored."""
    robot, task, *_ = engagements(name)
    if robot.sensing:  # version 0.1's trackers took the azimuth's noise for the elevation, too
        camera = robot.sensing.camera.replace(elevation_sd=robot.sensing.camera.bearing_sd)
        robot = robot.replace(sensing=robot.sensing.replace(camera=camera))
    tuning = STORED[name][controller]["tuning"]
    return make_controller(controller, robot, task, tuning and Tuning(**tuning))


def check(name, controller, hit):
    """Compare hits, shape (cells, engagements, decisions), with those of the first engagements of each cell."""
    stored, shape = STORED[name][controller], STORED[name]["setting"]["shape"]
    bits = np.unpackbits(np.frombuffer(base64.b64decode(stored["hits"]), np.uint8), count=math.prod(shape))
    differ = (hit != bits.reshape(shape)[:, : hit.shape[1]]).sum(axis=(1, 2))
    # As many as version 0.1 differs from itself in batches of another size, twice; or 0.1 %.
    allowed = np.maximum(np.ceil(1e-3 * hit[0].size), 2 * np.array(stored["differ"]))
    assert np.all(differ <= allowed), f"{differ.tolist()} shots of each cell differ, of {hit[0].size}"


@pytest.mark.parametrize(("name", "controller"), CASES)
def test_a_compiled_controller_hits_where_it_hit_in_version_0_1(name, controller, monkeypatch) -> None:
    pytest.importorskip("jax")
    monkeypatch.setattr(run, "LARGEST", 300)  # engagements of several parts
    *_, world, drawn = engagements(name)
    if controller == "perfect":
        hit = run.count_perfect_aim(world, *drawn).hit
    else:
        hit = run.count(world, built(name, controller), *drawn).hit
    check(name, controller, hit.reshape(STORED[name]["setting"]["shape"]))


@pytest.mark.parametrize(("name", "controller"), [pair for pair in PAIRS if pair[1] != "perfect"])
def test_a_controller_hits_in_numpy_where_it_hit_in_version_0_1(name, controller) -> None:
    *_, world, (engagement, normals) = engagements(name)
    cells, count, decisions = STORED[name]["setting"]["shape"]
    first = np.ravel(np.arange(cells)[:, None] * count + np.arange(FEW // cells))
    few = map_arrays(lambda values: values[first], engagement)
    *_, shot = run.decisions(world, built(name, controller), few, normals[first], may_compile=False)
    check(name, controller, (shot.fired & (shot.margin >= 0.0)).reshape(cells, -1, decisions))

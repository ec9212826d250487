"""Detections made by hand, and a small simulation without dispersion in which any controller shoots, in NumPy."""

import functools

import numpy as np
import pytest

from archerfish2.arrays import map_arrays
from archerfish2.controllers.registry import make_controller
from archerfish2.protocols import Barrel, Base, Frames, GimbalFeedback, Seen
from archerfish2.robot import Robot
from archerfish2.simulation.world import make_world
from archerfish2.task import Task


@pytest.fixture(scope="session")
def seen():
    """Make what is seen of a plate, B + (3,), by a resting gimbal whose base is at a place and moves at a velocity."""

    def make(place, elapsed=0.02, age=0.04, own=(0.0, 0.0)):
        zero, pair, here = 0.0 * place[..., 0], 0.0 * place[..., :2], place[..., :1] == place[..., :1]
        frames = Frames(here, zero[..., None] + age, here[..., None], place[..., None, None, :], zero[..., None, None])
        base, barrel = Base(*(0.0 * place + each for each in own), zero, zero), Barrel(zero, zero)
        return Seen(zero + elapsed, GimbalFeedback(pair, pair, zero), pair, frames, base, barrel)

    return make


@pytest.fixture(scope="session")
def follow(seen):
    """Return a predictor's estimate against the own pivot after places, (T,) + B + (3,), seen alike."""

    def run(predictor, places, **facts):
        state = predictor.step(predictor.reset(seen(places[0], **facts)), seen(places[0], elapsed=0.0, **facts))
        for place in places[1:]:
            state = predictor.step(state, seen(place, **facts))
        return predictor.against_pivot(state, seen(places[-1], **facts).base)

    return run


@pytest.fixture(scope="session")
def shoot():
    """Let a controller shoot at four targets: (seen, command, shot), arrays (T, 4, ...), and the truth."""

    @functools.cache
    def run(name, limit="gate", motion="static", decisions=50):
        task, robot = Task.load(motion).replace(command_limit=limit, ranges_m=((1.0, 5.0),)), Robot.paper()
        world, controller, cell = make_world(robot, task), make_controller(name, robot, task), task.cells()[0].scenario
        engagement = cell.draw(np.random.default_rng(21).random((4, cell.uniforms), np.float32))
        normals, moments = np.zeros((4, decisions, world.normals), np.float32), []
        state, truth = world.begin(engagement, normals), world.truth(engagement)
        memory = controller.reset(world.see(state), truth)
        for decision in range(decisions):
            seen = world.see(state)
            memory, command = controller.step(memory, seen)
            state, shot = world.step(state, command, normals[:, decision])
            moments.append((seen, command, shot))
        return (*map_arrays(lambda *each: np.stack(each), *moments), truth)

    return run

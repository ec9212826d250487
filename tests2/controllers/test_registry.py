"""Controllers by name."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.arrays import leaves, map_arrays
from archerfish2.controllers.registry import NAMES, make_controller
from archerfish2.protocols import Truth
from archerfish2.robot import Robot
from archerfish2.task import Task

ROBOT, TASK = Robot.paper(), Task.load("dynamic")


@pytest.mark.parametrize("name", NAMES)
def test_one_robot_decides_as_a_batch_does_in_float32(name, seen):
    def decide(target, members):
        truth, commands = Truth(target, ROBOT.gimbal(0.02), ROBOT.muzzle_model()), []
        moments = [seen(target.at(np.full(members, time)).position[..., 0, :]) for time in np.arange(0.0, 0.1, 0.02)]
        state = controller.reset(moments[0], truth)
        for moment in moments:
            state, command = controller.step(state, moment)
            commands.append(command.angle)
        return np.array(commands)

    scenario, controller = TASK.scenario(), make_controller(name, ROBOT, TASK)
    target = scenario.draw(np.random.default_rng(21).random((4, scenario.uniforms))).target
    assert_allclose(decide(map_arrays(lambda each: each[1], target), ()), decide(target, (4,))[:, 1], atol=2e-4)
    assert {each.dtype.str for each in leaves(controller) if each.dtype.kind == "f"} == {"<f4"}


def test_what_cannot_be_built_is_refused(refused):
    refused("perhaps you meant kalman", make_controller, "kalmn", ROBOT, TASK)
    refused("one length", make_controller, "oracle", ROBOT, TASK.replace(lengths_s=(1.0, 3.0)))
    refused("expected reset", make_controller, object(), ROBOT, TASK)

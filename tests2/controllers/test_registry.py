"""Controllers by name, and a user's own."""

import contextlib

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.arrays import leaves, map_arrays
from archerfish2.controllers.registry import NAMES, check_decision, make_controller, tuning_at
from archerfish2.errors import InputError
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.robot import Robot
from archerfish2.task import Task

ROBOT, TASK = Robot.paper(), Task.load("paper")
NOISE = {"bearing_sd": 0.0017, "elevation_sd": 0.0016, "range_sd": 0.06, "noise_range": 4.0}
PERFECT = {"time_offset": 0.0, "stamp_jitter": 0.0, "miss_probability": 0.0, "outlier_share": 0.0}
CAMERA = CameraRecord(rate_hz=80.0, **NOISE, **PERFECT)
SENSING = ROBOT.replace(sensing=SensingRecord(camera=CAMERA, link=LinkRecord(feedback_rate_hz=1000.0)))
OWN = """from archerfish2.protocols import aim
class Own:
    def __init__(self, robot, task): self.period = task.period_s
    def reset(self, seen, truth=None): return 0
    def step(self, state, seen): return {}
"""


@pytest.mark.parametrize("name", NAMES)
def test_one_robot_decides_as_a_batch_does(name, shoot) -> None:
    seen, command, _, truth = shoot(name, motion="dynamic", decisions=5)
    alone = map_arrays(lambda each: each[:, 1], seen)
    target = map_arrays(lambda each: each[1], truth.target)
    controller = make_controller(name, ROBOT, TASK.replace(lengths_s=(1.0,)))
    state = controller.reset(map_arrays(lambda each: each[0], alone), truth._replace(target=target))
    for step in range(5):
        state, one = controller.step(state, map_arrays(lambda each, step=step: each[step], alone))
        assert_allclose(one.angle, command.angle[step, 1], atol=2e-4)


@pytest.mark.parametrize("name", ["kalman", "kalman-lq", "imm-lq", "parabola-lq"])
def test_a_controller_has_the_cameras_noise_and_its_tuning_in_float32(name) -> None:
    tuning = tuning_at(name).replace(acceleration_sd=3.0, extra_lead_s=-0.06, initial_speed=0.3)
    controller = make_controller(name, SENSING, TASK, tuning)
    assert {each.dtype.str for each in leaves(controller) if each.dtype.kind == "f"} == {"<f4"}
    noise = np.array([*controller.predictor.noise, controller.lead], float)
    assert_allclose(noise, [3.0, 1e-3, 1e-3, 0.015, 0.0017, 0.3, -0.04 if name == "kalman" else -0.06], rtol=1e-6)
    assert name == "kalman" or controller.preview.smoothing[0] == np.float32(0.1)


@pytest.mark.parametrize(("name", "robot", "message"), [
    ("kalmn", ROBOT, "perhaps you meant kalman"), ("kalman-paper", SENSING, "paper's robot alone"),
    ("oracle", ROBOT, "one length"), (object(), ROBOT, "expected reset"),
])  # fmt: skip
def test_what_cannot_be_built_is_refused(name, robot, message) -> None:
    with pytest.raises(InputError, match=message):
        make_controller(name, robot, TASK.replace(lengths_s=(1.0, 3.0)))


@pytest.mark.parametrize(("returns", "message"), [
    ("(state, aim(seen.command))", None),
    ("seen.command", "own.py:Own: line 5: step returns a ndarray, expected .state, Command."),
    ("(state, aim(seen.command[..., None]))", r"angle of shape \(4, 2, 1\), expected \(4, 2\)"),
    ("(state, aim(seen.command)._replace(fire=seen.elapsed))", "fire of float32"),
    ("(state, aim(seen.command / 0.0))", "not finite"), ("seen.nothing", "line 5: AttributeError"),
])  # fmt: skip
def test_a_decision_of_a_users_own_is_checked(returns, message, tmp_path, shoot) -> None:
    (tmp_path / "own.py").write_text(OWN.format(returns))
    controller = make_controller(f"{tmp_path}/own.py:Own", ROBOT, TASK)
    first = map_arrays(lambda each: each[0], shoot("kalman", decisions=5)[0])
    assert make_controller(controller, ROBOT, TASK) is controller
    with np.errstate(all="ignore"), pytest.raises(InputError, match=message) if message else contextlib.nullcontext():
        check_decision(controller, first)

"""The virtual robot against the first edition's: messages, flights and shots are the same."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from archerfish2.controllers.registry import make_controller
from archerfish2.evaluation import run
from archerfish2.evaluation.draws import draw
from archerfish2.robot import Robot
from archerfish2.task import Task
from archerfish2.virtual_robot.batch import RobotBatch
from archerfish2.virtual_robot.virtual_robot import VirtualRobot

pytestmark = [pytest.mark.against_first, pytest.mark.filterwarnings("ignore:MuJoCo")]
pytest.importorskip("archerfish.virtual_robot")

from archerfish.cli.evaluation_run import EvaluationTask, classical_entrant, make_ground  # noqa: E402
from archerfish.cli.setting import SettingFiles, load_setting  # noqa: E402
from archerfish.controllers.roster import Tuning  # noqa: E402
from archerfish.evaluation.trial import fight  # noqa: E402
from archerfish.virtual_robot.description_file import load_robot  # noqa: E402
from archerfish.virtual_robot.robot import VirtualRobot as FirstRobot  # noqa: E402

INFANTRY = Path(__file__).parents[3] / "shared" / "second_edition" / "reference" / "infantry"
SEEDS = np.array([0, 7, 41])


class Swinging:
    def position(self, time):
        side = 0.3 * np.sin(3.0 * time)
        return np.stack([3.0 + 0.0 * side, side, 0.1 + 0.0 * side], axis=-1)


def both_robots():
    robots = (
        RobotBatch(VirtualRobot.load("infantry").description, 3, SEEDS),
        FirstRobot(load_robot("infantry"), 3, SEEDS),
    )
    start = np.array([[0.0, 0.0], [0.05, -0.2], [-0.1, 0.4]])
    return robots, [robot.reset(start, Swinging(), lead_s=0.1) for robot in robots]


def assert_received_is_heard(received, heard):
    for ours, theirs in (
        (received.feedback, (heard.feedback_stamp, heard.feedback_received, heard.feedback_angle, heard.feedback_rate)),
        (received.commands, (heard.command_sent, heard.command_stamp, heard.command_value)),
    ):
        for field, old in zip(ours, theirs, strict=True):
            assert_array_equal(field, old)
    frames = received.detections
    assert_array_equal(frames.exposed_s, heard.frame_stamp)
    assert_array_equal(frames.received_s, heard.frame_received)
    assert_array_equal(frames.found[..., 0], heard.frame_found)
    assert_array_equal(frames.position[..., 0, :], heard.frame_position)


def test_three_hundred_ticks_of_messages_and_twenty_flights_are_the_same() -> None:
    robots, begun = both_robots()
    assert_received_is_heard(*begun)
    draws = np.random.default_rng(0)
    for decision in range(15):
        angle = np.radians([[2.0, 10.0 * np.sin(decision)]] * 3)
        for robot in robots:
            robot.send(angle)
        assert_received_is_heard(*(robot.advance(20) for robot in robots))
        normals = draws.standard_normal((3, 3))
        flights = [robot.shoot(normals, np.array([True, decision % 2 == 0, True])) for robot in robots]
        for name in ("miss", "flight_time", "angle", "muzzle_speed_measured", "fired"):
            assert_array_equal(getattr(flights[0], name), getattr(flights[1], name))
    for _ in range(5):
        normals = draws.standard_normal((3, 3))
        landed = [robot.shoot_down(normals) for robot in robots]
        assert_array_equal(landed[0].distance, landed[1].distance)
        assert_array_equal(landed[0].lateral, landed[1].lateral)


@pytest.mark.parametrize("name", ["kalman", "kalman-lq", "imm-lq", "parabola-lq", "oracle"])
def test_classical_controllers_hit_with_the_same_shots(name) -> None:
    engagements = 4
    files = {part: INFANTRY / f"{part}.json" for part in ("pitch", "yaw", "muzzle", "sensing", "limits")}
    settings = {"kalman": (2.0, 0.01), "kalman-lq": (2.0, 0.0), "imm-lq": (4.0, 0.0), "parabola-lq": (0.5, 0.0)}
    first = EvaluationTask(
        load_setting(SettingFiles(**files, robot="infantry")), "gate", engagements, 0, robot="infantry",
        tuning={name: Tuning(acceleration_sd=settings[name][0])} if name in settings else {},
    )  # fmt: skip
    ground = make_ground(first)
    expected = fight(ground.world, classical_entrant(first, name).controller, ground.trials)
    robot, task = Robot.load(Path(__file__).parents[1] / "infantry"), Task.load("paper")
    world = VirtualRobot.load("infantry").world(robot, task)
    drawn = draw(task.cells(), engagements, 0, "evaluation", world.normals, world.plants)
    from archerfish2.controllers.tuning import Tuning as OurTuning

    tuning = OurTuning(acceleration_sd=settings[name][0]) if name in settings else None
    counted = run.count(world, make_controller(name, robot, task, tuning), *drawn)
    theirs = expected.hits(0.06)
    assert np.mean(counted.hit == theirs) >= 0.998

"""A user's script with every public name, for type checkers alone: mypy checks that it has these types."""

from pathlib import Path
from typing import Any, assert_type

import numpy as np

import archerfish as af

log = np.zeros((1000, 1))
recording = af.Recording.from_arrays(log, log, 0.001)
axis = af.identify_axis([recording], validate=["step.csv"], axis="pitch")
muzzle = af.identify_muzzle("shots.csv", height_m=0.4)
sensing = af.identify_sensing("sweep.csv", "plate.csv")
plan = af.excite("yaw", validation=False)
identified = af.identify_robot("logs", out="robot")
assert_type(axis.record, af.PlantRecord)
assert_type(muzzle.record, af.MuzzleRecord)
assert_type(identified.record, af.Robot)
yaw = af.PlantRecord.second_order(9.8, 0.4, delay_s=8e-3)
robot = af.Robot.paper().replace(yaw=yaw, sensing=sensing.record)
task = af.Task.load("any").replace(ranges_m=((2.0, 3.0),))


class Still:
    """A controller of a user's own."""

    compiled = False

    def reset(self, seen: Any, truth: Any = None) -> Any:
        return seen.command

    def step(self, state: Any, seen: Any) -> Any:
        return state, None


def reward(shot: Any, command: Any, seen: Any) -> Any:
    return shot.margin


config = af.TrainConfig(trainer="ppo")
policy = af.train(identified, "paper", config=config, reward=reward, callback=lambda row: print(row["hit_share"]))  # noqa: T201
assert_type(af.resume("runs/train", blocks=("./mine.py:block",)), af.Policy)
controllers = {"ours": policy, "kalman": "kalman", "file": Path("policy"), "mine": Still()}
results = af.evaluate(controllers, robot, task, engagements=100)
assert_type(results, af.Results)
for one in (None, "paper", Path("robot"), robot, identified):
    world = af.make_world(one, task)
    af.rollout(policy, one, Path("task.toml"), tuning="start")
af.export("kalman-lq", "lq.c", "robot", "any", tuning=af.tune("kalman-lq", identified, "strafe"))
af.export(policy, Path("policy.onnx"), tuning="start")
environment = af.make_environment(robot, task, config={"observation": "paper"})
try:
    print(af.read_log("log.csv"), plan, world.name, environment, af.__version__)  # noqa: T201
except af.InputError as error:
    print(error.code)  # noqa: T201

"""Environments of a robot and a task, and what a decision is worth in them."""

from pathlib import Path
from typing import Any

import numpy as np

from archerfish2.arrays import single_precision
from archerfish2.controllers.policy.observation import make_observer, observer_facts
from archerfish2.errors import InputError
from archerfish2.learning.config import TrainConfig
from archerfish2.plugins import FORMS, find_plugin, is_plugin
from archerfish2.robot import Robot
from archerfish2.simulation.camera import with_open_nearness
from archerfish2.simulation.environment import Environment, Reward, UserReward
from archerfish2.simulation.world import make_world
from archerfish2.task import DRAWN, Task

REWARDS = {"eq-8": (1.0, 0.0, 0.0), "hit": (1.0, 0.1, 0.0), "smooth-hit": (0.1, 0.1, 0.012)}
"""Name → weight of the distance, worth of a hit [m], and width over which it is smoothed [m]."""


def make_environment(
    robot: Robot | str | Path | None = None,
    task: Task | str | Path = "any",
    config: TrainConfig | None = None,
    reward: Any = None,
) -> Environment:
    """Build the environment that `train` trains in, in float32.

    Args:
      robot: a robot or its folder; the paper's if not given.
      task: a task, its name or its file.
      config: observation, reward and share of still targets; by default those of `train`.
      reward: in the place of the settings'; a name, or a user's function.

    Raises:
      InputError: if robot, task and settings don't fit each other, or a user's code fails.
    """
    robot = Robot.of(robot)
    task = Task.of(task)
    config = (config or TrainConfig()).resolved(robot, task)
    observer = make_observer(observer_facts(config.names, robot, task, config.frames), config.names[1:])
    observer.layout()
    world = make_world(robot, task)
    if task.motion in DRAWN:
        world = with_open_nearness(world)
    scenario = task.replace(still_share=config.still_share).scenario(world.plants)
    # Who sees old detections alone, or six numbers of them, leaves the critic to learn where the target really is.
    sees_truth = config.trainer == "ppo" and (robot.sensing is not None or config.kind in ("tracked", "multimodel"))
    environment: Environment = single_precision(
        Environment(world, scenario, observer, _reward(reward or config.reward, task), sees_truth)
    )
    return environment


def _reward(name: Any, task: Task) -> Any:
    if name in REWARDS:
        return Reward(*(np.asarray(each) for each in (*REWARDS[name], task.hit_radius_m)))
    if isinstance(name, str) and not is_plugin(name, "reward"):
        raise InputError(f"reward must be one of {', '.join(REWARDS)}, or one of your own ({FORMS}), got {name!r}")
    return UserReward(find_plugin(name, "reward"))

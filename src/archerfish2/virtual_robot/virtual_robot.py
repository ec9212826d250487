"""A virtual robot, by name or from its description: it is recorded, and shot with, as a real one would be."""

from pathlib import Path
from typing import Self

from archerfish2.robot import Robot, RobotLike
from archerfish2.task import Task, TaskLike
from archerfish2.virtual_robot.description import RobotDescription
from archerfish2.virtual_robot.description_file import load_robot
from archerfish2.virtual_robot.world import RobotWorld


class VirtualRobot:
    """A robot of MuJoCo's mechanics with firmware, link, camera, muzzle and pellets of its own.

    Its parameters are in its description, which nothing that identifies or trains reads: it is known by its logs and
    messages alone.
    """

    def __init__(self, description: RobotDescription) -> None:
        """Take a description; `VirtualRobot.load` reads one."""
        self.description = description

    @classmethod
    def load(cls, robot: str | Path = "infantry") -> Self:
        """Read a virtual robot.

        Args:
          robot: "infantry", "worn", or a TOML file as docs2/virtual_robot.md describes it.

        Raises:
          InputError: if there is none of that name, or the file is not a robot's.
        """
        return cls(load_robot(robot))

    @property
    def name(self) -> str:
        """Name."""
        return self.description.schema.name

    def world(self, robot: RobotLike = None, task: TaskLike = "any") -> RobotWorld:
        """Return the virtual robot as a world to shoot in; `evaluate` and `rollout` take the virtual robot itself.

        Args:
          robot: the records that its computer has, as `evaluate` takes them.
          task: as `evaluate` takes it.

        Raises:
          InputError: if the records lack those of the sensing.
        """
        return RobotWorld(self.description, Robot.of(robot), Task.of(task))

    def __repr__(self) -> str:
        return f"VirtualRobot({self.name})"

"""What the commands that work with a robot have in common."""

import warnings
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console

from archerfish.records.errors import InputError
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.robot import VirtualRobot

RobotName = Annotated[str, tyro.conf.arg(metavar="NAME|FILE")]
PhysicsChoice = Annotated[
    Literal["mujoco", "linear"] | None, tyro.conf.arg(help_behavior_hint="(default: mujoco where it is installed)")
]


def one_robot(
    description: RobotDescription, seed: int, physics: Literal["mujoco", "linear"] | None, console: Console
) -> VirtualRobot:
    """Build one robot; a notice that a stand-in takes the place of its mechanics is printed."""
    with warnings.catch_warnings(record=True) as notices:
        warnings.simplefilter("always")
        robot = VirtualRobot(description, 1, np.array([seed]), physics=physics)
    for notice in notices:
        console.print(f"• {notice.message}", markup=False, highlight=False)
    return robot


def seeds_from(seed: int, count: int) -> list[int]:
    """Return seeds for the parts of a command, none of which shares its noise with another."""
    return [int(each) for each in np.random.SeedSequence(seed).generate_state(count)]


def check_above_zero(**options: float) -> None:
    """Refuse options that must be above zero.

    Raises:
      InputError: naming the option.
    """
    for name, value in options.items():
        if not 0 < value < np.inf:
            raise InputError(f"--{name.replace('_', '-')} must be > 0, got {value:g}")

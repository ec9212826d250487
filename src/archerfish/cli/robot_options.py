"""What the commands that work with a robot have in common."""

import warnings
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.console import Console

from archerfish.records.errors import InputError
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.lab.log_files import write_robot_limits
from archerfish.virtual_robot.robot import VirtualRobot

LIMITS = "limits.json"
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


def limits_to_write(out: Path) -> tuple[Path, ...]:
    """Return limits.json of an output folder, or nothing where it is there and is kept."""
    return () if (out / LIMITS).is_file() else (out / LIMITS,)


def write_or_keep_limits(folder: Path, out: Path, robot: RobotDescription, console: Console) -> list[str]:
    """Write limits.json, unless the output folder has one, which a person may have edited.

    Args:
      folder: to write to, whose files move to `out` later.
      out: output folder.
      robot: whose limits.
      console: where it is said that a file is kept.

    Returns:
      Names of what is there: limits.json, or nothing if one of other content was kept.
    """
    new, old = folder / LIMITS, out / LIMITS
    write_robot_limits(new, robot)
    if not old.is_file():
        return [LIMITS]
    content = new.read_bytes()
    new.unlink()
    if old.read_bytes() == content:
        return [LIMITS]
    told = f"kept {old}, because it differs from the limits of {robot.schema.name}; remove it to have these written"
    console.print(f"• {told}", markup=False, highlight=False)
    return []


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

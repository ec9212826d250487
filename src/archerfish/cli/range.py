"""`archerfish range`: the virtual robot on the firing range, and the shots for `archerfish identify muzzle`."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console

from archerfish.cli.options import Folder, JsonFile
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.progress import progress_bar
from archerfish.cli.robot_options import (
    PhysicsChoice,
    RobotName,
    check_above_zero,
    limits_to_write,
    one_robot,
    seeds_from,
    write_or_keep_limits,
)
from archerfish.cli.run_folder import run_folder
from archerfish.cli.summary_end import print_end
from archerfish.paper.tables import landing_table
from archerfish.records.errors import InputError
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.lab.log_files import write_shots
from archerfish.virtual_robot.lab.shooting import ShotRow, check_aim, shoot_ground, shoot_plates
from archerfish.virtual_robot.robot import VirtualRobot


@dataclass(frozen=True)
class Range:
    """Fire the virtual robot at plates or at the ground, and write the shots.

    At each plate it fires single shots, with rested friction wheels, and a burst at the cadence of an engagement, one
    pellet every 20 ms, in which the wheels slow down: a muzzle that is identified from both has the mean speed of
    both. Each shot has its measured speed. --ground fires single shots at the ground, at the nine angles of the paper's
    Table I.

    Writes shots.csv, or with --ground landings.csv, for archerfish identify muzzle; and limits.json, what the team
    knows of its robot; one that is there with other content is kept.

    Examples:
      archerfish range --out runs/my-robot
      archerfish range --ground --shots 20 --out runs/my-robot
      archerfish range --robot worn --distances-m 2 4 --burst 100
    """

    robot: RobotName = "infantry"
    """Robot: infantry, worn, or a TOML file (docs/virtual_robot.md)."""
    ground: bool = False
    """Fire at the ground, at the angles of Table I."""
    distances_m: Annotated[tuple[float, ...], tyro.conf.arg(metavar="METRES…")] = (1.5, 2.5, 3.5, 4.5)
    """Distances of the plates from the pivot."""
    pitch_deg: float = 2.0
    """Commanded pitch at the plates in degrees."""
    shots: int = 10
    """Single shots at each plate or angle."""
    burst: int = 50
    """Shots of the burst at each plate."""
    physics: PhysicsChoice = None
    """The robot's mechanics."""
    out: Folder = Path("runs/range")
    """Folder for the shots."""
    seed: int = 0
    """Of dispersion and noise."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes; limits.json that is there is kept."""
        return Outputs((self.out / _shots_name(self), *limits_to_write(self.out)))


Summary = dict[str, Any]


def run_range(command: Range, console: Console | None = None) -> Summary:
    """Fire, write the shots, print what was done, and return what --json writes.

    Raises:
      InputError: if an option or the output folder can't be used, or the robot can't aim there.
    """
    console = console or Console()
    robot = load_robot(command.robot)
    _check(command, robot)
    noise, draws = seeds_from(command.seed, 2)
    name = _shots_name(command)
    with run_folder(command.out, make_writer(command)) as folder:
        virtual = one_robot(robot, noise, command.physics, console)
        fired = _fired(command, virtual, draws)
        write_shots(folder / name, fired)
        names = [name, *write_or_keep_limits(folder, command.out, robot, console)]
    files = [str(command.out / each) for each in names]
    speeds = np.array([shot.speed for shot in fired])
    console.print(
        f"{robot.schema.name}: {len(fired)} shots, measured speed {speeds.mean():.2f} ± {speeds.std():.2f} m/s"
    )
    print_end(console, [_height_words(robot)] if command.ground else [], files)
    summary = {"robot": robot.schema.name, "shots": len(fired), "mean_speed_m_s": float(speeds.mean()), "files": files}
    tape = {"muzzle_height_m": _muzzle_height(robot), "muzzle_length_m": robot.muzzle.forward_m}
    return {**summary, **tape} if command.ground else summary


def _shots_name(command: Range) -> str:
    return "landings.csv" if command.ground else "shots.csv"


def _muzzle_height(robot: RobotDescription) -> float:
    """Return the height of the muzzle above the ground with the barrel level, by tape [m]."""
    return round(robot.muzzle.height_m + robot.muzzle.up_m, 3)


def _height_words(robot: RobotDescription) -> str:
    height, length = _muzzle_height(robot), robot.muzzle.forward_m
    return (
        f"the muzzle is {height:g} m above the ground with the barrel level, {length:g} m ahead of the pivot: "
        f"identify muzzle --height-m {height:g} --length-m {length:g}"
    )


def table_1_angles() -> list[tuple[float, float]]:
    """Return commanded pitch and yaw [rad] of Table I's nine rows; the paper's yaw is to the right."""
    return [(float(np.radians(row.pitch_deg)), float(np.radians(-row.yaw_deg))) for row in landing_table().rows]


def _check(command: Range, robot: RobotDescription) -> None:
    if command.shots < 0 or command.burst < 0 or command.shots + command.burst * (not command.ground) < 1:
        raise InputError(f"--shots and --burst must ask for a shot, got {command.shots} and {command.burst}")
    if not command.distances_m:
        raise InputError("--distances-m: no distance given; name at least one")
    for distance in command.distances_m:
        check_above_zero(distances_m=distance)
        if distance <= robot.muzzle.forward_m:
            raise InputError(f"--distances-m {distance:g} lies behind the muzzle; put the plate further away")
    aims = table_1_angles() if command.ground else [(float(np.radians(command.pitch_deg)), 0.0)]
    for pitch, yaw in aims:
        check_aim(robot, pitch, yaw)


def _fired(command: Range, robot: VirtualRobot, seed: int) -> list[ShotRow]:
    rows: Iterator[ShotRow]
    if command.ground:
        angles = table_1_angles()
        total = len(angles) * command.shots
        rows = shoot_ground(robot, angles, command.shots, seed)
    else:
        total = len(command.distances_m) * (command.shots + command.burst)
        rows = shoot_plates(
            robot, command.distances_m, float(np.radians(command.pitch_deg)), command.shots, command.burst, seed
        )
    fired = []
    with progress_bar("firing", total, "shots") as advance:
        for row in rows:
            fired.append(row)
            advance(len(fired), "")
    return fired

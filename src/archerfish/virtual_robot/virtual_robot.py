"""A virtual robot, by name or from its description: it is recorded, and shot with, as a real one would be."""

from collections.abc import Iterable
from pathlib import Path
from typing import Self

from archerfish import storage
from archerfish.errors import InputError, checked_arguments, meant
from archerfish.reports.progress import bar
from archerfish.robot import Robot, RobotLike
from archerfish.task import Task, TaskLike
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import load_robot, robot_path
from archerfish.virtual_robot.record import PARTS, recordings, write_columns, write_limits, write_tape
from archerfish.virtual_robot.world import RobotWorld


class VirtualRobot:
    """A robot of MuJoCo's mechanics with firmware, link, camera, muzzle and pellets of its own.

    Its parameters are in its description, which nothing that identifies or trains reads: it is known by its logs and
    messages alone.
    """

    def __init__(self, description: RobotDescription, source: bytes = b"") -> None:
        """Take a description, and the text that it was read from; `VirtualRobot.load` reads one."""
        self.description, self.source = description, source

    @classmethod
    @checked_arguments
    def load(cls, robot: str | Path = "infantry") -> Self:
        """Read a virtual robot.

        Args:
          robot: "infantry", "worn", or a TOML file as docs/virtual_robot.md describes it.

        Raises:
          InputError: if there is none of that name, or the file is not a robot's.
        """
        return cls(load_robot(robot), robot_path(robot).read_bytes())

    @property
    def name(self) -> str:
        """Name."""
        return self.description.schema.name

    @checked_arguments
    def record(
        self, folder: str | Path, *, seed: int = 0, parts: str | Iterable[str] = (), overwrite: bool = False
    ) -> Path:
        """Record all that an identification needs, and what its result is compared with, into a folder.

        Args:
          folder: for the logs, limits.json and tape.json; `identify_robot` reads it. robot.toml in it is a copy of the
            description, which no identification reads. Logs of an earlier recording in it are removed.
          seed: of the robot's noise and of the dispersion.
          parts: one or some of `PARTS` (axes, timing, shots, landings), all if none are named.
          overwrite: whether files in the folder that no recording wrote may be replaced.

        Returns:
          The folder.

        Raises:
          InputError: if there is no such part, or the folder can't be written.
        """
        folder = Path(folder)
        if not isinstance(parts, Iterable):
            raise InputError(f"parts: expected names, got one of type {type(parts).__name__}; name some of {[*PARTS]}")
        chosen = [parts] if isinstance(parts, str) else [*parts] or [*PARTS]
        if unknown := sorted(set(chosen) - PARTS.keys()):
            remedy = meant(str(unknown[0]), PARTS, "name these")
            raise InputError(f"parts: there is no {unknown[0]!r}, expected some of {', '.join(PARTS)}; {remedy}")
        facts = {"robot": self.name, "seed": seed, "parts": chosen}
        with storage.output_folder(folder, "record", (), overwrite, facts, ("limits.json", "tape.json")) as written:
            made = recordings(self.description, seed)
            with bar("recording", len(chosen), "recordings") as advance:
                for place, part in enumerate(chosen):
                    advance(place, part)
                    for name, columns in made[part]():
                        write_columns(written / name, columns, 4 if part in ("shots", "landings") else 9)
                advance(len(chosen))
            write_limits(written / "limits.json", self.description)
            write_tape(written / "tape.json", self.description)
            if self.source:
                storage.write_bytes(written / "robot.toml", self.source)
        return folder

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

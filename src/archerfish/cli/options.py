"""Options that several commands have, declared once."""

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import tyro

from archerfish import storage
from archerfish.controllers.registry import is_policy
from archerfish.errors import InputError
from archerfish.robot import Robot
from archerfish.task import Task


class Ending(NamedTuple):
    """What a command prints last; how long it took is added."""

    found: str  # what came out
    where: str  # what was written, and what to open
    then: str = ""  # what to type next


def shown(metavar: str = "", default: str = "") -> Any:
    """Return how an option is shown whose default says nothing."""
    return tyro.conf.arg(metavar=metavar or None, help_behavior_hint=default)


def assigned(settings: Iterable[str]) -> dict[str, Any]:
    """Return NAME=VALUE and PART.NAME=VALUE as fields, and parts as dictionaries of fields; a VALUE is JSON, or a text.

    Raises:
      InputError: if one is neither.
    """
    fields: dict[str, Any] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        part, _, field = name.rpartition(".")
        place = fields.setdefault(part, {}) if part else fields
        if isinstance(place, dict) and not isinstance(place.get(field, {}), dict):
            raise InputError(f"--set gives {name} twice, last as {setting}; leave one out")
        if not equals or not isinstance(place, dict) or isinstance(place.get(field), dict):
            expected = "NAME=VALUE, and no value for a part and for a field of it"
            raise InputError(f"--set takes {expected}, got {setting}; write for instance gradient.hidden=256")
        try:
            place[field] = json.loads(text)
        except ValueError:
            place[field] = text
    return fields


@dataclass(frozen=True)
class ForRobot:
    """What a command that is for a robot and a task takes."""

    robot: Annotated[tyro.conf.Positional[str | None], shown("[ROBOT]")] = None
    """Folder of a robot's records; the paper's gimbal if it is paper, or not given."""
    task: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "any"
    """What is shot at; archerfish evaluate --help lists the names."""
    command_limit: Annotated[
        Literal["gate", "box", "los-2deg"] | None, shown("gate|box|los-2deg", "(default: the task's, gate)")
    ] = None
    """Of angle ranges, rate and acceleration (gate), of angle ranges alone (box), or 2° ahead of the line of sight."""
    accept_unusable: Annotated[bool, shown()] = False
    """Take parts of the robot that their identification found not usable."""

    @property
    def folder(self) -> Path | None:
        """The robot's; None of the paper's."""
        return None if self.robot in (None, "paper") else Path(str(self.robot))

    def own_policy(self) -> list[str]:
        """Return the policy of the robot's folder, none without; say so of one that is not finished."""
        folder = self.folder and self.folder / "policy"
        if folder is None or not is_policy(folder):
            return []
        if (folder / "policy.safetensors").is_file():
            return [str(folder)]
        left_out = f"{folder} is not finished and left out; continue it: archerfish train --resume {folder}"
        print(left_out, file=sys.stderr)  # noqa: T201
        return []

    def robot_controller(self, name: str) -> str:
        """Return the controller that a robot is to have: "policy" is its own, and so is none, else kalman.

        Raises:
          InputError: if it has no policy and one is meant.
        """
        if name not in ("", "policy"):
            return name
        own = self.own_policy()
        if name and not own:
            raise InputError(f"{self.folder}: has no policy; train one, or name another controller")
        return own[0] if own else "kalman"

    def robot_and_task(self) -> tuple[Robot, Task]:
        """Read what is named."""
        task = Task.of(self.task)
        if self.command_limit is not None:
            task = task.replace(command_limit=self.command_limit)
        return Robot.of(self.robot, accept_unusable=self.accept_unusable), task


@dataclass(frozen=True, kw_only=True)
class Writes:
    """What a command takes that fills a folder with files of its own."""

    overwrite: Annotated[bool, shown()] = False
    """Replace files in that folder that this command did not write."""

    @contextmanager
    def written(self, out: Path, command: str, options: str, inputs: Iterable[Any], names: Any = ()) -> Iterator[Path]:
        """Yield a folder to fill, with run.json beside its files at the end; see `storage.output_folder`.

        Args:
          out: the command's folder.
          command: by which run.json has these files.
          options: as typed.
          inputs: files that it reads, and None in the place of those that are not given.
          names: of files that are certain to come.
        """
        files = [Path(file) for file in inputs if file]
        with storage.output_folder(out, command, files, self.overwrite, {"options": options}, names) as folder:
            yield folder

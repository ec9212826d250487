"""What a command is about to write, and the check before its work begins that nothing is lost by it."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from archerfish.cli.inputs import read_files
from archerfish.cli.json_output import check_json_file, is_stream
from archerfish.cli.writer import Writer
from archerfish.cli.written_files import NAME
from archerfish.records import storage
from archerfish.records.errors import file_error
from archerfish.records.unfinished import remove_abandoned


class Outputs(NamedTuple):
    """What a command writes."""

    files: tuple[Path, ...] = ()
    """Files whose names the command chooses."""
    folders: tuple[Path, ...] = ()
    """Folders that it fills, with names that depend on the work."""
    named: tuple[Path, ...] = ()
    """Files whose names the user gives."""
    kept: tuple[Path, ...] = ()
    """Files and folders of its own that it goes on with, after a look at what they hold."""
    owner: str = ""
    """Name of the command whose run the files belong to, where that is another one."""
    option: str = "--out"
    """Option that says where it writes."""

    def all(self) -> Iterator[Path]:
        """Yield all of them, and the lists of what was written."""
        yield from (*self.files, *self.folders, *self.named, *self.kept, *self.lists())

    def lists(self) -> tuple[Path, ...]:
        """Return the lists of what was written."""
        return tuple({each.parent / NAME: None for each in (*self.files, *self.folders)})


def command_name(kind: type) -> str:
    """Return the name of a command, as typed, from the class of its options: IdentifyGimbal → identify gimbal."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", kind.__name__).lower()


def make_writer(command: Any) -> Writer:
    """Return who writes, and what it may not replace.

    Args:
      command: its options, a dataclass.
    """
    outputs: Outputs = command.outputs()
    name = outputs.owner or command_name(type(command))
    return Writer(name, read_files(command), command.overwrite, outputs.option, outputs.named)


def check_outputs(command: Any) -> None:
    """Refuse a command that would write over what it reads, over no regular file, or over what another one wrote.

    Args:
      command: its options, a dataclass whose method `outputs` says what it writes.

    Raises:
      InputError: naming the file that is in the way.
    """
    writer, outputs = make_writer(command), command.outputs()
    for path in outputs.lists():
        storage.check_regular(path)
    writer.check(outputs.files)
    writer.check_folders(outputs.folders)
    writer.check_kept(outputs.kept)
    writer.check(outputs.named)
    for folder in {path.parent for path in outputs.named}:
        remove_abandoned(folder)
    if command.json is not None and not is_stream(command.json):
        remove_abandoned(command.json.parent)
        check_json_file(command.json, writer)
        _check_apart(command.json, outputs)


def _check_apart(path: Path, outputs: Outputs) -> None:
    """Refuse a --json that is one of the other files, in a folder that the command fills, or in the place of one."""
    place = path.resolve()
    others = [each.resolve() for each in outputs.all()]
    if path.name == NAME or any(place == each or place in each.parents or each in place.parents for each in others):
        raise file_error(path, "is written by this command anyway, not as --json", "choose another --json")

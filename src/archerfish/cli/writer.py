"""Who writes files, and what it may not replace: what it reads, what is no regular file, what others wrote."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from archerfish.cli.written_files import JSON, find_written
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error


class Writer(NamedTuple):
    """A command that writes files."""

    command: str
    """Its name, as typed."""
    reads: tuple[Path, ...] = ()
    """Files that it reads."""
    overwrite: bool = False
    """Whether it may replace regular files that it did not write itself."""
    option: str = "--out"
    """Option that says where it writes, for messages."""
    named: tuple[Path, ...] = ()
    """Files whose names the user gave: they are replaced if they belong to no run."""

    def check(self, paths: Iterable[Path]) -> None:
        """Refuse to write files over what is there, unless this command wrote it and it has not been changed since.

        Args:
          paths: of files; one whose name the user gave may also be there without having been written by a command.

        Raises:
          InputError: naming the first file that may not be written, and why.
        """
        for path in self._existing(paths):
            written = find_written(path)
            if self.overwrite or written == (self.command, True):
                continue
            if written is None and path in self.named:
                if not is_record(path):
                    continue
                problem = "is a record of Archerfish"
            elif written is None:
                problem = f"is there, and archerfish {self.command} did not write it"
            elif written.command == JSON:
                problem = (
                    "was written by an earlier --json" if written.is_unchanged else "was edited since --json wrote it"
                )
            elif written.is_unchanged:
                problem = f"belongs to a run of archerfish {written.command}"
            else:
                problem = f"has been changed since archerfish {written.command} wrote it"
            raise file_error(path, problem, self.remedy)

    def check_folders(self, folders: Iterable[Path]) -> None:
        """Refuse to write into folders where a file or a link is in their place, what is read, or what others wrote.

        Files that no command wrote are left to `check`: their names may be others than those that are to be written.

        Raises:
          InputError: naming the first file that is in the way.
        """
        for folder in folders:
            if os.path.lexists(folder) and not folder.is_dir():
                raise file_error(folder, "is in the place of a folder", f"choose another {self.option}")
            paths = list(folder.rglob("*"))
            for each in (folder, *paths):
                if each.is_symlink() and each.is_dir():
                    problem = "is a symbolic link in the place of a folder"
                    raise file_error(each, problem, f"choose another {self.option}, or put a folder there")
            within = [each for each in paths if each.is_file() and not each.is_symlink()]
            self.check(each for each in within if self._is_read(each) or find_written(each) is not None)

    def check_kept(self, paths: Iterable[Path]) -> None:
        """Refuse links, devices and the like in the place of what a command goes on with; it looks at the rest itself.

        Raises:
          InputError: naming the first path that is in the way.
        """
        for path in paths:
            if path.is_symlink() or not path.is_dir():
                storage.check_regular(path)

    @property
    def remedy(self) -> str:
        """What a user can do about a file that another command wrote."""
        return f"choose another {self.option}, or pass --overwrite to replace it"

    def _existing(self, paths: Iterable[Path]) -> Iterator[Path]:
        """Yield those of some paths where a regular file is that is not read."""
        for path in paths:
            storage.check_regular(path)
            if self._is_read(path):
                problem = "is read by this command, which never replaces what it reads"
                raise file_error(path, problem, f"choose another {self.option}")
            if path.is_file():
                yield path

    def _is_read(self, path: Path) -> bool:
        for each in self.reads:
            with suppress(OSError):  # one of the two is not there
                if path.samefile(each):
                    return True
        return False


def is_record(path: Path) -> bool:
    """Tell whether a file is a JSON record with a schema of ours."""
    if path.suffix != ".json":
        return False
    try:
        facts = storage.read_json(path)
    except InputError:
        return False
    return isinstance(facts, dict) and str(facts.get("schema")).startswith("archerfish.")

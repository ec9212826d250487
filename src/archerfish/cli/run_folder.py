"""The folder that a command writes: whole, or as it was before."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from archerfish.cli.interrupts import at_last, without_interrupts
from archerfish.cli.publication import files_below, publish
from archerfish.cli.writer import Writer
from archerfish.records import storage
from archerfish.records.unfinished import remove_abandoned, unfinished_folder


@contextmanager
def run_folder(out: Path, writer: Writer) -> Iterator[Path]:
    """Yield an empty folder to fill; its files move to `out` when the block ends, and vanish if it fails.

    Args:
      out: is made if missing; files of an earlier run stay until they are replaced.
      writer: whose files they are, and what they may not replace.

    Yields:
      A folder inside `out`, so that moving is renaming.

    Raises:
      InputError: if `out` can't be made or written, or something in it may not be replaced.
    """
    with without_interrupts():
        storage.check_writable(out)
        made = [each for each in (out, *out.parents) if not each.exists()]
    with at_last(lambda: remove_empty(made)):
        out.mkdir(parents=True, exist_ok=True)
        remove_abandoned(out)
        with unfinished_folder(out) as unfinished, at_last(lambda: shutil.rmtree(unfinished, ignore_errors=True)):
            finished = unfinished / "new"
            finished.mkdir()
            yield finished
            with without_interrupts():
                publish(files_below(finished), out, writer, unfinished / "old")


def remove_empty(folders: list[Path]) -> None:
    """Remove folders, innermost first, up to one that is in use."""
    with suppress(OSError):
        for folder in filter(Path.exists, folders):
            folder.rmdir()

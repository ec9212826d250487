"""The folder that a command writes: whole, or as it was before."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from archerfish.cli.interrupts import without_interrupts
from archerfish.records import storage
from archerfish.records.errors import file_error


@contextmanager
def run_folder(out: Path) -> Iterator[Path]:
    """Yield an empty folder to fill; its files move to `out` when the block ends, and vanish if it fails.

    Args:
      out: is made if missing; files of an earlier run stay until they are replaced.

    Yields:
      A folder inside `out`, so that moving is renaming.

    Raises:
      InputError: if `out` can't be made or written.
    """
    storage.check_writable(out)
    made = [each for each in (out, *out.parents) if not each.exists()]
    out.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=out))
    try:
        yield unfinished
        with without_interrupts():
            _publish(unfinished, out)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
        _remove_empty(made)


def _publish(unfinished: Path, out: Path) -> None:
    files = [each for each in unfinished.rglob("*") if each.is_file()]
    with ExitStack() as stack:
        for path in (each for each in files if each.suffix == ".safetensors"):
            stack.enter_context(storage.overwriting((out / path.relative_to(unfinished)).with_suffix(".json")))
        # The arrays of a record before its facts, as `overwriting` wants it.
        for path in sorted(files, key=lambda each: (each.suffix == ".json", each)):
            target = out / path.relative_to(unfinished)
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
            except OSError as error:
                problem = f"can't be written ({error.strerror})"
                raise file_error(target, problem, "choose another output folder") from error


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        if any(folder.iterdir()):
            return
        folder.rmdir()

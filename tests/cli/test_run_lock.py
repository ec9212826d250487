import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish.cli.run_lock import NAME, locked
from archerfish.records.errors import InputError

HOLD = """
import sys, time
from pathlib import Path
from archerfish.cli.run_lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_holder_is_refused_until_the_first_is_killed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {holder.pid} is writing this run"), locked(tmp_path):
            pass
        holder.kill()
        holder.wait()
    assert (tmp_path / NAME).exists()
    with locked(tmp_path):
        pass


def test_a_lock_whose_file_was_removed_does_not_keep_a_new_one_from_counting(tmp_path: Path) -> None:
    with locked(tmp_path):
        (tmp_path / NAME).unlink()
        with (
            locked(tmp_path),
            pytest.raises(InputError, match="is writing this run"),
            locked(tmp_path),
        ):
            pass


@pytest.mark.parametrize("kind", ["file", "link", "dangling link", "pipe", "folder"])
def test_what_is_no_lock_stays(tmp_path: Path, kind: str) -> None:
    folder, other = tmp_path / "run", tmp_path / "other.txt"
    folder.mkdir()
    if kind == "file":
        (folder / NAME).write_text("lock of another program")
    elif kind == "pipe":
        os.mkfifo(folder / NAME)
    elif kind == "folder":
        (folder / NAME).mkdir()
    else:
        (folder / NAME).symlink_to(other)
    if kind == "link":
        other.write_text("12")
    with pytest.raises(InputError, match=r"\.lock: (is no lock of Archerfish|can't be written)"), locked(folder):
        pass
    assert other.exists() == (kind == "link")
    assert not other.exists() or other.read_text() == "12"
    assert kind != "file" or (folder / NAME).read_text() == "lock of another program"


def test_a_folder_that_can_t_be_written_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read_only(*_: object) -> int:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(os, "open", read_only)
    with pytest.raises(InputError, match=r"can't be written \(Read-only file system\)"), locked(tmp_path):
        pass


def test_a_file_system_without_locks_is_one_line_and_no_other_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.raises(InputError, match=r"can't be locked \(No locks available\)"), locked(tmp_path):
        pass

import os
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish.cli.run_folder import run_folder
from archerfish.cli.writer import Writer
from archerfish.cli.written_files import NAME
from archerfish.records.errors import InputError

MINE = Writer("record")


def write(out: Path, writer: Writer = MINE, **files: str) -> None:
    """Write files into a run folder, as a command does."""
    with run_folder(out, writer) as folder:
        for name, content in files.items():
            (folder / name).write_text(content)


def content(out: Path) -> dict[str, str]:
    """Return name → content of the files in a folder, less the list of who wrote them."""
    return {path.name: path.read_text() for path in out.iterdir() if path.name != NAME}


def test_files_appear_when_the_block_ends(tmp_path):
    out = tmp_path / "runs" / "first"
    with run_folder(out, MINE) as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("new")
        assert not (out / "deep").exists()
    assert {str(path.relative_to(out)) for path in out.rglob("*")} == {"deep", "deep/file", NAME}


@pytest.mark.parametrize("error", [InputError, KeyboardInterrupt])
def test_a_failing_block_leaves_nothing(tmp_path, error):
    with pytest.raises(error), run_folder(tmp_path / "runs" / "first", MINE) as folder:
        (folder / "file").write_text("half")
        raise error("stop")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_survives_a_failure_and_is_replaced_by_a_success(tmp_path):
    (tmp_path / "other").write_text("kept")
    write(tmp_path, result="old")
    with pytest.raises(KeyboardInterrupt), run_folder(tmp_path, MINE) as folder:
        (folder / "result").write_text("half")
        raise KeyboardInterrupt
    assert (tmp_path / "result").read_text() == "old"
    write(tmp_path, result="new")
    assert content(tmp_path) == {"result": "new", "other": "kept"}


def make_folder(path: Path) -> None:
    path.mkdir()
    (path / "inside").write_text("kept")


KINDS = {
    "folder": make_folder,
    "named pipe": os.mkfifo,
    "symbolic link": lambda path: path.symlink_to("elsewhere"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_regular_file_is_refused_and_nothing_is_published(tmp_path, kind):
    KINDS[kind](tmp_path / "second")
    before = (tmp_path / "second").lstat()
    with pytest.raises(InputError, match=f"second: can't be written, since it is a {kind}"):
        write(tmp_path, MINE._replace(overwrite=True), first="new", second="new")
    assert [path.name for path in tmp_path.iterdir()] == ["second"]
    assert (tmp_path / "second").lstat() == before


def test_files_of_others_are_refused_unless_overwriting_is_allowed(tmp_path):
    write(tmp_path, theirs="run")
    (tmp_path / "own").write_text("by hand")
    for name, why in (("theirs", "belongs to a run of archerfish record"), ("own", "archerfish train did not write")):
        with pytest.raises(InputError, match=f"{name}: .*{why}.*choose another --out, or pass --overwrite"):
            write(tmp_path, Writer("train"), **{"free": "", name: ""})
    assert content(tmp_path) == {"theirs": "run", "own": "by hand"}
    write(tmp_path, Writer("train", overwrite=True), theirs="new", own="new")
    write(tmp_path, Writer("train"), theirs="newer")
    assert content(tmp_path) == {"theirs": "newer", "own": "new"}


def test_an_output_that_was_edited_or_exchanged_is_refused(tmp_path):
    write(tmp_path, log="recorded")
    (tmp_path / "log").write_text("recorded on the real robot")
    with pytest.raises(InputError, match="log: has been changed since archerfish record wrote it"):
        write(tmp_path, log="again")
    assert content(tmp_path) == {"log": "recorded on the real robot"}


def test_a_run_folder_below_another_one_is_known_by_the_list_above(tmp_path):
    with run_folder(tmp_path, Writer("reproduce")) as folder:
        (folder / "policies").mkdir()
        (folder / "policies" / "policy.json").write_text("{}")
    with pytest.raises(InputError, match="belongs to a run of archerfish reproduce"):
        write(tmp_path / "policies", Writer("train"), **{"policy.json": "new"})


def test_a_fault_half_way_puts_back_what_was_replaced(tmp_path, monkeypatch):
    write(tmp_path, a="old", b="old")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    really = Path.replace

    def full_disk(path: Path, target: Path) -> Path:
        if path.parent.name == "new" and path.name == "c":
            raise OSError(28, "No space left on device")
        return really(path, target)

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(InputError, match="c: can't be written"):
        write(tmp_path, a="new", aa="new", b="new", c="new")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


KILLED = """
import os, sys
from pathlib import Path
from archerfish.cli.run_folder import run_folder
from archerfish.cli.writer import Writer

def replace(path, target):
    if path.parent.name == "new" and path.name == "b":
        os._exit(9)
    return really(path, target)

really, Path.replace = Path.replace, replace
with run_folder(Path(sys.argv[1]), Writer("record")) as folder:
    for name in "ab":
        (folder / name).write_text("new")
"""


def test_a_process_killed_between_two_files_does_not_lock_the_command_out(tmp_path):
    write(tmp_path, a="old", b="old")
    assert subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False).returncode == 9
    assert [(tmp_path / name).read_text() for name in "ab"] == ["new", "old"]
    write(tmp_path, a="newer", b="newer")
    assert [(tmp_path / name).read_text() for name in "ab"] == ["newer", "newer"]

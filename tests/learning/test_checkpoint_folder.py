"""Checkpoints on a disk that fails, in files that rot, by writers that are killed."""

import errno
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.learning.checkpoint_folder import add_checkpoint, checkpoint_files, newest_checkpoint
from archerfish.records.errors import InputError

SOURCE = Path(__file__).parents[2] / "src"


def write(folder: Path, *iterations: int) -> None:
    for iteration in iterations:
        add_checkpoint(folder, iteration, {"note": "x"}, {"a": np.full(100, iteration, np.float32)})


def test_the_last_two_stay(tmp_path: Path) -> None:
    write(tmp_path, 4, 8, 12, 16)
    assert [path.stem for path in checkpoint_files(tmp_path)] == ["000000012", "000000016"]
    assert len(list(tmp_path.iterdir())) == 4
    newest = newest_checkpoint(tmp_path)
    assert newest is not None
    assert newest.iteration == 16
    np.testing.assert_array_equal(newest.arrays["a"], np.full(100, 16, np.float32))


def test_there_is_none_before_the_first(tmp_path: Path) -> None:
    assert newest_checkpoint(tmp_path / "nowhere") is None


@pytest.mark.parametrize("ending", [".json", ".safetensors"])
@pytest.mark.parametrize("harm", ["flipped", "cut", "gone"])
def test_a_damaged_last_one_gives_way_to_the_one_before(tmp_path: Path, ending: str, harm: str) -> None:
    write(tmp_path, 4, 8)
    path = tmp_path / f"000000008{ending}"
    content = bytearray(path.read_bytes())
    if harm == "gone":
        path.unlink()
    elif harm == "cut":
        path.write_bytes(content[: len(content) // 2])
    else:
        # In the JSON the note itself: it stays JSON, and is not what was written.
        place = content.rindex(b'"x"') + 1 if ending == ".json" else len(content) // 2
        content[place] ^= 1
        path.write_bytes(content)
    newest = newest_checkpoint(tmp_path)
    assert newest is not None
    assert newest.iteration == 4
    # Without its JSON there never was such a checkpoint: that is how a killed writer leaves it.
    assert len(newest.damaged) == (0 if (ending, harm) == (".json", "gone") else 1)
    assert all("000000008" in told and "\n" not in told for told in newest.damaged)
    # The damaged one must not count as one of the last two.
    write(tmp_path, 8, 12)
    assert [each.stem for each in checkpoint_files(tmp_path)] == ["000000008", "000000012"]


def test_all_damaged_is_refused_with_a_remedy(tmp_path: Path) -> None:
    write(tmp_path, 4, 8)
    for path in tmp_path.glob("*.safetensors"):
        path.write_bytes(b"")
    with pytest.raises(InputError, match=r"no checkpoint is sound .*; delete that folder to train again"):
        newest_checkpoint(tmp_path)


@pytest.mark.parametrize("function", ["fsync", "fdopen"])
@pytest.mark.parametrize("after", range(6))
def test_a_full_disk_at_any_write_is_one_line_and_costs_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str, after: int
) -> None:
    write(tmp_path, 4, 8)
    real, calls = getattr(os, function), [0]

    def full(*arguments: Any, **named: Any) -> Any:
        calls[0] += 1
        if calls[0] > after:
            if function == "fdopen":
                os.close(arguments[0])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(*arguments, **named)

    monkeypatch.setattr(os, function, full)
    try:
        write(tmp_path, 12)
    except InputError as error:
        assert re.search(r"can't be written \(No space left on device\)", str(error))
        assert "\n" not in str(error)
    monkeypatch.undo()
    newest = newest_checkpoint(tmp_path)
    assert newest is not None
    assert newest.iteration in (8, 12)
    assert newest.damaged == ()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_writer_killed_at_any_step_leaves_nothing_unreadable(tmp_path: Path) -> None:
    script = Path(__file__).with_name("killed_writer.py")
    done = subprocess.run(
        [sys.executable, script, tmp_path],
        env={**os.environ, "PYTHONPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    steps = [int(each) for each in done.stdout.split()]
    # Two files each, with at least open, write, fsync, rename and fsync of the folder.
    assert all(each > 10 for each in steps)

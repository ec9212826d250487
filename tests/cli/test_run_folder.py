from pathlib import Path

import pytest

from archerfish.cli.run_folder import run_folder
from archerfish.records.errors import InputError


def test_files_appear_when_the_block_ends(tmp_path):
    out = tmp_path / "runs" / "first"
    with run_folder(out) as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("new")
        assert not (out / "deep").exists()
    assert [path.relative_to(out) for path in out.rglob("*")] == [Path("deep"), Path("deep/file")]


@pytest.mark.parametrize("error", [InputError, KeyboardInterrupt])
def test_a_failing_block_leaves_nothing(tmp_path, error):
    with pytest.raises(error), run_folder(tmp_path / "runs" / "first") as folder:
        (folder / "file").write_text("half")
        raise error("stop")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_run_survives_a_failure_and_is_replaced_by_a_success(tmp_path):
    (tmp_path / "result").write_text("old")
    (tmp_path / "other").write_text("kept")
    with pytest.raises(KeyboardInterrupt), run_folder(tmp_path) as folder:
        (folder / "result").write_text("half")
        raise KeyboardInterrupt
    assert (tmp_path / "result").read_text() == "old"
    with run_folder(tmp_path) as folder:
        (folder / "result").write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"result": "new", "other": "kept"}


def test_a_folder_in_the_place_of_a_result_is_refused(tmp_path):
    (tmp_path / "result").mkdir()
    with pytest.raises(InputError, match="result: can't be written"), run_folder(tmp_path) as folder:
        (folder / "result").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["result"]

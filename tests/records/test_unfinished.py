from pathlib import Path

import pytest

from archerfish.records.unfinished import unfinished_folder


def test_a_new_folder_that_another_process_takes_for_abandoned_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("fcntl")
    mkdir, made = Path.mkdir, []

    def removed_at_once(folder: Path) -> None:
        mkdir(folder)
        made.append(folder)
        if len(made) == 1:
            folder.rmdir()

    monkeypatch.setattr(Path, "mkdir", removed_at_once)
    with unfinished_folder(tmp_path) as folder:
        assert [folder] == list(tmp_path.iterdir())
    assert len(made) == 2

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from archerfish.cli import view
from archerfish.cli.setting import SettingFiles
from archerfish.cli.view import View

Command = Callable[..., tuple[int, str, str]]
Refused = Callable[..., str]
needs_viser = pytest.mark.skipif(importlib.util.find_spec("viser") is None, reason="needs viser, the extra view")


def test_without_viser_the_command_says_what_to_install(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert "pip install 'archerfish[view]'" in refused("view")


def test_the_page_is_for_this_machine_by_default() -> None:
    assert View().host == "127.0.0.1"


@needs_viser
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--port", "70000"), "--port"),
        (("--host", "192.0.2.7"), "--host"),
        (("--controllers", "nobody"), "nobody"),
        (("--controllers", "kalman", "nobody"), "nobody"),
        (("--controllers", "kalman", "oracle", "vertex"), "two names"),
        (("--target", "zigzag"), "--target"),
        (("--distance-m", "0"), "--distance-m"),
        (("--engagements", "1", "--export", "film.html"), "engagements"),
        (("--json", "result.json"), "--export"),
        (("missing.json",), "missing.json"),
        (("missing.csv",), "missing.csv"),
        ((".",), "neither policy.json nor metadata.yaml"),
        (("--export", "."), "names a folder"),
    ],
)
def test_bad_input_is_refused_in_one_line(refused: Refused, words: tuple[str, ...], told: str) -> None:
    assert told in refused("view", *words)


@needs_viser
def test_a_policy_is_played_under_its_own_limit_alone(refused: Refused, records: Path) -> None:
    assert "--command-limit gate" in refused("view", records / "policy.json", "--command-limit", "box")


@needs_viser
def test_a_recording_holds_no_trial_to_export(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,yaw\n0,0\n0.1,0.2\n0.2,0.3\n")
    assert "holds none" in refused("view", "log.csv", "--export", "film.html")


def test_a_run_folder_tells_the_robot_that_its_policy_was_trained_for(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    assert view._trained_for(path) == SettingFiles()
    path.write_text(json.dumps({"setting": {"pitch": "p.json", "yaw": "y.json", "robot": "infantry"}}))
    assert view._trained_for(path) == SettingFiles(pitch=Path("p.json"), yaw=Path("y.json"), robot="infantry")


@needs_viser
def test_a_trial_of_a_run_folder_is_exported_whole_as_one_page(command: Command, records: Path) -> None:
    words: list[Any] = ["view", records, "--engagements", "2", "--export", "film.html", "--json", "trial.json"]
    status, out, err = command(*words)
    assert status == 0, err
    assert out == ""
    page = (records / "film.html").read_text()
    assert "__VISER_EMBED_DATA__" in page
    result = json.loads((records / "trial.json").read_text())
    assert (result["controller"], result["shots"]) == ("policy", 100)
    assert [path.name for path in records.glob(".*")] == []

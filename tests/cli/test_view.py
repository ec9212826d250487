import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from archerfish.cli import view
from archerfish.cli.setting import SettingFiles, overlaid, trained_for
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
        (("--export", "film.py"), "does not end in .html"),
    ],
)
def test_bad_input_is_refused_in_one_line(refused: Refused, words: tuple[str, ...], told: str) -> None:
    assert told in refused("view", *words)


@needs_viser
def test_what_is_built_in_is_not_looked_for_elsewhere(records: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "is_extension", lambda spec, kind: True)
    monkeypatch.setattr(view, "find_controller", None)
    assert view._own_controllers(("policy", "kalman", "policy"), {"policy"}) == {}
    assert view._own_motions("hand") == view._own_motions("parabola") == {}


@needs_viser
def test_two_controllers_of_one_name_are_refused(refused: Refused, tmp_path: Path) -> None:
    for name in ("one.py", "two.py"):
        (tmp_path / name).write_text("def aim(bench): pass\n")
    assert "two controllers 'aim'" in refused("view", "--controllers", "./one.py:aim", "./two.py:aim")
    (tmp_path / "three.py").write_text("def policy(bench): pass\n")
    assert "already have a controller 'policy'" in refused("view", "--controllers", "./three.py:policy")


@needs_viser
def test_an_own_controller_is_tried_before_anything_is_written(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "nan.py").write_text(
        "from archerfish.sensing.interfaces import fire_always\n"
        "import typing\n"
        "class Nan(typing.NamedTuple):\n"
        "    gain: float = float('nan')\n"
        "    def reset(self, seen, truth=None): return seen.angle\n"
        "    def step(self, state, seen): return state, fire_always(self.gain * seen.angle)\n"
        "def build(bench): return Nan()\n"
    )
    told = refused("view", "--controllers", "./nan.py:build", "--export", "film.html")
    assert "nan.py:build: step commands angle that are not finite" in told
    assert not (tmp_path / "film.html").exists()


@needs_viser
def test_an_own_motion_is_played_where_jax_is_not(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "examples" / "departure.py"
    words = ["view", "--target", f"{example}:Departure", "--engagements", "2", "--export", str(tmp_path / "film.html")]
    script = (
        "import sys, importlib.util\n"
        "find = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *rest: None if name == 'jax' else find(name, *rest)\n"
        "sys.modules['jax'] = None\n"
        "from archerfish.cli.main import program\n"
        f"sys.argv[1:] = {words!r}\n"
        "program()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "film.html").is_file()


@needs_viser
def test_a_policy_is_played_under_its_own_limit_alone(refused: Refused, records: Path) -> None:
    assert "--command-limit gate" in refused("view", records / "policy.json", "--command-limit", "box")


@needs_viser
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--controllers", "kalman"], "a recording is played as it is; leave out --controllers"),
        (["--target", "still", "--robot", "infantry"], "leave out --target, a robot's files"),
        (["--signals", "yaw"], "--signals takes ROLE=NAME, such as yaw=yaw, got 'yaw'"),
    ],
)
def test_what_says_nothing_to_a_recording_is_refused(refused: Refused, tmp_path: Path, words: list, told: str) -> None:
    (tmp_path / "log.csv").write_text("time_s,yaw\n0,0\n0.1,0.2\n0.2,0.3\n")
    assert told in refused("view", "log.csv", *words)


def test_options_come_on_top_of_what_a_policy_was_trained_for() -> None:
    begun = SettingFiles(pitch=Path("p.json"), yaw=Path("y.json"), muzzle=Path("m.json"), robot="infantry")
    assert overlaid(SettingFiles(), begun) == begun
    assert overlaid(SettingFiles(accept_unusable=True), begun) == replace(begun, accept_unusable=True)
    assert overlaid(SettingFiles(muzzle=Path("n.json")), begun) == replace(begun, muzzle=Path("n.json"))
    other = overlaid(SettingFiles(plant="folder"), begun)
    assert other == SettingFiles(plant="folder", muzzle=Path("m.json"), robot="infantry")


@needs_viser
def test_a_recording_holds_no_trial_to_export(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time_s,yaw\n0,0\n0.1,0.2\n0.2,0.3\n")
    assert "holds none" in refused("view", "log.csv", "--export", "film.html")


def test_a_run_folder_tells_the_robot_that_its_policy_was_trained_for(tmp_path: Path) -> None:
    policy, path = tmp_path / "policy.json", tmp_path / "config.json"
    assert trained_for(policy) == SettingFiles()
    path.write_text(json.dumps({"setting": {"pitch": "p.json", "yaw": "y.json", "robot": "infantry"}}))
    assert trained_for(policy) == SettingFiles(pitch=Path("p.json"), yaw=Path("y.json"), robot="infantry")


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
    assert [path.name for path in records.glob(".*")] == [".archerfish.json"]

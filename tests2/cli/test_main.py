"""The command line as a whole: run.json, names that there are not, terminals, the overview."""

import importlib
import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish2.cli.main import COMMANDS, main
from archerfish2.cli.options import ForRobot
from archerfish2.robot import Robot


def test_run_json_has_the_options_that_main_was_given(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["pytest", "-q", "tests2"])  # a program that calls main with words of its own
    rows = [f"{pitch},{1.5 + 0.2 * pitch + 0.01 * k},{18 + 0.02 * k}" for pitch in (-3, 0, 3) for k in range(5)]
    (tmp_path / "my shots.csv").write_text("\n".join(["pitch_deg,distance_m,speed_m_s", *rows]))
    options = [str(tmp_path / "my shots.csv"), "--height-m", "0.4", "--out", str(tmp_path / "out")]
    main(["identify", "muzzle", *options])
    run = json.loads((tmp_path / "out" / "run.json").read_text())["identify muzzle"]
    assert shlex.split(run["options"]) == options


def test_paper_is_the_paper_s_robot_and_a_path_is_a_folder():
    for name in (None, "paper"):
        given = ForRobot(robot=name)
        assert (given.folder, given.robot_and_task()[0].name) == (None, "paper")
    assert ForRobot(robot="./paper").folder == Path("paper")


@pytest.mark.parametrize("encoding", ["ascii", "gbk", "cp1252"])
def test_a_terminal_of_another_encoding_gets_no_traceback(encoding):
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    for arguments, status in ((["record", "--help"], 0), (["evaluate", "--task", "σ²"], 2)):
        command = [sys.executable, "-m", "archerfish2", *arguments]
        ended = subprocess.run(command, capture_output=True, env=environment, check=False)
        assert (ended.returncode, b"Traceback" in ended.stderr) == (status, False)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("trian", "train"),
        ("evaluate --engagementss 3", "--engagements"),
        ("evaluate --task strafee", "strafe"),
        ("evaluate --controllers kalmn", "kalman"),
        ("evaluate --set lengthss=3", "lengths_s"),
        ("record infantri", "infantry"),
        ("train --observation multimodle", "multimodel"),
        ("train --reward smoothhit", "smooth-hit"),
        ("train --set gradient.hiden=3", "hidden"),
        ("train --set trainer=ppoo", "ppo"),
        ("train mine", "mine-2"),
    ],
)
def test_the_nearest_name_is_suggested_for_one_that_there_is_not(words, name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Robot.paper().save("mine-2")
    with pytest.raises(SystemExit, match="2"):
        main(words.split())
    assert f"perhaps you meant {name}" in capsys.readouterr().err


def test_the_overview_has_the_first_line_of_every_command(capsys):
    main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, (module, options) in COMMANDS.items():
        first = getattr(importlib.import_module(module), options).__doc__.splitlines()[0]
        assert f"  {name:<17} {first}" in lines

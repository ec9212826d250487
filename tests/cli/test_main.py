"""The command line as a whole: run.json, names that there are not, terminals, the overview."""

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from archerfish.cli.main import COMMANDS, main
from archerfish.cli.options import ForRobot
from archerfish.controllers.policy.blocks import OBSERVATIONS
from archerfish.controllers.registry import NAMES
from archerfish.robot import Robot
from archerfish.task import DRAWN, EQ_7

FAULTS = {
    "evaluate --controllers kalmn": "archerfish: controller must be one of kalman, ",
    "evaluate --task papr": "archerfish: papr: field motion: expected one of paper, static, ",
    "evaluate --nonsense 1": "archerfish: Unrecognized options: --nonsense 1; archerfish evaluate --help explains",
    "evaluate --set period_s": "archerfish: --set takes NAME=VALUE, ",
    "evaluate --set lenght_s=1": "archerfish: Task: there is no field lenght_s; perhaps you meant lengths_s",
    "evaluate --engagements four": "invalid literal for int() with base 10: 'four'; ",
    "train --set gradient.hiden=3": "GradientConfig: there is no field hiden; perhaps you meant hidden",
    "train --set hidden": "--set takes NAME=VALUE, and no value for a part and for a field of it, got hidden",
    "train --set ppo=3 ppo.epochs=2": "got ppo.epochs=2; write for instance",
    "train --set ppo.epochs=2 ppo=3": "got ppo=3; write for instance",
    "train --set hidden=3": "there is no field hidden",
    "train --set ppo.epochs=2": "--set ppo.epochs=2 is not of the trainer gradient",
    "train --reward nearest": "reward must be one of eq-8, hit, smooth-hit",
    "train --observation six": "observation must be one of paper, history, tracked, multimodel, got 'six'",
    "train --observation tracked": "observation tracked needs a robot with sensing.json",
    "train --steps 0": "steps must be a whole number of 1 to 2^53, got 0",
    "train --resume none": "none: has no training",
    "train --trainer pp": "invalid choice",
}


@pytest.mark.parametrize("words", FAULTS)
def test_a_fault_ends_with_one_line_and_status_2(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(words.split())
    assert FAULTS[words] in (message := capsys.readouterr().err)
    assert (message.count("\n"), [*tmp_path.iterdir()]) == (1, [])


NAMED = {"evaluate": {*NAMES, "perfect", *EQ_7, *DRAWN}, "train": {*OBSERVATIONS, "eq-8", "smooth-hit", "ppo"}}


@pytest.mark.parametrize("command", NAMED)
def test_help_names_every_choice(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert NAMED[command] <= {*re.split("[ ,:(\n]", capsys.readouterr().out)}


def test_run_json_has_the_options_that_main_was_given(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["pytest", "-q", "tests"])  # a program that calls main with words of its own
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
        command = [sys.executable, "-m", "archerfish", *arguments]
        ended = subprocess.run(command, capture_output=True, env=environment, check=False)
        assert (ended.returncode, b"Traceback" in ended.stderr) == (status, False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
def test_a_full_disk_under_the_output_is_named_in_one_line():
    command = [sys.executable, "-m", "archerfish", "--help"]
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert (ended.returncode, ended.stderr.count(b"\n"), b"no space left" in ended.stderr) == (2, 1, True)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("trian", "train"),
        ("evaluate --engagementss 3", "--engagements"),
        ("evaluate --task strafee", "strafe"),
        ("record infantri", "infantry"),
        ("train --observation multimodle", "multimodel"),
        ("train --reward smoothhit", "smooth-hit"),
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

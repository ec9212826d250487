"""The command train: from a robot's folder to a policy that is evaluated beside the others."""

import pytest

import archerfish2 as af
from archerfish2.cli.main import main
from archerfish2.controllers.blocks import KINDS

pytest.importorskip("jax")
SMALL = "gradient.environments=32 gradient.hidden=16 gradient.window=5"
FAULTS = {
    "--set gradient.hiden=3": "field gradient: object contains unknown field hiden",
    "--set hidden": "--set takes NAME=VALUE, got hidden",
    "--reward nearest": "reward must be one of eq-8, hit, smooth-hit",
    "--observation six": "observation must be one of paper, history, tracked, multimodel, got 'six'",
    "--observation tracked": "observation tracked needs a robot with sensing.json",
    "--steps 0": "steps: expected int >= 1, got 0",
    "--resume none": "none: has no training",
    "--resume none --seed 3": "the training's own settings; leave seed out",
    "--set hidden=3": "there is no field hidden",
    "--set ppo.epochs=2": "--set ppo.epochs=2 is not of the trainer gradient",
}


def test_a_policy_is_trained_for_a_robot_and_evaluated_with_it(tmp_path, capsys, monkeypatch):
    robot = tmp_path / "mine"
    af.Robot.paper().save(robot)
    main(["train", str(robot), *f"--task static --steps 640 --seed 3 --set {SMALL}".split()])
    assert f"archerfish2 evaluate {robot} --controllers {robot}/policy kalman" in capsys.readouterr().out
    own = []
    monkeypatch.setattr(
        "archerfish2.cli.evaluate.evaluate", lambda controllers, *_, **__: own.extend(controllers) or 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        main(["evaluate", str(robot)])
    assert own == [str(robot / "policy"), "kalman", "kalman-lq", "oracle"]
    (cell, *_) = af.evaluate(own[0], robot, "static", engagements=4).cells
    assert (cell.controller, cell.kind, cell.seed) == ("policy", "policy", 3)


@pytest.mark.parametrize("words", FAULTS)
def test_a_fault_ends_with_one_line_and_status_2(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(["train", "--task", "paper", *words.split()])
    assert FAULTS[words] in (message := capsys.readouterr().err)
    assert (message.count("\n"), [*tmp_path.iterdir()]) == (1, [])


def test_help_names_every_observation_and_reward(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["train", "--help"])
    words = {*capsys.readouterr().out.replace(",", " ").replace("(", " ").split()}
    assert {*KINDS, "eq-8", "hit", "smooth-hit", "gradient", "ppo"} <= words

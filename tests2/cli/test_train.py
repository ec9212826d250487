"""The command train: from a robot's folder to a policy that is evaluated beside the others."""

import pytest

import archerfish2 as af
from archerfish2.cli.main import main
from archerfish2.controllers.policy.blocks import OBSERVATIONS

pytest.importorskip("jax")
SMALL = "gradient.environments=32 gradient.hidden=16 gradient.window=5"
FAULTS = {
    "--set gradient.hiden=3": "GradientConfig: there is no field hiden; perhaps you meant hidden",
    "--set hidden": "--set takes NAME=VALUE, and no value for a part and for a field of it, got hidden",
    "--set ppo=3 ppo.epochs=2": "got ppo.epochs=2; write for instance",
    "--reward nearest": "reward must be one of eq-8, hit, smooth-hit",
    "--observation six": "observation must be one of paper, history, tracked, multimodel, got 'six'",
    "--observation tracked": "observation tracked needs a robot with sensing.json",
    "--steps 0": "steps must be a whole number of 1 to 2^53, got 0",
    "--resume none": "none: has no training",
    "--trainer pp": "invalid choice",
    "--set ppo.epochs=2 ppo=3": "got ppo=3; write for instance",
    "--set hidden=3": "there is no field hidden",
    "--set ppo.epochs=2": "--set ppo.epochs=2 is not of the trainer gradient",
}


def test_a_policy_is_trained_for_a_robot_and_evaluated_with_it(tmp_path, capsys, monkeypatch):
    robot, policy = tmp_path / "mine", tmp_path / "mine" / "policy"
    af.Robot.paper().save(robot)
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr("archerfish2.learning.train._run", lambda *_: 1 / 0)
        main(["train", str(robot), *f"--task static --command-limit box --steps 600 --seed 3 --set {SMALL}".split()])
    # 600 are rounded to 4 iterations of 32 environments and 5 decisions.
    begun = "training for paper, task static: gradient, observation history, 640 decisions; progress: "
    assert capsys.readouterr().out == f"{begun}{policy}/log.jsonl\n"
    for option in ("--steps 10", "--seed 0", "--out no", "--set frames=5", "--trainer ppo", str(robot)):
        with pytest.raises(SystemExit, match="2"):
            main(["train", "--resume", str(policy), *option.split()])
        name = option.split()[0] if option.startswith("--") else "--robot"
        assert f"leave {name} out, or begin another training" in capsys.readouterr().err
    main(["train", "--resume", str(policy)])
    first, *_, last = capsys.readouterr().out.splitlines()
    words = f"evaluate {robot} --controllers {policy} kalman --task static --command-limit box"
    assert (first, last) == (f"{begun}{policy}/log.jsonl", f"next: archerfish2 {words}")
    calls = []
    monkeypatch.setattr("archerfish2.cli.evaluate.evaluate", lambda *given, **_: calls.append(given) or 1 / 0)
    for line in (words, f"evaluate {robot}"):
        with pytest.raises(ZeroDivisionError):
            main(line.split())
    assert (calls[0][0], calls[0][1].folder, calls[0][2].command_limit) == ((str(policy), "kalman"), robot, "box")
    assert calls[1][0] == (str(policy), "kalman", "kalman-lq", "oracle")
    (cell, *_) = af.evaluate(str(policy), robot, calls[0][2], engagements=4).cells
    assert (cell.controller, cell.kind, cell.seed) == ("policy", "policy", 3)


def test_parts_that_are_not_usable_are_trained_for_if_that_is_accepted(tmp_path, capsys, monkeypatch):
    af.Robot.paper().replace(parts={"yaw": {"usable": False, "headline": "drifts"}}).save(tmp_path)
    monkeypatch.setattr("archerfish2.cli.train.train", lambda *_, **__: 1 / 0)
    with pytest.raises(SystemExit, match="2"):
        main(["train", str(tmp_path)])
    assert "drifts" in capsys.readouterr().err
    with pytest.raises(ZeroDivisionError):
        main(["train", str(tmp_path), "--accept-unusable"])


def test_a_task_of_a_file_is_named_by_its_file(tmp_path, capsys, monkeypatch):
    af.Task.load("static").replace(name="far", ranges_m=((4.0, 5.0),)).save(tmp_path / "far.toml")
    monkeypatch.chdir(tmp_path)
    main(["train", *f"--task far.toml --steps 640 --set {SMALL}".split()])
    line = capsys.readouterr().out.splitlines()[-1]
    assert line == "next: archerfish2 evaluate --controllers runs/train kalman --task far.toml"


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
    assert {*OBSERVATIONS, "eq-8", "hit", "smooth-hit", "gradient", "ppo"} <= words

"""The command train: from a robot's folder to a policy that is evaluated beside the others."""

import pytest

import archerfish as af
from archerfish.cli.main import main

pytest.importorskip("jax")
SMALL = "gradient.environments=32 gradient.hidden=16 gradient.window=5"


def test_a_policy_is_trained_for_a_robot_and_evaluated_with_it(tmp_path, capsys, monkeypatch):
    robot, policy = tmp_path / "mine", tmp_path / "mine" / "policy"
    af.Robot.paper().save(robot)
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr("archerfish.learning.train._run", lambda *_: 1 / 0)
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
    assert (first, last) == (f"{begun}{policy}/log.jsonl", f"next: archerfish {words}")
    calls = []
    monkeypatch.setattr("archerfish.cli.evaluate.evaluate", lambda *given, **_: calls.append(given) or 1 / 0)
    for line in (words, f"evaluate {robot}"):
        with pytest.raises(ZeroDivisionError):
            main(line.split())
    assert (calls[0][0], calls[0][1].folder, calls[0][2].command_limit) == ((str(policy), "kalman"), robot, "box")
    assert calls[1][0] == (str(policy), "kalman", "kalman-lq", "oracle")
    (cell, *_) = af.evaluate(str(policy), robot, calls[0][2], engagements=4).cells
    assert (cell.controller, cell.kind, cell.seed) == ("policy", "policy", 3)


def test_a_task_of_a_file_is_named_by_its_file(tmp_path, capsys, monkeypatch):
    af.Task.load("static").replace(name="far", ranges_m=((4.0, 5.0),)).save(tmp_path / "far.toml")
    monkeypatch.chdir(tmp_path)
    main(["train", *f"--task far.toml --steps 640 --set {SMALL}".split()])
    line = capsys.readouterr().out.splitlines()[-1]
    assert line == "next: archerfish evaluate --controllers runs/train kalman --task far.toml"

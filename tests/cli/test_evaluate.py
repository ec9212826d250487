"""The command evaluate: what it writes and prints, and how it ends."""

import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import pytest

import archerfish as af
from archerfish.cli.main import main
from archerfish.cli.signals import stop_requests

# What a shell runs in its background ignores SIGINT, and so would what that starts.
CODE = "from signal import *; signal(SIGINT, default_int_handler); from archerfish.cli.main import *; program()"


def start(engagements, out):
    words = f"evaluate --task paper --controllers kalman no-lead --engagements {engagements} --out {out}".split()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", CODE, *words], cwd=Path(__file__).parents[2] / "src", **pipes)


def test_it_writes_and_prints_every_figure(tmp_path):
    printed, faults = start(4, tmp_path).communicate(timeout=120)
    assert all(line.startswith(("tuning: ", "evaluating: ")) for line in faults.splitlines())
    assert "Table III, dynamic targets: paper, limit gate" in printed
    assert {each.name for each in tmp_path.iterdir()} == {"results.json", "report.html", "run.json", "run.lock"}
    assert all(f"{100 * each.rate:.1f} (" in printed for each in af.Results.load(tmp_path).cells)


def test_an_interrupt_leaves_nothing(tmp_path):
    process = start(100_000, tmp_path / "out")
    while process.poll() is None and not [*tmp_path.glob("out/.unfinished-*")]:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[1].endswith("archerfish: interrupted\n")
    assert (process.returncode, [*tmp_path.iterdir()]) == (130, [])


def test_a_signal_that_a_destructor_drops_comes_again():
    # A program that a shell starts in its background ignores SIGINT; SIGTERM it gets.
    drops = type("Drops", (), {"__del__": lambda _: signal.raise_signal(signal.SIGTERM)})
    with pytest.raises(KeyboardInterrupt), stop_requests():
        drops()
        time.sleep(30)


@pytest.fixture
def called(monkeypatch):
    """The evaluation, which ends the command when it is called."""
    evaluate = Mock(side_effect=af.InputError("it was called"))
    monkeypatch.setattr("archerfish.cli.evaluate.evaluate", evaluate)

    def run(*words):
        with pytest.raises(SystemExit, match="2"):
            main(["evaluate", *map(str, words)])
        return evaluate.call_args

    return run


def test_every_option_reaches_the_evaluation(tmp_path, called):
    af.Robot.paper().replace(parts={"yaw": {"usable": False, "headline": "drifts"}}).save(tmp_path)
    words = f"{tmp_path} --task static --command-limit box --world ./w.py:W --engagements 7 --seed 3".split()
    words += ["--out", str(tmp_path / "out"), "--controllers", "no-lead", "--tuning", "start"]
    assert called(*words) is None
    (controllers, robot, task), more = called(*words, "--accept-unusable")
    assert (controllers, robot.name, task.name, task.command_limit) == (("no-lead",), "paper", "static", "box")
    assert more == {"world": "./w.py:W", "engagements": 7, "seed": 3, "tuning": "start"}


def test_fields_of_the_task_are_changed(called):
    (_, robot, task), _ = called("paper", "--task", "paper", "--set", "max_speed_m_s=1", "lengths_s=[3]")
    assert task == af.Task.load("paper").replace(max_speed_m_s=1.0, lengths_s=(3.0,))
    assert robot.digest() == af.Robot.paper().digest()


def test_a_task_file_has_the_motion_of_the_command_line(tmp_path, called):
    motion = f"{Path(__file__).parents[2]}/examples/departure.py:departure"
    af.Task(motion=motion, lengths_s=(3.0,)).save(tmp_path / "task.toml")
    (_, _, task), _ = called("--task", tmp_path / "task.toml", "--motion", motion)
    assert (task.motion, task.lengths) == (motion, (3.0,))


def test_the_settings_for_another_task_are_taken(monkeypatch, called):
    monkeypatch.setattr("archerfish.cli.evaluate.tune", lambda *given: given)
    words = "--task strafe --tuning any --command-limit box --controllers kalman no-lead"
    _, more = called(*words.split())
    ((name, tuned),) = more["tuning"].items()
    assert (name, tuned[0], tuned[2]) == ("kalman", "kalman", af.Task(command_limit="box"))


@pytest.fixture
def folder(monkeypatch, called):
    """Return the folder that is taken where none is given."""
    taken = Mock(side_effect=af.InputError("it was called"))
    monkeypatch.setattr("archerfish.storage.output_folder", taken)
    return lambda *words: (called(*words), taken.call_args[0][0])[1]


FOLDERS = {
    "": "evaluation",
    "--command-limit gate": "evaluation",
    "--task paper": "evaluation/paper",
    "--task paper --command-limit box --set period_s=0.04": "evaluation/paper-period_s=0.04-command_limit=box",
    "--task paper --tuning start": "evaluation/paper-tuning=start",
}


@pytest.mark.parametrize("words", FOLDERS)
def test_other_conditions_have_another_folder(words, tmp_path, folder):
    af.Robot.paper().save(tmp_path)
    assert folder(tmp_path, *words.split()) == tmp_path / FOLDERS[words]


def test_code_of_one_name_from_two_files_has_two_folders(tmp_path, folder):
    af.Task.load("paper").save(tmp_path / "...toml")
    given = ("--world", "./w.py:W"), ("--world", "./v.py:W"), ("--task", tmp_path / "...toml")
    found = [folder(*words) for words in given]
    assert len(set(found)) == 3
    assert all(path.parent == Path("runs/evaluate") for path in found)


def test_an_unfinished_policy_of_the_robot_is_named(tmp_path, called, capsys):
    af.Robot.paper().save(tmp_path)
    (tmp_path / "policy").mkdir()
    (tmp_path / "policy" / "checkpoint.safetensors").write_text("")
    assert called(tmp_path)[0][0] == ("kalman", "kalman-lq", "oracle")
    said = f"not finished and left out; continue it: archerfish train --resume {tmp_path}/policy\n"
    assert said in capsys.readouterr().err

"""The command line as a whole: what run.json says of a command."""

import json
import shlex
from pathlib import Path

from archerfish2.cli.main import main
from archerfish2.cli.options import ForRobot


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

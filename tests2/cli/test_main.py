"""The command line as a whole: what run.json says of a command."""

import json
import shlex

from archerfish2.cli.main import main


def test_run_json_has_the_options_that_main_was_given(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["pytest", "-q", "tests2"])  # a program that calls main with words of its own
    rows = [f"{pitch},{1.5 + 0.2 * pitch + 0.01 * k},{18 + 0.02 * k}" for pitch in (-3, 0, 3) for k in range(5)]
    (tmp_path / "my shots.csv").write_text("\n".join(["pitch_deg,distance_m,speed_m_s", *rows]))
    options = [str(tmp_path / "my shots.csv"), "--height-m", "0.4", "--out", str(tmp_path / "out")]
    main(["identify", "muzzle", *options])
    run = json.loads((tmp_path / "out" / "run.json").read_text())["identify muzzle"]
    assert shlex.split(run["options"]) == options

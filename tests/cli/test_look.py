"""The command that shows what is in a log, and the logs.toml that it writes of a folder."""

import re
import tomllib

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.identification.robot_files import axis_logs, read_axis, read_folder
from archerfish.logs.look import log_report, names_to_fill_in

TIME = np.arange(500) / 200
COLUMNS = {"cmd": 20 * np.sign(np.sin(7 * TIME)), "ang": 18 * np.sin(7 * TIME), "ecd": np.arange(500) * 16 % 8192}
KNOWN = {  # file: signals, their least and largest rate [Hz]
    "cases/time_us.csv": (2, 100, 100),
    "cases/encoder_wrap.csv": (2, 200, 200),
    "cases_2/struct.mat": (2, 100, 100),
    "cases_2/lines.jsonl": (2, 100, 100),
    "cases_2/time_of_day.csv": (2, 100, 100),
    "cases_2/boot_and_wall_clock": (2, 100, 100),
    "cases_2/imu_orientation": (12, 100, 100),
    "cases_2/latency_under_load/plate.csv": (4, 59, 61),
    "identification/ball_and_hoop/closedLoop.mat": (3, 10, 10),
    "identification/quarter_drone/dados_14_drone.csv": (3, 100, 100),
}


def write(path, names, *columns, form="%.6g"):
    np.savetxt(path, np.column_stack(columns), form, ",", header=names, comments="", encoding="utf-8")


@pytest.mark.parametrize("name", KNOWN)
def test_signals_of_recorded_logs_have_their_rates(name, shared):
    pytest.importorskip("rosbags" if name.endswith(("clock", "orientation")) else "numpy")
    count, low, high = KNOWN[name]
    (table,) = log_report(shared(f"data/{name}")).tables
    assert len(table.rows) == count
    assert all(low - 0.1 <= row[3] <= high + 0.1 for row in table.rows)


def test_units_gaps_and_repeats_are_shown_and_what_to_type_next(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write("a log.csv", "stamp_ms,cmd,ang,ecd", 1e3 * (TIME + (TIME > 1)), *COLUMNS.values())
    main(["look", "a log.csv"])
    printed = re.sub(" +", " ", capsys.readouterr().out.replace("−", "-"))
    assert "cmd deg? 500 200.0 3.495 -20.00 20.00 1" in printed
    assert "ecd counts? 500 200.0 3.495 0 7984 1 0" in printed
    command = "archerfish identify axis 'a log.csv' --input=cmd --output=ang --time=stamp_ms"
    assert f"{command} --input-unit=deg --output-unit=deg" in re.sub(r"\s+", " ", printed)
    assert "<svg" in (tmp_path / "runs/look/look.html").read_text()


def test_both_axes_of_one_file_and_its_shots_are_named(tmp_path):
    names = "t_s,pitch_cmd,pitch_ang,yaw_cmd,yaw_ang"
    write(tmp_path / "a.csv", names, TIME, *[COLUMNS["cmd"], COLUMNS["ang"]] * 2)
    write(tmp_path / "pellets.csv", "pitch_deg,distance_m", [1, 2, 3], [2.0, 2.1, 2.5])
    text = names_to_fill_in(tmp_path)
    assert '# shots = ["pellets.csv"]' in text
    found = tomllib.loads(text)
    assert [found[axis]["input"] for axis in ("pitch", "yaw")] == ["pitch_cmd", "yaw_cmd"]
    steps = log_report(tmp_path / "a.csv").next_steps
    assert ["--output=pitch_ang" in steps[0], "--output=yaw_ang" in steps[1]] == [True, True]


def test_a_logs_toml_with_guessed_names_reads_the_logs_of_a_folder(tmp_path, refused):
    logs, out = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    refused("has no file with a command and an angle", names_to_fill_in, logs)
    write(logs / "a.csv", "t_s,cmd,ang", TIME, COLUMNS["cmd"], COLUMNS["ang"])
    write(logs / "b.csv", "stamp_us,ziel_set,winkel", 1e6 * TIME, COLUMNS["cmd"], COLUMNS["ang"], form="%.9g")
    write(logs / "pitch.csv", "t_s,cmd,ang", TIME, COLUMNS["cmd"] / 60, COLUMNS["ang"] / 60)
    main(["look", str(logs), "--out", str(out)])
    text = (out / "logs.toml").read_text()
    (logs / "logs.toml").write_text(text)
    assert '\n# [muzzle]\n# shots = ["shots.csv"]\n' in text
    assert tomllib.loads(text)["yaw"]["files"] == {
        "b.csv": {"time": "stamp_us", "input": "ziel_set", "output": "winkel"}
    }
    settings = read_folder(logs)
    for axis, names in (("yaw", ["a.csv", "b.csv"]), ("pitch", ["pitch.csv"])):
        fitted, _ = axis_logs(logs, axis, settings.axis(axis))
        assert [path.name for path in fitted] == names
        for path in fitted:
            (recording,) = read_axis(path, settings.axis(axis)).recordings
            scale = 1 / 60 if axis == "pitch" else np.radians(1)
            np.testing.assert_allclose(recording.outputs[:, 0], scale * COLUMNS["ang"], rtol=1e-4, atol=1e-6)

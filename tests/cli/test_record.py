import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from archerfish.cli.main import main
from archerfish.cli.parsing import parse
from archerfish.cli.record import Record, run_record
from archerfish.records.csv_table import read_csv_columns
from archerfish.records.errors import InputError
from archerfish.records.limits import read_limits
from archerfish.records.recording import read_recording_csv
from archerfish.records.sensing_logs import read_detections_csv, read_gimbal_log_csv, read_target_steps_csv
from archerfish.virtual_robot import gimbal_physics
from archerfish.virtual_robot.gimbal_physics import mujoco_installed

SHORT = ("--duration-s", "2", "--physics", "linear")


@pytest.fixture
def console() -> Console:
    return Console(record=True, width=100)


def recorded(out: Path, console: Console, *words: str) -> dict[str, Any]:
    return run_record(parse(Record, "archerfish record", [*words, "--out", str(out)]), console)


def test_a_sweep_is_logged_with_the_commands_in_force(tmp_path: Path, console: Console) -> None:
    summary = recorded(tmp_path, console, "sweep", "--axis", "pitch", "--centre-deg", "-5", *SHORT)
    assert {path.name for path in tmp_path.iterdir()} == {
        ".archerfish.json",
        "pitch_sweep.csv",
        "pitch_sweep_validation.csv",
        "limits.json",
    }
    log = read_recording_csv(tmp_path / "pitch_sweep.csv", "time_s", ["u"], ["y", "rate"])
    assert log.sample_period_s == pytest.approx(1e-3)
    assert np.degrees(log.inputs.max() + np.radians(5)) == pytest.approx(1.0, abs=0.01)
    assert np.degrees(log.inputs[0]) == pytest.approx(-5.0)
    assert np.degrees(log.outputs[0, 0]) == pytest.approx(-5.0 * 1.03, abs=0.05)
    # At 2 Hz the axis follows.
    early = slice(500, 600)
    assert np.corrcoef(log.inputs[early, 0], log.outputs[early, 0])[0, 1] > 0.9
    held = read_recording_csv(tmp_path / "pitch_sweep_validation.csv", "time_s", ["u"], ["y"])
    assert not np.allclose(held.inputs, log.inputs)
    assert read_limits(tmp_path / "limits.json").pitch.low == pytest.approx(np.radians(-25))
    assert summary["files"][0].endswith("pitch_sweep.csv")
    json.dumps(summary)


def test_the_same_seed_gives_the_same_log_and_another_one_another(tmp_path: Path, console: Console) -> None:
    texts = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        recorded(tmp_path / name, console, "step", "--hold-s", "0.2", "--seed", seed, "--no-validation", *SHORT)
        assert {path.name for path in (tmp_path / name).iterdir()} == {
            ".archerfish.json",
            "yaw_step.csv",
            "limits.json",
        }
        texts.append((tmp_path / name / "yaw_step.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


def test_over_the_link_commands_come_as_the_robot_received_them(tmp_path: Path, console: Console) -> None:
    recorded(tmp_path, console, "step", "--play", "link", "--hold-s", "0.3", "--no-validation", *SHORT)
    log = read_recording_csv(tmp_path / "yaw_step.csv", "time_s", ["u"], ["y"])
    first = log.time[np.flatnonzero(log.inputs[:, 0])[0]]
    assert 0.5 + 0.005 <= first <= 0.5 + 0.016
    # The wire rounds to a tenth of a degree.
    assert np.degrees(log.inputs).max() == pytest.approx(2.0)
    np.testing.assert_allclose(10 * np.degrees(log.inputs), np.rint(10 * np.degrees(log.inputs)), atol=1e-6)


def test_a_host_logs_what_it_sent_at_its_own_rate(tmp_path: Path, console: Console) -> None:
    recorded(tmp_path, console, "step", "--stamps", "host", "--hold-s", "0.3", "--no-validation", *SHORT)
    log = read_recording_csv(tmp_path / "yaw_step.csv", "time_s", ["u"], ["y"])
    assert log.sample_period_s == pytest.approx(5e-3)
    assert log.time[np.flatnonzero(log.inputs[:, 0])[0]] == pytest.approx(0.5)


def test_a_file_of_commands_is_played(tmp_path: Path, console: Console) -> None:
    commands = tmp_path / "pitch_prbs_command.csv"
    commands.write_text("time_s,u\n" + "".join(f"{0.05 * k},{0.01 * (k % 2)}\n" for k in range(21)))
    recorded(tmp_path / "out", console, "sweep", "--axis", "pitch", "--commands", str(commands), *SHORT)
    log = read_csv_columns(tmp_path / "out" / "pitch_prbs.csv", ["time_s", "u", "y", "rate"]).columns
    assert set(np.round(log["u"], 6)) == {0.0, 0.01}
    assert log["u"][60] == 0.01
    assert log["u"][110] == 0.0


def test_timing_writes_what_identify_sensing_reads(tmp_path: Path, console: Console) -> None:
    recorded(tmp_path, console, "timing", "--count", "4", *SHORT)
    for name in ("timing_sweep.csv", "timing_steps.csv"):
        log = read_gimbal_log_csv(tmp_path / name)
        assert log.command is not None
        assert np.ptp(log.yaw) > np.radians(5)
    plate, target = (read_detections_csv(tmp_path / f"timing_{name}.csv") for name in ("plate", "target"))
    assert plate.receive is not None
    np.testing.assert_allclose(np.median(plate.receive - plate.time), 0.035 + 0.0065, atol=2e-3)
    moments = read_target_steps_csv(tmp_path / "timing_moments.csv")
    assert moments.size == 4
    assert target.time[0] < moments[0] - 0.5
    assert np.ptp(target.position[:, 1]) == pytest.approx(0.3, abs=0.05)


def test_a_host_that_stamps_receipts_has_rising_stamps(tmp_path: Path, console: Console) -> None:
    recorded(tmp_path, console, "timing", "--stamps", "host", "--count", "1", *SHORT)
    assert np.all(np.diff(read_gimbal_log_csv(tmp_path / "timing_sweep.csv").time) > 0)


def test_without_mujoco_the_stand_in_is_announced(
    tmp_path: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gimbal_physics, "mujoco_installed", lambda: False)
    recorded(tmp_path, console, "step", "--hold-s", "0.1", "--no-validation")
    assert "MuJoCo 4 is not installed" in console.export_text()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["sweep", "--robot", "infantri"], "no robot 'infantri'; known are infantry, worn"),
        (["sweep", "--duration-s", "0"], "--duration-s must be > 0, got 0"),
        (["sweep", "--low-hz", "60"], "--low-hz must be below --high-hz, got 60 and 50"),
        (["sweep", "--high-hz", "600"], "--high-hz must be at most 500"),
        (["sweep", "--axis", "pitch", "--centre-deg", "9.5"], "the pitch 10.5° is beyond the limits of infantry"),
        (["step", "--amplitude-deg", "80"], "the yaw -80° is beyond the limits"),
        (["step", "--play", "inject", "--stamps", "host"], "--play inject: a host does not know"),
        (["timing", "--play", "inject"], "--play inject: timing measures the link"),
        (["timing", "--amplitude-deg", "80"], "timing turns the yaw by ±80°"),
        (["timing", "--count", "0"], "timing.steps must be at least 1, got 0"),
        (["timing", "--commands", "x.csv"], "--commands plays a sweep or steps"),
        (["sweep", "--commands", "absent.csv"], "absent.csv: no such file"),
    ],
)
def test_what_cannot_be_recorded_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], complaint: str
) -> None:
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as ended:
        main(["record", *words, "--physics", "linear", "--out", str(out)])
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err
    assert not out.exists()


def test_disordered_commands_are_refused(tmp_path: Path, console: Console) -> None:
    path = tmp_path / "commands.csv"
    path.write_text("time_s,u\n0,0\n0.1,0.01\n0.1,0\n")
    with pytest.raises(InputError, match=re.escape("commands.csv: line 4: time does not increase")):
        recorded(tmp_path / "out", console, "sweep", "--commands", str(path), *SHORT)


@pytest.mark.skipif(not mujoco_installed(), reason="needs MuJoCo 4")
def test_the_infantry_robot_is_identified_from_its_logs(tmp_path: Path) -> None:
    """Recorded, then identified: the held-back sweep is foretold and the steady gain of 1.03 is found."""
    for kind in ("sweep", "step"):
        main(["record", kind, "--axis", "pitch", "--duration-s", "3", "--hold-s", "1.5", "--out", str(tmp_path)])
    logs = [str(tmp_path / f"pitch_{kind}.csv") for kind in ("sweep", "step")]
    words = ["identify", "gimbal", *logs, "--validate", str(tmp_path / "pitch_sweep_validation.csv")]
    main([*words, "--axis", "pitch", "--out", str(tmp_path), "--json", str(tmp_path / "found.json")])
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["validation"][0]["fit_percent"] > 90
    assert found["dc_gain"][0] == pytest.approx(1.03, rel=0.01)

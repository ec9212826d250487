"""The logs of a virtual robot: one folder, which an identification reads."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.cli.record import RecordRobot
from archerfish2.identification.sensing.identify import identify_sensing
from archerfish2.records.limits import LimitsRecord
from archerfish2.virtual_robot.record import PARTS
from archerfish2.virtual_robot.recorder import chirp, steps
from archerfish2.virtual_robot.virtual_robot import VirtualRobot

LAB = Path(__file__).parents[3] / "shared" / "second_edition" / "reference" / "infantry_logs"


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    return VirtualRobot.load("infantry").record(tmp_path_factory.mktemp("record") / "logs", parts=["shots"])


def test_a_recording_is_complete_and_says_what_it_holds(shots):
    names = {path.name for path in shots.iterdir()} - {"run.lock"}
    assert names == {"shots.csv", "limits.json", "tape.json", "robot.toml", "run.json"}
    assert json.loads((shots / "tape.json").read_text()) == {"muzzle_length_m": 0.16, "muzzle_height_m": 0.45}
    assert_allclose(LimitsRecord.load(shots / "limits.json").yaw.max_acceleration, 60.0)
    run = json.loads((shots / "run.json").read_text())["record"]
    assert (run["robot"], run["seed"], run["parts"]) == ("infantry", 0, ["shots"])
    columns = np.genfromtxt(shots / "shots.csv", delimiter=",", names=True)
    assert len(columns) == 4 * (5 + 50)
    assert np.ptp(columns["speed_m_s"][columns["burst"] == 0]) < 1.5
    assert columns["speed_m_s"][columns["burst"] == 1][-20:].mean() < columns["speed_m_s"][columns["burst"] == 0].mean()


@pytest.mark.skipif(not LAB.is_dir(), reason="the shared logs are not there")
def test_shots_are_those_of_the_first_edition_to_the_byte(shots):
    assert (shots / "shots.csv").read_bytes() == (LAB / "shots.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(not LAB.is_dir(), reason="the shared logs are not there")
def test_all_logs_are_those_of_the_first_edition_to_the_byte(tmp_path):
    logs = VirtualRobot.load("infantry").record(tmp_path / "logs")
    expected = {path.name for path in LAB.glob("*.csv")}
    assert {path.name for path in logs.glob("*.csv")} == expected
    assert [name for name in expected if (logs / name).read_bytes() != (LAB / name).read_bytes()] == []


def test_a_sweep_goes_through_its_band_and_steps_are_uneven_between_rests():
    signal = chirp(0.1, 2.0, 50.0, 10.0)
    crossings = np.flatnonzero(np.diff(np.signbit(signal[500:-500])))
    # In its first second the frequency goes from 2 to 6.8 Hz, in its last one to 50 Hz.
    assert np.count_nonzero(crossings < 1000) == pytest.approx(2 * 4.4, abs=1)
    assert np.count_nonzero(crossings > 9000) == pytest.approx(2 * 47.6, abs=1)
    assert not signal[:500].any()
    assert not signal[-500:].any()
    for held_back in (False, True):
        levels = steps(0.1, 2.0, held_back=held_back)
        jumps = np.flatnonzero(np.diff(levels))
        assert np.unique(levels).size == 11
        assert np.unique(np.diff(jumps)).size >= 9
        assert np.abs(levels).max() == pytest.approx(0.1)


def test_what_is_no_part_and_what_is_in_the_way_is_refused_and_left(shots, tmp_path, refused):
    robot = VirtualRobot.load("infantry")
    refused(
        "parts: there is no 'range', expected some of landings, yaw, pitch, timing, shots",
        robot.record,
        tmp_path,
        parts=["range"],
    )
    refused("seed must be a whole number, at least 0, got -1", robot.record, tmp_path / "new", seed=-1)
    assert not (tmp_path / "new").exists()
    (tmp_path / "tape.json").write_text("mine")
    refused("tape.json", robot.record, tmp_path, parts=["shots"])
    assert {path.name for path in tmp_path.iterdir()} - {"run.lock"} == {"tape.json"}
    assert (tmp_path / "tape.json").read_text() == "mine"


def test_a_recording_that_fails_leaves_the_logs_of_the_one_before(shots, monkeypatch):
    before = {path.name: path.read_bytes() for path in shots.iterdir()}

    def fail(robot, seed):
        yield "shots.csv", {"pitch_deg": [1.0]}
        raise KeyboardInterrupt

    monkeypatch.setitem(PARTS, "shots", fail)
    with pytest.raises(KeyboardInterrupt):
        VirtualRobot.load("infantry").record(shots, parts=["shots"])
    assert {path.name: path.read_bytes() for path in shots.iterdir()} == before


def test_the_command_says_where_the_logs_are_and_what_comes_next(tmp_path, capsys, refused, monkeypatch):
    monkeypatch.chdir(tmp_path)
    RecordRobot(parts=("shots",), seed=3).run()
    printed = capsys.readouterr().out
    assert printed.startswith("infantry: 1 logs, limits.json and tape.json in runs/infantry-logs")
    assert printed.endswith("next: archerfish2 identify runs/infantry-logs --out infantry\n")
    refused("no robot 'infantri'; known are infantry, worn", RecordRobot("infantri").run)


@pytest.mark.slow
def test_the_command_delay_of_a_robot_with_much_friction_is_identified(tmp_path):
    logs = VirtualRobot.load("worn").record(tmp_path / "logs", parts=["timing"])
    commands = np.genfromtxt(logs / "timing_commands.csv", delimiter=",", names=True)
    latency = 1e3 * (commands["received_s"] - commands["sent_s"]).mean()
    found = identify_sensing(
        logs / "timing_sweep.csv", logs / "timing_plate.csv", steps=[logs / "timing_steps.csv"]
    ).record.link
    # The bus, the current's lag, and a report that is 1 to 3 ms old: some milliseconds after the command is received.
    assert latency < 1e3 * found.command_delay < latency + 8.0

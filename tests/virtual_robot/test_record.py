"""Recordings of a virtual robot: their folder and what they log, against the description and a team's tape measure."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.cli.main import main
from archerfish.cli.record import RecordRobot
from archerfish.identification.sensing.identify import identify_sensing
from archerfish.paper.tables import landing_table
from archerfish.records.limits import LimitsRecord
from archerfish.virtual_robot import record
from archerfish.virtual_robot.batch import RobotBatch
from archerfish.virtual_robot.firing_range import Plate
from archerfish.virtual_robot.recorder import chirp, inject_commands, steps
from archerfish.virtual_robot.virtual_robot import VirtualRobot

LAB = "second_edition/reference/infantry_logs"


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


def test_shots_are_those_of_version_0_1_to_the_byte(shots, shared):
    assert (shots / "shots.csv").read_bytes() == (shared(LAB) / "shots.csv").read_bytes()


@pytest.mark.slow
def test_all_logs_are_those_of_version_0_1_to_the_byte(tmp_path, shared):
    lab, logs = shared(LAB), VirtualRobot.load("infantry").record(tmp_path / "logs")
    expected = {path.name for path in lab.glob("*.csv")}
    assert {path.name for path in logs.glob("*.csv")} == expected
    assert [name for name in expected if (logs / name).read_bytes() != (lab / name).read_bytes()] == []


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


def test_what_is_no_part_and_what_is_in_the_way_is_refused_and_left(tmp_path, refused):
    robot = VirtualRobot.load("infantry")
    refused("parts: there is no 'range', expected some of landings", robot.record, tmp_path, parts=["range"])
    refused("seed: expected a whole number from 0 on, got -1", robot.record, tmp_path / "new", seed=-1)
    assert not (tmp_path / "new").exists()
    (tmp_path / "tape.json").write_text("mine")
    refused("tape.json", robot.record, tmp_path, parts=["shots"])
    assert (tmp_path / "tape.json").read_text() == "mine"


def test_the_command_says_where_the_logs_are_and_what_comes_next(tmp_path, capsys, refused, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["record", "--parts", "shots", "--seed", "3"])
    found, _, where, then = capsys.readouterr().out.splitlines()
    assert found == "infantry: 1 log, limits.json and tape.json"
    assert re.fullmatch(r"all is in runs/infantry-logs \(\d+ s\)", where)
    assert then == "next: archerfish identify runs/infantry-logs --out infantry"
    refused("no robot 'infantri'; perhaps you meant infantry", RecordRobot("infantri").run)


@pytest.mark.slow
def test_the_command_delay_of_a_robot_with_much_friction_is_identified(tmp_path):
    logs = VirtualRobot.load("worn").record(tmp_path / "logs", parts=["timing"])
    commands = np.genfromtxt(logs / "timing_commands.csv", delimiter=",", names=True)
    latency = 1e3 * (commands["received_s"] - commands["sent_s"]).mean()
    sweep, plate, steps = (logs / f"timing_{name}.csv" for name in ("sweep", "plate", "steps"))
    found = identify_sensing(sweep, plate, steps=[steps]).record.link
    # The bus, the current's lag, and a report that is 1 to 3 ms old: some milliseconds after the command is received.
    assert latency < 1e3 * found.command_delay < latency + 8.0


OFFSET_S = 0.0065  # of infantry's camera
GRAVITY = 9.81


@pytest.fixture
def recorded(changed_robot):
    """Return the columns of a recording by the names of their files, of a robot with other values and no noise."""

    def make(part, values, **options):
        return dict(record.recordings(changed_robot(values, **options).description, 0)[part]())

    return make


def test_an_axis_is_logged_with_commands_that_its_narrow_range_lets_through(recorded, monkeypatch):
    monkeypatch.setattr(record, "SWEEP_S", 0.1)
    monkeypatch.setattr(record, "HOLD_S", 0.3)
    values = {"limits.pitch.low_deg": -1.5, "limits.pitch.high_deg": 1.0}
    values |= {"firmware.pitch.command_low_deg": -1.5, "firmware.pitch.command_high_deg": 1.0}
    logs = recorded("pitch", values)
    commands = np.degrees(np.concatenate([log["u"] for log in logs.values()]))
    assert_allclose([commands.min(), commands.max()], [-1.5, 1.0])
    assert len(logs) == 7
    assert np.degrees(logs["pitch_step_15deg.csv"]["y"][-100:]).mean() == pytest.approx(-1.5 * 1.03, abs=0.05)


@pytest.mark.parametrize("rate_hz", [1000, 300])
def test_an_injected_log_has_the_command_in_force_at_each_report(changed_robot, rate_hz):
    robot = RobotBatch(changed_robot({"link.feedback_rate_hz": rate_hz}).description, 1, np.array([0]))
    commands = np.stack([np.zeros(500), 0.02 * np.sin(0.05 * np.arange(500))], axis=1)
    robot.reset(commands[:1], Plate(3.0))
    played = inject_commands(robot, commands)
    time = played.received.feedback.sampled_s
    within = time < 0.4995
    assert np.count_nonzero(within) == pytest.approx(0.5 * rate_hz, abs=1)
    ticks = np.rint(1000 * time[within]).astype(int)
    assert_allclose(played.in_force(np.zeros(2))[within], commands[ticks], atol=1e-12)


def test_timing_shows_the_latencies_of_the_robot_and_stays_within_its_yaw(recorded, monkeypatch):
    monkeypatch.setattr(record, "TIMING_SWEEP_S", 2.0)
    monkeypatch.setattr(record, "TIMING_STEPS", 4)
    logs = recorded("timing", {"limits.yaw.low_deg": -10, "limits.yaw.high_deg": 8})
    for name in ("sweep", "steps"):
        # 0.8 of the narrower side, where a robot that turns further sweeps by 15° and steps by 7°.
        assert np.degrees(logs[f"timing_{name}.csv"]["yaw_command"].max()) == pytest.approx(6.4, abs=0.01)
    for name, low_ms, high_ms in (("commands", 5, 15), ("reports", 1, 3)):
        messages = logs[f"timing_{name}.csv"]
        latency_ms = 1e3 * (messages["received_s"] - messages["sent_s"])
        assert low_ms <= latency_ms.min() < latency_ms.max() <= high_ms + 1  # in force at the first tick after
    for name in ("plate", "target"):
        frames = logs[f"timing_{name}.csv"]
        latency = frames["receive_s"] - frames["time_s"] - OFFSET_S
        assert 0.030 <= latency.min() < latency.max() <= 0.041
    frames, moments = logs["timing_target.csv"], logs["timing_moments.csv"]["time_s"]
    jumps = np.flatnonzero(np.diff(np.sign(frames["y"])))
    seen_s = frames["time_s"][jumps + 1] + OFFSET_S
    assert len(moments) == 4
    assert frames["receive_s"].min() > moments[0] - 1.1  # later than the steps of the command
    assert np.all((seen_s >= moments) & (seen_s < moments + 1 / 80 + 1e-6))


def test_the_ground_is_hit_at_the_angles_of_table_1_where_a_parabola_ends(recorded, monkeypatch):
    monkeypatch.setattr(record, "LANDINGS", 2)
    shots = recorded("landings", {"muzzle.drag_per_m": 0}, exact=True)["landings.csv"]
    pitch_deg, yaw_deg, distance, _, measured = (np.array(column) for column in shots.values())
    asked = np.repeat([(row.pitch_deg, -row.yaw_deg) for row in landing_table().rows], 2, axis=0)
    # The linkage of infantry's pitch turns the barrel by 1.03 of the encoder's angle.
    assert_allclose(np.stack([pitch_deg, yaw_deg], axis=1), asked * [1.03, 1.0], atol=0.06)
    pitch = np.radians(pitch_deg)
    level, up = 18.0 * np.cos(pitch), 18.0 * np.sin(pitch)
    height = 0.45 + 0.16 * np.sin(pitch)
    assert_allclose(distance, level * (up + np.sqrt(up**2 + 2 * GRAVITY * height)) / GRAVITY, rtol=5e-3)
    assert_allclose(measured, 18.0, atol=0.5)

"""What recordings log, against what the description says and what a team would measure by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish2.paper.tables import landing_table
from archerfish2.virtual_robot import record
from archerfish2.virtual_robot.batch import RobotBatch
from archerfish2.virtual_robot.firing_range import Plate, shoot_plates
from archerfish2.virtual_robot.recorder import inject_commands

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


def test_plates_are_measured_from_the_muzzle_as_by_a_tape(changed_robot):
    values = {"muzzle.drag_per_m": 0, "muzzle.up_m": 0.1, "muzzle.left_m": 0.05}
    robot = RobotBatch(changed_robot(values, exact=True).description, 1, np.array([0]))
    (shot,) = shoot_plates(robot, (3.0,), 0.0, 1, 0, 0)
    assert shot.plane_distance_m == pytest.approx(3.0 - 0.16)
    assert shot.lateral_m == pytest.approx(0.0, abs=2e-3)
    assert shot.hit_height_m == pytest.approx(-0.5 * GRAVITY * (2.84 / 18.0) ** 2, abs=2e-3)

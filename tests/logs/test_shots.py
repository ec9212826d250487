"""Shots, and logs of camera and link: what is read, joined and turned (by SciPy's rotations), repaired and refused."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from archerfish.logs.shots import ShotColumns, read_shots
from archerfish.logs.timing import read_detections, read_gimbal_log, read_message_times, read_moments

LANDING, HITS = "pitch_deg,distance_m", "pitch_deg,plane_distance_m,hit_height_m"


@pytest.fixture
def file(tmp_path):
    def write(text, name="shots.csv", encoding="utf-8"):
        (tmp_path / name).write_text(text, encoding=encoding)
        return tmp_path / name

    return write


def test_degrees_become_radians_and_a_shot_has_its_line(file):
    shots = read_shots(file(f"{LANDING},yaw_deg,speed_m_s,note\n5,6.5,-5,18,1\n\n,,,,\n0,2.8,0,17.5,2\n"))
    assert_allclose(np.degrees([shots.pitch, shots.yaw]), [[5, 0], [-5, 0]])
    assert_array_equal(shots.speed, [18, 17.5])
    assert (shots.lateral, shots.hit_height, len(shots), shots.source) == (None, None, 2, "shots.csv")
    assert [shots.place(index) for index in range(2)] == ["shots.csv line 2", "shots.csv line 5"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_hits_on_a_plane_are_found_by_their_columns_in_every_table(file, encoding):
    text = "\n".join(["pitch_deg;plane_distance_m;hit_height_m;lateral_m", "0;4;-0,23;0,02", "1;2;-0,16;-0,01", ""])
    shots = read_shots(file(text, encoding=encoding))
    found = [shots.hit_height, shots.distance, shots.lateral, shots.yaw]
    assert_array_equal(found, [[-0.23, -0.16], [4, 2], [0.02, -0.01], [0, 0]])
    assert [each.code for each in shots.findings] == ["decimal-comma"]


def test_settings_are_numbered_by_pitch_and_plane_and_named(file):
    number, names = read_shots(file(f"{HITS}\n3,4,0\n3,2,0.1\n3,4,0.2\n")).settings()
    assert (number.tolist(), names) == ([1, 0, 1], ["3.0°, 2.00 m", "3.0°, 4.00 m"])
    assert read_shots(file(f"{LANDING}\n3,4\n3,4.2\n-1,3\n")).settings()[1] == ["-1.0°", "3.0°"]


def test_files_are_joined_and_shots_selected_even_without_a_last_line_break(file, refused):
    one, two = file(f"{LANDING}\n5,6.5\n1,3\n", "one.csv"), file(f"{LANDING}\n0,2.8", "two.csv")
    some = read_shots(one, two).select(np.array([False, True, True]))
    assert some.places == ("one.csv line 3", "two.csv line 2")
    assert_array_equal(some.distance, [3, 2.8])
    other = file(f"{LANDING},speed_m_s\n0,2.8,18\n", "other.csv")
    refused("other.csv: speed_m_s is not in all files", read_shots, one, other)


def test_columns_may_have_other_names_and_are_then_required(file, refused):
    path, columns = file("alpha,d\n5,6.5\n"), ShotColumns(pitch_deg="alpha", distance_m="d")
    assert read_shots(path, columns=columns).distance == [6.5]
    refused('no column "chrono"', read_shots, path, columns=ShotColumns("alpha", distance_m="d", speed_m_s="chrono"))


FAULTS = {
    f"{LANDING}\n95,3\n": ('shots.csv line 2: "pitch_deg" is 95, expected a number within ±90', "angle-out-of-range"),
    f"{LANDING}\n5,3\n5,0\n": ('shots.csv line 3: "distance_m" is 0, expected a number above 0', "not-positive"),
    f"{HITS}\n5,-3,0\n": ('"plane_distance_m" is -3', "not-positive"),
    f"{LANDING},speed_m_s\n5,3,\n": ('line 2: "speed_m_s" is nan', "missing-values"),
    f"{LANDING}\n5,inf\n": ('"distance_m" is inf', "infinite"),
    f"{LANDING}\n5,far\n": ('"far"', "not-a-number"),
    "pitch_deg,distance_mm\n5,3000\n": ('"distance_mm" has another unit than distance_m', "unknown-unit"),
    "pitch_deg,distance_m,hit_height_m\n5,3,0.1\n": ("both landing points and hits", "mixed-columns"),
    "pitch_deg,distance_m,missed\n5,3,0\n5,,1\n": ("1 of 2 shots missed", "censored-misses"),
    "pitch_deg distance_m missed\n5 3 0\n5 4 1\n": ("1 of 2 shots missed", "censored-misses"),
    "angle,distance_m\n5,3\n": ('no column "pitch_deg"', "no-column"),
}


@pytest.mark.parametrize("text", FAULTS)
def test_what_can_not_be_right_is_refused_with_its_place_and_code(file, text, refused):
    complaint, code = FAULTS[text]
    assert refused(re.escape(complaint), read_shots, file(text)).code == code


def table(path, header, *rows):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def test_a_gimbal_log_in_degrees_becomes_radians_without_jumps(tmp_path):
    path = table(tmp_path / "gimbal.csv", "time_s,yaw,yaw_command", (1.7e9, 179, 180), (1.7e9 + 0.1, -179, -180))
    log = read_gimbal_log(path, degrees=True)
    assert_allclose([log.yaw, log.command, log.pitch], [np.radians([179, 181]), [np.pi] * 2, [0, 0]])
    assert (log.time.tolist(), log.source) == ([1.7e9, 1.7e9 + 0.1], str(path))
    assert read_gimbal_log(table(path, "time_s,yaw", (0, 1), (1, 2))).command is None


def test_detections_are_turned_into_the_cameras_frame(tmp_path, refused):
    path = table(tmp_path / "seen.csv", "time_s,x,y,z", (0.0, 0.2, 0.1, 3.0))
    assert read_detections(path, frame="optical").position.tolist() == [[3.0, -0.2, -0.1]]
    refused('no column "rotated_yaw"', read_detections, path, frame="base")
    x, y, z = Rotation.from_euler("ZY", [0.4, -0.1]).apply([3.0, 0.2, -0.1])  # muzzle up is a negative rotation about y
    row = 0, x, y, z, np.degrees(0.4), np.degrees(0.1), 1
    table(path, "time_s,x,y,z,rotated_yaw,rotated_pitch,receive_s", row)
    seen = read_detections(path, frame="base", degrees=True)
    assert_allclose([*seen.position[0], *seen.receive], [3.0, 0.2, -0.1, 1.0], atol=1e-12)
    refused("behind the camera", read_detections, table(path, "time_s,x,y,z", (0.0, -0.2, 0.1, 3.0)))


def test_rows_without_a_value_are_left_out_and_a_detection_needs_no_receipt(tmp_path, refused):
    path, findings = tmp_path / "log.csv", []
    rows = (0.0, 3, 1, 0, ""), (0.1, 3, "", 0, 0.15), (0.2, 3, 3, 0, 0.25), (0.2, 3, 4, 0, 0.25)
    seen = read_detections(table(path, "time_s,x,y,z,receive_s", *rows[:3]), findings=findings)
    assert_allclose(seen.position[:, 1], [1, 3])
    assert_allclose(seen.receive, [np.nan, 0.25])
    found = [(each.code, each.place[-6:], each.samples) for each in findings]
    assert found == [("missing-values", f"line {line}", 1) for line in (3, 2)]
    assert read_moments(table(path, "time_s", (0.1,), ("nan",), (0.3,)), findings=findings).tolist() == [0.1, 0.3]
    assert len(findings) == 3
    refused("line 5: stamps do not increase", read_detections, table(path, "time_s,x,y,z,receive_s", *rows))


def test_faults_are_refused_with_their_line(tmp_path, refused):
    path = table(tmp_path / "log.csv", "time_s,yaw", (0.0, 0.0), (0.1, 0.1), (0.1, 0.2))
    refused(r"log\.csv: line 4: stamps do not increase", read_gimbal_log, path)
    refused("line 4", read_moments, path)
    refused("no samples", read_gimbal_log, table(path, "time_s,yaw", (0.0, "nan")))
    sent = 0.005 * np.arange(60)
    for late, complaint in ((-0.001, "line 12: received -0.001 s"), (5.0, "line 12: received 5 s")):
        rows = zip(sent, sent + np.where(np.arange(60) == 10, late, 0.01), strict=True)
        refused(complaint, read_message_times, table(path, "sent_s,received_s", *rows))
    rows = [(each, each + 0.01) for each in sent]
    refused("has 49 messages", read_message_times, table(path, "sent_s,received_s", *rows[:49]))
    assert_allclose(np.diff(read_message_times(table(path, "sent_s,received_s", *rows)), axis=0), 0.01)

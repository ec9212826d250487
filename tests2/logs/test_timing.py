"""Logs of camera and link: rotations by SciPy, and faults with their lines."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from archerfish2.logs.timing import read_detections, read_gimbal_log, read_message_times, read_moments


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
    path = table(
        path, "time_s,x,y,z,rotated_yaw,rotated_pitch,receive_s", (0, x, y, z, np.degrees(0.4), np.degrees(0.1), 1)
    )
    seen = read_detections(path, frame="base", degrees=True)
    assert_allclose([*seen.position[0], *seen.receive], [3.0, 0.2, -0.1, 1.0], atol=1e-12)
    refused("behind the camera", read_detections, table(path, "time_s,x,y,z", (0.0, -0.2, 0.1, 3.0)))


def test_rows_without_a_value_are_left_out_and_a_detection_needs_no_receipt(tmp_path, refused):
    path, findings = tmp_path / "log.csv", []
    rows = (0.0, 3, 1, 0, ""), (0.1, 3, "", 0, 0.15), (0.2, 3, 3, 0, 0.25), (0.2, 3, 4, 0, 0.25)
    seen = read_detections(table(path, "time_s,x,y,z,receive_s", *rows[:3]), findings=findings)
    assert_allclose(seen.position[:, 1], [1, 3])
    assert_allclose(seen.receive, [np.nan, 0.25])
    assert [(each.code, each.place[-6:], each.samples) for each in findings] == [
        ("missing-values", "line 3", 1),
        ("missing-values", "line 2", 1),
    ]
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

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from archerfish.records.errors import InputError
from archerfish.records.sensing_logs import (
    DetectionColumns,
    GimbalColumns,
    read_detections_csv,
    read_gimbal_log_csv,
    read_target_steps_csv,
)


def table(path: Path, header: str, rows: list[list[float]]) -> Path:
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows)]) + "\n")
    return path


def test_a_gimbal_log_in_degrees_becomes_radians_without_jumps(tmp_path: Path) -> None:
    path = table(tmp_path / "gimbal.csv", "time_s,yaw,yaw_command", [[0.0, 179.0, 180.0], [0.1, -179.0, -180.0]])
    log = read_gimbal_log_csv(path, degrees=True)
    np.testing.assert_allclose(log.yaw, np.radians([179.0, 181.0]))
    assert log.command is not None
    np.testing.assert_allclose(log.command, np.pi)
    assert not log.pitch.any()


def test_a_column_that_may_be_missing_is_required_once_it_is_named(tmp_path: Path) -> None:
    path = table(tmp_path / "gimbal.csv", "time_s,yaw", [[0.0, 0.0], [0.1, 0.1]])
    assert read_gimbal_log_csv(path).command is None
    with pytest.raises(InputError, match='no column "ref"'):
        read_gimbal_log_csv(path, GimbalColumns(command="ref"))


def test_time_that_does_not_increase_is_refused_with_its_line(tmp_path: Path) -> None:
    path = table(tmp_path / "gimbal.csv", "time_s,yaw", [[0.0, 0.0], [0.1, 0.1], [0.1, 0.2]])
    with pytest.raises(InputError, match=r"gimbal\.csv: line 4: time 0\.1 s does not come after"):
        read_gimbal_log_csv(path)
    with pytest.raises(InputError, match="line 4"):
        read_target_steps_csv(path)


def test_optical_axes_are_turned_forward_left_up(tmp_path: Path) -> None:
    path = table(tmp_path / "seen.csv", "time_s,x,y,z", [[0.0, 0.2, 0.1, 3.0]])
    assert read_detections_csv(path, frame="optical").position.tolist() == [[3.0, -0.2, -0.1]]


def test_the_frame_is_doubted_where_the_plate_is_behind(tmp_path: Path) -> None:
    path = table(tmp_path / "seen.csv", "time_s,x,y,z", [[0.0, -0.2, 0.1, 3.0]])
    with pytest.raises(InputError, match="behind the camera"):
        read_detections_csv(path)


def test_detections_in_the_base_frame_are_turned_back_by_the_logged_angles(tmp_path: Path) -> None:
    seen, yaw, pitch = np.array([3.0, 0.2, -0.1]), 0.4, 0.1
    # Muzzle up is a negative rotation about y.
    x, y, z = Rotation.from_euler("ZY", [yaw, -pitch]).apply(seen)
    header = "time_s,x,y,z,rotated_yaw,rotated_pitch"
    path = table(tmp_path / "seen.csv", header, [[0.0, float(x), float(y), float(z), yaw, pitch]])
    np.testing.assert_allclose(read_detections_csv(path, frame="base").position[0], seen, atol=1e-12)


def test_the_base_frame_without_the_angle_is_refused_with_what_is_missing(tmp_path: Path) -> None:
    path = table(tmp_path / "seen.csv", "time_s,x,y,z", [[0.0, 3.0, 0.1, 0.0]])
    with pytest.raises(InputError, match='no column "rotated_yaw"; log that angle'):
        read_detections_csv(path, frame="base")


def test_a_frame_stamped_on_receipt_has_one_column_for_both(tmp_path: Path) -> None:
    path = table(tmp_path / "seen.csv", "time_s,x,y,z", [[0.5, 3.0, 0.1, 0.0]])
    assert read_detections_csv(path).receive is None
    detections = read_detections_csv(path, DetectionColumns(receive="time_s"))
    assert detections.receive is not None
    assert detections.receive.tolist() == [0.5]

from pathlib import Path

import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.viewer.recordings import angles_at, read_gimbal_recording

TIME = np.arange(50) * 0.01 + 7.0


def write(path: Path, **columns: np.ndarray) -> Path:
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n")
    return path


def test_a_log_of_both_axes_is_found_by_usual_names(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", time_s=TIME, yaw=0.1 * TIME, pitch=0 * TIME + 0.2, yaw_command=0.1 * TIME + 0.3)
    found = read_gimbal_recording(path)
    assert found.time[0] == 0.0
    angle, command = angles_at(found, 0.25)
    np.testing.assert_allclose(angle, [0.2, 0.725])
    np.testing.assert_allclose(command, [0.2, 1.025])
    assert any("no target" in remark for remark in found.remarks)
    assert any("pitch command" in remark for remark in found.remarks)


def test_signals_are_named_and_degrees_turned_to_radians(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", t_ms=1e3 * TIME, y_deg=0 * TIME + 90.0, u=0 * TIME)
    found = read_gimbal_recording(path, "t_ms", {"pitch": "y_deg", "pitch_command": "u"})
    np.testing.assert_allclose(found.angle[:, 0], np.pi / 2)
    np.testing.assert_allclose(found.time[-1], 0.49)
    assert np.isnan(found.angle[:, 1]).all()


def test_a_log_without_an_angle_or_with_a_wrong_role_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", time_s=TIME, speed=TIME)
    with pytest.raises(InputError, match="--signals yaw=NAME"):
        read_gimbal_recording(path)
    with pytest.raises(InputError, match="stamp"):
        read_gimbal_recording(path, "stamp")
    with pytest.raises(InputError, match="roll"):
        read_gimbal_recording(path, signals={"roll": "speed"})
    with pytest.raises(InputError, match="angle"):
        read_gimbal_recording(path, signals={"yaw": "angle"})


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_of_joint_states_is_played(tmp_path: Path, storage: str) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds = types.types
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        topic = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=types)
        for index in range(20):
            stamp = kinds["builtin_interfaces/msg/Time"](sec=5, nanosec=index * 10_000_000)
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            values = np.array([0.01 * index, -0.5])
            message = kinds["sensor_msgs/msg/JointState"](header, ["yaw", "pitch"], values, 0 * values, 0 * values)
            content = types.serialize_cdr(message, "sensor_msgs/msg/JointState")
            writer.write(topic, 5_000_000_000 + index * 10_000_000, content)
    paths = [tmp_path / "bag", *([] if storage == "sqlite3" else (tmp_path / "bag").glob("*.mcap"))]
    for path in paths:
        found = read_gimbal_recording(path)
        np.testing.assert_allclose(found.angle[:, 1], 0.01 * np.arange(20), atol=1e-12)
        np.testing.assert_allclose(found.angle[:, 0], -0.5)
        np.testing.assert_allclose(found.time, 0.01 * np.arange(20), atol=1e-6)


def test_a_sample_without_a_time_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s,yaw\n0.0,0.1\n,0.2\n0.02,0.3\n")
    with pytest.raises(InputError, match=r"log.csv: line 3: no time in time_s"):
        read_gimbal_recording(path)


def test_what_the_reader_repaired_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s;yaw\n0,00;0,1\n0,01;0,2\n0,02;0,3\n")
    found = read_gimbal_recording(path)
    np.testing.assert_allclose(found.angle[:, 1], [0.1, 0.2, 0.3])
    assert any("decimal" in remark for remark in found.remarks)

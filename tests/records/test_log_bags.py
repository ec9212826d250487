import sqlite3
import struct

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from archerfish.records import log_bags
from archerfish.records.errors import InputError
from archerfish.records.log_files import read_log
from archerfish.records.message_layout import message_layout

TYPES = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = "sensor_msgs/msg/JointState"


def joint_state(index, names=("pitch", "yaw"), types=TYPES, **header):
    stamp = types.types["builtin_interfaces/msg/Time"](index // 1000, (index % 1000) * 10**6)
    top = types.types["std_msgs/msg/Header"](**header, stamp=stamp, frame_id="base")
    count = len(names)
    values = [index + offset + np.arange(count, dtype=np.float64) / 10 for offset in (0.0, 0.25, 0.5)]
    return types.types[JOINTS](top, list(names), *values)


def write_bag(path, messages, topic="/joint_states", plugin=StoragePlugin.SQLITE3):
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection(topic, JOINTS, typestore=TYPES)
        for index, message in enumerate(messages):
            writer.write(connection, 10**9 + index * 10**6, TYPES.serialize_cdr(message, JOINTS))
    return path


SIGNALS = (["/joint_states/effort[1]"], ["/joint_states/position[0]"])


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("whole", [True, False])
def test_a_ros_2_bag_is_read_from_its_folder_and_from_its_file(tmp_path, plugin, whole):
    path = write_bag(tmp_path / "bag", map(joint_state, range(50)), plugin=plugin)
    if not whole:
        path = next(each for each in path.iterdir() if each.suffix in (".db3", ".mcap"))
    table = read_log(path, *SIGNALS, time="time_s")
    np.testing.assert_array_equal(table.columns["/joint_states/effort[1]"], np.arange(50) + 0.6)
    np.testing.assert_array_equal(table.columns["/joint_states/position[0]"], np.arange(50))
    np.testing.assert_allclose(table.stamps, 1e-3 * np.arange(50), atol=1e-12)
    assert table.stamp_name == "/joint_states/header.stamp"
    assert table.findings == ()


def test_a_ros_1_bag_is_read(tmp_path):
    types = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / "log.bag") as writer:
        connection = writer.add_connection("/joint_states", JOINTS, typestore=types)
        for index in range(20):
            message = joint_state(index, types=types, seq=index)
            writer.write(connection, index * 10**6, types.serialize_ros1(message, JOINTS))
    table = read_log(tmp_path / "log.bag", *SIGNALS, time=None)
    np.testing.assert_array_equal(table.columns["/joint_states/effort[1]"], np.arange(20) + 0.6)
    np.testing.assert_allclose(table.stamps, 1e-3 * np.arange(20), atol=1e-12)


def test_joints_are_found_by_name_even_where_their_order_and_number_change(tmp_path):
    order = [("pitch", "yaw"), ("yaw", "pitch"), ("yaw",), ("roll", "pitch", "yaw")]
    messages = [joint_state(index, order[index % 4]) for index in range(40)]
    path = write_bag(tmp_path / "bag", messages)
    table = read_log(path, ["/joint_states/yaw/effort"], ["/joint_states/yaw/position"], time=None)
    expected = [message.position[message.name.index("yaw")] for message in messages]
    np.testing.assert_array_equal(table.columns["/joint_states/yaw/position"], expected)


@pytest.mark.parametrize(
    "kind", [JOINTS, "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry", "sensor_msgs/msg/BatteryState"]
)
def test_the_layout_finds_what_rosbags_finds(kind):
    message = filled(kind, np.random.default_rng(0))
    raw = bytes(TYPES.serialize_cdr(message, kind))
    again = TYPES.deserialize_cdr(raw, kind)
    layout = message_layout(raw, kind, TYPES.fielddefs, ros2=True)
    assert len(layout.numbers) > 5
    for path, (offset, code) in layout.numbers.items():
        found = np.frombuffer(raw, code, 1, offset)[0]
        assert found == eval(f"message.{path}", {"message": again}), path


def filled(kind, rng):
    """Return a message of a type with random content."""

    def value(node):
        number, of = int(node[0]), node[1]
        if number == 1:
            if of[0] == "string":
                return "x" * int(rng.integers(1, 9))
            return bool(rng.integers(2)) if of[0] == "bool" else int(rng.integers(1, 100))
        if number == 2:
            return filled(of, rng)
        count = of[1] if number == 3 else int(rng.integers(1, 5))
        elements = [value(of[0]) for _ in range(count)]
        plain = int(of[0][0]) == 1 and of[0][1][0] != "string"
        return np.array(elements, dtype=of[0][1][0]) if plain else elements

    return TYPES.types[kind](*(value(node) for _, node in TYPES.fielddefs[kind][1]))


def test_a_message_that_ends_early_or_claims_too_much_is_an_error():
    raw = bytes(TYPES.serialize_cdr(joint_state(1), JOINTS))
    with pytest.raises(struct.error):
        message_layout(raw[:40], JOINTS, TYPES.fielddefs, ros2=True)
    claims = bytearray(raw)
    claims[12:16] = b"\xff\xff\xff\x7f"
    with pytest.raises(struct.error):
        message_layout(bytes(claims), JOINTS, TYPES.fielddefs, ros2=True)


def test_a_damaged_message_is_refused_with_its_number(tmp_path):
    path = write_bag(tmp_path / "bag", map(joint_state, range(5)))
    with sqlite3.connect(next(path.glob("*.db3"))) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 30) WHERE id = 3")
    database.close()
    with pytest.raises(InputError, match="message 3 is no sensor_msgs/msg/JointState") as caught:
        read_log(path, *SIGNALS, time=None)
    assert caught.value.code == "damaged"


def test_the_missing_library_is_named(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "bag", map(joint_state, range(5)))
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(InputError, match=r"pip install archerfish\[bags\]"):
        log_bags.read_bag(path, *SIGNALS)


def test_a_command_of_another_topic_is_held_until_the_next(tmp_path):
    """Commands at 0, 10, 20 ms…; angles at 3, 8, 13 ms…: each angle sees the last command."""
    with Writer(tmp_path / "bag", version=9) as writer:
        command = writer.add_connection("/command", JOINTS, typestore=TYPES)
        angle = writer.add_connection("/joint_states", JOINTS, typestore=TYPES)
        for index in range(0, 100, 10):
            writer.write(command, index, TYPES.serialize_cdr(joint_state(index), JOINTS))
        for index in range(3, 100, 5):
            writer.write(angle, index, TYPES.serialize_cdr(joint_state(index), JOINTS))
    table = read_log(tmp_path / "bag", ["/command/position[0]"], ["/joint_states/position[0]"], time=None)
    at = np.arange(3, 100, 5)
    np.testing.assert_array_equal(table.columns["/joint_states/position[0]"], at)
    np.testing.assert_array_equal(table.columns["/command/position[0]"], at // 10 * 10)
    assert [finding.code for finding in table.findings] == ["held-input"]


def test_a_minute_at_1_khz_is_read_whole(tmp_path):
    path = write_bag(tmp_path / "bag", map(joint_state, range(60_000)))
    table = read_log(path, ["/joint_states/yaw/effort"], ["/joint_states/yaw/position"], time=None)
    np.testing.assert_array_equal(table.columns["/joint_states/yaw/position"], np.arange(60_000) + 0.1)
    np.testing.assert_allclose(table.stamps, 1e-3 * np.arange(60_000), atol=1e-9)


def test_messages_before_the_first_of_an_input_are_left_out_and_counted(tmp_path):
    path = tmp_path / "bag"
    with Writer(path, version=9) as writer:
        angle, command = (writer.add_connection(topic, JOINTS, typestore=TYPES) for topic in ("/angle", "/command"))
        for index in range(40):
            writer.write(angle, 10**9 + index, TYPES.serialize_cdr(joint_state(10 * index), JOINTS))
            if index >= 15:
                writer.write(command, 10**9 + index, TYPES.serialize_cdr(joint_state(10 * index - 1), JOINTS))
    table = read_log(path, ["/command/position[0]"], ["/angle/position[0]"], time=None)
    assert table.places[0] == 16
    assert table.samples == 40
    (late,) = [each for each in table.findings if each.code == "late-input"]
    assert (late.samples, late.severity) == (15, "repaired")
    assert "15 of the messages of /angle come before the first of /command" in late.message


def test_a_bag_with_fewer_messages_than_it_states_is_refused(tmp_path):
    path = write_bag(tmp_path / "bag", map(joint_state, range(50)))
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 50", "message_count: 60"))
    with pytest.raises(InputError, match="of the 60 messages of /joint_states that the bag states, 50 can be read"):
        read_log(path, *SIGNALS, time=None)

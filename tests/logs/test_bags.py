"""ROS bags of both ROS editions and three formats: what is read, repaired and refused."""

import sqlite3
import sys
from resource import RUSAGE_SELF, getrusage

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from archerfish.logs.log import read_log, signals_in

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
JOINTS, NUMBER, COUNT, PERIOD_NS = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", 60, 10_000_000
U, Y, AT = np.arange(COUNT) % 7 + 0.5, np.arange(COUNT) / 8, PERIOD_NS * np.arange(COUNT)
PLUGINS = {".bag": None, ".db3": StoragePlugin.SQLITE3, ".mcap": StoragePlugin.MCAP}
SAME = {"inputs": "/axis/effort[1]", "outputs": "/axis/yaw/position"}
APART = {"inputs": "/command/data", "outputs": "/angle/data"}


def joints(nanoseconds, position, effort=(), names=("pitch", "yaw"), store=ROS2):
    stamp = store.types["builtin_interfaces/msg/Time"](*divmod(int(nanoseconds), 10**9))
    header = store.types["std_msgs/msg/Header"](*([0] if store is ROS1 else []), stamp, "base")
    return store.types[JOINTS](header, list(names), *(np.array(each, float) for each in (position, (), effort)))


def write(folder, topics, ending=".mcap", store=ROS2):
    """Write topics, name → [(receipt [ns], message)]; return the file of messages."""
    path = folder / f"log{ending}" if store is ROS1 else folder / "log"
    with Writer1(path) if store is ROS1 else Writer(path, version=9, storage_plugin=PLUGINS[ending]) as writer:
        kinds = {name: each[0][1].__msgtype__ if each else JOINTS for name, each in topics.items()}
        connections = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        every = [(int(at), name, message) for name, each in topics.items() for at, message in each]
        serialize = store.serialize_ros1 if store is ROS1 else store.serialize_cdr
        for at, name, message in sorted(every, key=lambda each: each[0]):
            writer.write(connections[name], at, serialize(message, kinds[name]))
    return path if store is ROS1 else next(path.glob(f"*{ending}"))


def axis(origin=0, store=ROS2):
    """Angles and efforts of two joints in one topic, received 2 ms late."""
    every = zip(origin + AT, U, Y, strict=True)
    return {"/axis": [(t + 2_000_000, joints(t, (0, y), (0, u), store=store)) for t, u, y in every]}


def apart(early=0, late=0):
    """Commands and angles without stamps in topics of their own, the commands some nanoseconds before the angles."""
    number, origin = ROS2.types[NUMBER], 10**9
    commands = [(origin + t - early, number(u)) for t, u in zip(AT[late:], U[late:], strict=True)]
    return {"/command": commands, "/angle": [(origin + t, number(y)) for t, y in zip(AT, Y, strict=True)]}


def found(log):
    return {each.code: each.samples for each in log.findings}


@pytest.mark.parametrize("origin", [0, 10**14, 1_700_000_000_123_456_789])
@pytest.mark.parametrize("ending", PLUGINS)
def test_bags_are_read_exactly_from_file_and_folder_whatever_their_clock(tmp_path, ending, origin):
    store = ROS1 if ending == ".bag" else ROS2
    file = write(tmp_path, axis(origin, store), ending, store)
    for path in (file.parent, file, file.parent):  # the folder with its index, then without
        log = read_log(path, **SAME)
        (recording,) = log.recordings
        assert_array_equal(np.hstack([recording.inputs, recording.outputs]), np.column_stack([U, Y]))
        assert (log.findings, log.samples, recording.period_s) == ((), COUNT, 0.01)
        file.with_name("metadata.yaml").unlink(missing_ok=True)


def test_the_signals_of_a_bag_are_its_numbers_by_topic_and_joint(tmp_path):
    file = write(tmp_path, axis() | apart())
    joint_fields = [f"/axis/{joint}/{field}" for field in ("position", "effort") for joint in ("pitch", "yaw")]
    assert signals_in(file) == signals_in(file.parent) == ("/angle/data", *joint_fields, "/command/data")


def test_joints_are_found_by_name_and_messages_of_other_joints_left_out(tmp_path):
    names = [(("pitch", "yaw"), ("yaw", "pitch"), ("yaw",), ("roll", "pitch", "yaw"))[k % 4] for k in range(COUNT)]
    yaws = [[y if each == "yaw" else -1 for each in own] for y, own in zip(Y, names, strict=True)]
    axes = [(t, joints(t, angles, names=own)) for t, angles, own in zip(AT, yaws, names, strict=True)]
    wheels = [(t + 4_000_000, joints(t, (5, -5), names=("left", "right"))) for t in AT[::3]]
    commands = [(t, joints(t, [u], names=["yaw"])) for t, u in zip(AT, U, strict=True)]
    path = write(tmp_path, {"/axis": axes + wheels, "/command": commands})
    log = read_log(path, inputs="/command/yaw/position", outputs="/axis/yaw/position")
    assert_allclose(log.recordings[0].inputs[:, 0], U, rtol=1e-12)
    assert_array_equal(log.recordings[0].outputs[:, 0], Y)
    assert (log.samples, found(log)) == (COUNT, {"other-joints": 0})
    assert "left out: 20" in log.findings[0].message


def test_commands_are_averaged_between_the_angles_and_angles_before_them_counted(tmp_path):
    log = read_log(write(tmp_path, apart(early=2_500_000, late=20)), **APART)
    assert found(log) == {"receive-time": 0, "late-input": 20}
    assert_allclose(log.recordings[0].inputs[:-1, 0], 0.75 * U[20:-1] + 0.25 * U[21:], rtol=1e-9)
    assert_array_equal(log.recordings[0].outputs[:, 0], Y[20:])


def test_what_a_stopped_recorder_has_written_is_read_and_a_hole_refused(tmp_path, refused):
    content, path = write(tmp_path, apart()).read_bytes(), tmp_path / "torn.mcap"
    path.write_bytes(content[:-200])
    log = read_log(path, **APART)
    assert (len(log.recordings[0]), found(log)["truncated"]) == (COUNT, 0)
    middle = len(content) // 2
    for torn in (content[:500], content[:middle] + bytes(400) + content[middle + 400 :]):
        path.write_bytes(torn)
        refused("torn.mcap: .*try `mcap recover`", read_log, path, **APART)


BACK, YAW, ONE = [*axis(10**9)["/axis"], (2**62, joints(1, (0, 0), (0, 0)))], "/axis/yaw/position", "/axis/effort[1]"
REFUSED = {
    "no topic": ("/imu/x", YAW, axis(), "no-column", 'no topic of signal "/imu/x"; it has .*"/axis/yaw/effort"; name'),
    "no joint": (ONE, "/axis/roll/position", axis(), "no-column", 'none with "roll"; it has .*"yaw"'),
    "no field": (
        "/axis/torque",
        YAW,
        axis(),
        "no-column",
        'of /axis have no "/axis/torque"; they .*"/axis/yaw/position',
    ),
    "an array": ("/axis/position", YAW, axis(), "no-column", r'of 2; name .*position\[0]", or a joint, as'),
    "from the end": ("/axis/effort[-1]", YAW, axis(), "no-column", r'have no "/axis/effort\[-1\]"'),
    "a method": ("/axis/effort.__len__", YAW, axis(), "no-column", "have no .*__len__"),
    "empty fields": ("/axis/yaw/velocity", YAW, axis(), "no-column", 'have no "/axis/yaw/velocity"; they'),
    "two clocks": ("/command/data", YAW, axis() | apart(), "clocks", "some topics have header.stamp.*; record all"),
    "no messages": (ONE, YAW, {"/axis": []}, "no-data", "/axis has 0 messages"),
    "outputs apart": ("/angle/data", [*APART.values()], apart(early=1), "missing-values", "with all signals: 0"),
    "time that goes back": (ONE, YAW, {"/axis": BACK}, "time-backward", "message 61: time 0 s does not come after"),
}


@pytest.mark.parametrize(("inputs", "outputs", "topics", "code", "complaint"), REFUSED.values(), ids=REFUSED)
def test_what_can_not_be_taken_from_a_bag_is_refused(tmp_path, inputs, outputs, topics, code, complaint, refused):
    path = write(tmp_path, topics)
    assert refused(f"^{tmp_path}.*{complaint}", read_log, path, inputs=inputs, outputs=outputs).code == code


def test_a_damaged_message_lost_ones_and_a_missing_library_are_named(tmp_path, refused, monkeypatch):
    file = write(tmp_path, axis(), ".db3")
    index = file.with_name("metadata.yaml")
    index.write_text(index.read_text().replace("message_count: 60", "message_count: 70"))
    refused("60 of 70 messages of /axis can be read", read_log, file.parent, **SAME)
    database = sqlite3.connect(file)
    database.execute("UPDATE messages SET data = substr(data, 1, 30) WHERE id = 3")
    database.commit()
    database.close()
    refused("message 3 of /axis has no .*copy the bag again", read_log, file, **SAME)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    refused(r"pip install archerfish\[bags\]", read_log, file, **SAME)


ARRAYS = {".npz": lambda path, **arrays: np.savez(path, **arrays), ".mat": lambda path, **arrays: savemat(path, arrays)}


@pytest.mark.parametrize("ending", [*PLUGINS, *ARRAYS])
def test_a_damaged_file_is_refused_in_one_line_or_gives_a_sound_recording(tmp_path, ending, mutated):
    store = ROS1 if ending == ".bag" else ROS2
    path, names = tmp_path / f"damaged{ending}", SAME if ending in PLUGINS else {}
    ARRAYS.get(ending, lambda *_, **__: None)(path, time_s=1e-9 * AT, u=U, y=Y)
    if ending in PLUGINS:
        path.write_bytes(write(tmp_path, axis(0, store), ending, store).read_bytes())
    count, before = 4 if ending == ".mat" else 40, getrusage(RUSAGE_SELF).ru_maxrss  # each .mat in its own process
    # A length that a damaged bag states is asked of the system at once, which gives no memory before it is written to.
    most = (10.0, float("inf"))
    read = [log for log in mutated(path, lambda: read_log(path, **names), count, most=most) if log.recordings]
    assert read or ending == ".mat"
    assert getrusage(RUSAGE_SELF).ru_maxrss - before < 1e6  # [kB]


def stamped(kind, topic, stamps, received, fields):
    """Messages with stamps [ns] in a topic, received at other times [ns]; `fields` are those of each."""
    types = ROS2.types
    every = [types["builtin_interfaces/msg/Time"](*divmod(int(at), 10**9)) for at in stamps]
    headers = [types["std_msgs/msg/Header"](at, "base") for at in every]
    return {topic: [(t, types[kind](head, *field)) for t, head, field in zip(received, headers, fields, strict=True)]}


POINT, QUATERNION, STAMPED = (
    ROS2.types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "PointStamped")
)
SLOW = 10**9 + AT


@pytest.mark.parametrize(
    ("apart_ns", "expected"), [(0, None), (2e8, "warning"), (-6e7, "warning"), (1.7e18, "repaired")]
)
def test_clocks_of_the_topics_are_compared_with_their_receipts(tmp_path, apart_ns, expected):
    command = stamped(STAMPED.__msgtype__, "/command", SLOW + int(apart_ns), SLOW, [(POINT(u, 0, 0),) for u in U])
    angles = {"/axis": [(t, joints(t, (0, y))) for t, y in zip(SLOW, Y, strict=True)]}
    log = read_log(write(tmp_path, command | angles), inputs="/command/point/x", outputs="/axis/yaw/position")
    clocks = [each for each in log.findings if each.code == "clocks"]
    assert [each.severity for each in clocks] == [expected] * (expected is not None)
    if abs(apart_ns) > 1e9 or not apart_ns:
        assert_allclose(log.recordings[0].inputs[:, 0], U)
    else:
        assert f"to {apart_ns / 1e9:.4g}" in clocks[0].message or f"by {apart_ns / 1e9:.4g}" in clocks[0].message


def test_a_clock_that_is_slow_is_compared_where_all_topics_are_recorded(tmp_path):
    command, angles = 10**9 + 10 * AT, 10**9 + 10 * AT[40] + 3 * AT
    topics = stamped(STAMPED.__msgtype__, "/command", command // 2, command, [(POINT(u, 0, 0),) for u in U])
    topics |= stamped(STAMPED.__msgtype__, "/angle", angles // 2, angles, [(POINT(y, 0, 0),) for y in Y])
    log = read_log(write(tmp_path, topics), inputs="/command/point/x", outputs="/angle/point/x")
    assert "clocks" not in found(log)


def test_a_topic_without_a_leading_slash_is_found_with_and_without_one(tmp_path):
    path = write(tmp_path, {"axis": axis()["/axis"]})
    for slash in ("/", ""):
        log = read_log(path, inputs=f"{slash}axis/effort[1]", outputs=f"{slash}axis/yaw/position")
        assert_array_equal(log.recordings[0].outputs[:, 0], Y)


SPELLINGS = ["/command/point/x", "/command/point.x", "/command.point.x", "command/point/x"]


@pytest.mark.parametrize("ending", [".mcap", ".db3"])
def test_fields_are_named_as_ros_tools_spell_them_and_quaternions_give_angles(tmp_path, ending, refused):
    turns = [QUATERNION(*Rotation.from_euler("ZYX", (yaw, 0.3, -0.2)).as_quat().tolist()) for yaw in Y / 2]
    three = ROS2.types["geometry_msgs/msg/Vector3"](0, 0, 0), np.zeros(9)
    imus = [(turn, np.zeros(9), *three, *three) for turn in turns]
    topics = stamped(STAMPED.__msgtype__, "/command", AT, SLOW, [(POINT(u, 0, 0),) for u in U])
    path = write(tmp_path, topics | stamped("sensor_msgs/msg/Imu", "/head/imu", AT, SLOW, imus), ending)
    angles = ("/head/imu/orientation/yaw", "/head/imu/orientation.pitch", "head/imu.orientation.roll")
    for spelling in SPELLINGS:
        (recording,) = read_log(path, inputs=spelling, outputs=angles).recordings
        assert_allclose(recording.inputs[:, 0], U)
        assert_allclose(recording.outputs, np.column_stack([Y / 2, 0 * Y + 0.3, 0 * Y - 0.2]), atol=1e-12)
    refused(
        "orientation/z. is a component of a quaternion.*yaw",
        read_log,
        path,
        inputs=SPELLINGS[0],
        outputs="/head/imu/orientation/z",
    )
    error = refused('"/command/point.x"', read_log, path, inputs="/command/point/u", outputs=SPELLINGS[0])
    assert "Error" not in str(error)


def test_messages_in_another_encoding_are_named(tmp_path, refused):
    path = write(tmp_path, apart())
    path.write_bytes(path.read_bytes().replace(b"ros2msg", b"ros1msg"))
    refused("has messages in ros1msg, expected those of ROS 2", read_log, path, **APART)

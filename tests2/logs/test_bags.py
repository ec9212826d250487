"""ROS bags of both ROS editions and three formats: what is read, repaired and refused."""

import random
import sqlite3
import sys
import time
from resource import RUSAGE_SELF, getrusage

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.errors import InputError
from archerfish2.logs.log import read_log

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
JOINTS, NUMBER, TEXT = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "std_msgs/msg/String"
COUNT, PERIOD_NS = 60, 10_000_000
U, Y = np.arange(COUNT) % 7 + 0.5, np.arange(COUNT) / 8
FORMATS = (".bag", ".db3", ".mcap")
SAME = {"inputs": "/axis/effort[1]", "outputs": "/axis/yaw/position"}
APART = {"inputs": "/command/data", "outputs": "/angle/data"}


def joints(nanoseconds, position, effort=(), names=("pitch", "yaw"), types=TYPES[2]):
    stamp = types.types["builtin_interfaces/msg/Time"](*divmod(int(nanoseconds), 10**9))
    header = [*([0] if types is TYPES[1] else []), stamp, "base"]
    values = [np.array(each, dtype=np.float64) for each in (position, (), effort)]
    return types.types[JOINTS](types.types["std_msgs/msg/Header"](*header), list(names), *values)


def write(path, topics, ending=".mcap"):
    """Write topics, name → (type, [(receipt [ns], message)]); return the file of messages."""
    version = 1 if ending == ".bag" else 2
    plugin = StoragePlugin.MCAP if ending == ".mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if version == 1 else Writer(path, version=9, storage_plugin=plugin) as writer:
        every = []
        for name, (kind, messages) in topics.items():
            connection = writer.add_connection(name, kind, typestore=TYPES[version])
            every += [(at, connection, each) for at, each in messages]
        serialize = TYPES[1].serialize_ros1 if version == 1 else TYPES[2].serialize_cdr
        for at, connection, each in sorted(every, key=lambda each: each[0]):
            writer.write(connection, at, serialize(each, connection.msgtype))
    return path if version == 1 else next(path.glob(f"*{ending}"))


def axis(origin=0, version=2):
    """Angles and efforts of two joints in one topic, received 2 ms late."""
    at = origin + PERIOD_NS * np.arange(COUNT)
    every = [joints(t, (0, y), (0, u), types=TYPES[version]) for t, u, y in zip(at, U, Y, strict=True)]
    return {"/axis": (JOINTS, list(zip((at + 2_000_000).tolist(), every, strict=True)))}


def apart(early=0, late=0, count=COUNT):
    """Commands and angles without stamps in topics of their own, the commands some nanoseconds before the angles."""
    numbers = {"/command": (U[late:], 10**9 + PERIOD_NS * np.arange(late, COUNT) - early)}
    numbers["/angle"] = Y[:count], 10**9 + PERIOD_NS * np.arange(count)
    number = TYPES[2].types[NUMBER]
    return {
        name: (NUMBER, [(int(t), number(value)) for t, value in zip(at, values, strict=True)])
        for name, (values, at) in numbers.items()
    }


def found(log):
    return {each.code: each.samples for each in log.findings}


@pytest.mark.parametrize("origin", [0, 10**14, 1_700_000_000_123_456_789])
@pytest.mark.parametrize("ending", FORMATS)
def test_bags_are_read_exactly_from_file_and_folder_whatever_their_clock(tmp_path, ending, origin):
    file = write(
        tmp_path / ("log.bag" if ending == ".bag" else "log"), axis(origin, 1 if ending == ".bag" else 2), ending
    )
    for path in {file, file.parent if file.suffix != ".bag" else file}:
        log = read_log(path, **SAME)
        (recording,) = log.recordings
        assert_array_equal(np.hstack([recording.inputs, recording.outputs]), np.column_stack([U, Y]))
        assert (log.findings, log.samples, recording.period_s) == ((), COUNT, 0.01)
    bare = tmp_path / "copy" / file.name
    bare.parent.mkdir()
    file.rename(bare)
    assert len(read_log(bare.parent, **SAME).recordings[0]) == COUNT  # a folder without an index


def test_joints_are_found_by_name_and_messages_of_other_joints_left_out(tmp_path):
    orders = (("pitch", "yaw"), ("yaw", "pitch"), ("yaw",), ("roll", "pitch", "yaw"))
    names = [orders[k % 4] for k in range(COUNT)]
    at = [PERIOD_NS * k for k in range(COUNT)]
    yaw = [
        joints(t, [y + j.index("yaw") - k for k in range(len(j))], names=j)
        for t, y, j in zip(at, Y, names, strict=True)
    ]
    wheels = [joints(t, (5, -5), names=("left", "right")) for t in at[::3]]
    messages = [*zip(at, yaw, strict=True), *((t + 4_000_000, each) for t, each in zip(at[::3], wheels, strict=True))]
    commands = [(t, joints(t, [u], names=["yaw"])) for t, u in zip(at, U, strict=True)]
    path = write(tmp_path / "bag", {"/axis": (JOINTS, messages), "/command": (JOINTS, commands)})
    log = read_log(path, inputs="/command/yaw/position", outputs="/axis/yaw/position")
    assert_allclose(log.recordings[0].inputs[:, 0], U, rtol=1e-12)
    assert_array_equal(log.recordings[0].outputs[:, 0], Y)
    assert (log.samples, found(log)) == (COUNT, {"other-joints": 0, "held-input": 0})
    assert "left out: 20" in log.findings[0].message


def test_commands_are_averaged_between_the_angles_and_angles_before_them_counted(tmp_path):
    log = read_log(write(tmp_path / "bag", apart(early=2_500_000, late=20)), **APART)
    (recording,) = log.recordings
    assert found(log) == {"receive-time": 0, "held-input": 0, "late-input": 20}
    assert_allclose(recording.inputs[:-1, 0], 0.75 * U[20:-1] + 0.25 * U[21:], rtol=1e-9)
    assert_array_equal(recording.outputs[:, 0], Y[20:])


def test_what_a_stopped_recorder_has_written_is_read(tmp_path, refused):
    content = write(tmp_path / "bag", apart()).read_bytes()
    (chunk := tmp_path / "log.mcap").write_bytes(content[:-200])
    log = read_log(chunk, **APART)
    assert (len(log.recordings[0]), found(log)["truncated"]) == (COUNT, 0)
    chunk.write_bytes(content[:500])
    refused("is damaged, or no bag.*try `mcap recover`", read_log, chunk, **APART)
    middle = len(content) // 2
    chunk.write_bytes(content[:middle] + bytes(400) + content[middle + 400 :])
    refused("log.mcap: .*try `mcap recover`", read_log, chunk, **APART)
    file = write(tmp_path / "other", apart(), ".db3")
    file.with_name(f"{file.name}-wal").write_bytes(b"messages")
    (file.parent / "metadata.yaml").unlink()
    refused("has messages that are not in it.*`ros2 bag reindex`", read_log, file.parent, **APART)


def field(inputs, outputs="/axis/yaw/position", topics=None):
    """Topics, and signals that are to be read from them."""
    return topics or axis(), {"inputs": inputs, "outputs": outputs}


STAMPED = {"/axis": axis()["/axis"], "/command": apart()["/command"]}
REFUSED = {
    "no such topic": (*field("/imu/x"), "no-column", 'no topic of signal "/imu/x"; name .* the topics are "/axis"'),
    "no such joint": (
        *field("/axis/effort[0]", "/axis/roll/position"),
        "no-column",
        'none with "roll"; it has .*"yaw"',
    ),
    "no such field": (*field("/axis/torque"), "no-column", 'message 1 of .*; the fields of .* "name", "position"'),
    "no such element": (*field("/axis/effort[2]"), "no-column", "message 1 of /axis has no .*IndexError"),
    "from the end": (*field("/axis/effort[-1]"), "no-column", "message 1 of /axis has no .*AttributeError"),
    "a sequence": (*field("/axis/effort"), "no-column", "message 1 of /axis has no .*TypeError"),
    "a method": (*field("/axis/effort.__len__"), "no-column", "message 1 of /axis has no .*TypeError"),
    "values of no joint": (*field("/axis/yaw/velocity"), "no-column", "message 1 of /axis has no .*IndexError"),
    "two clocks": (*field("/command/data", topics=STAMPED), "clocks", "some topics have header.stamp.*; record all"),
    "no messages": (*field("/axis/effort[1]", topics={"/axis": (JOINTS, [])}), "no-data", "/axis has 0 messages"),
    "outputs of two topics": (
        apart(early=1),
        {"inputs": "/command/data", "outputs": [*APART.values()]},
        "missing-values",
        "rows with all signals: 0",
    ),
    "time that goes back": (
        *field(
            "/axis/effort[1]",
            topics={"/axis": (JOINTS, [*axis(10**9)["/axis"][1], (2**62, joints(1, (0, 0), (0, 0)))])},
        ),
        "time-backward",
        "message 61: time 0 s does not come after",
    ),
}


@pytest.mark.parametrize(("topics", "names", "code", "complaint"), REFUSED.values(), ids=REFUSED)
def test_what_can_not_be_taken_from_a_bag_is_refused_in_one_line(tmp_path, topics, names, code, complaint, refused):
    path = write(tmp_path / "bag", topics)
    refused(f"^{tmp_path}.*{complaint}", read_log, path, **names)
    with pytest.raises(InputError) as error:
        read_log(path, **names)
    assert error.value.code == code


def test_a_damaged_message_a_missing_one_and_a_missing_library_are_named(tmp_path, refused, monkeypatch):
    file = write(tmp_path / "bag", axis(), ".db3")
    index = file.with_name("metadata.yaml")
    index.write_text(index.read_text().replace("message_count: 60", "message_count: 70"))
    refused("of the 70 messages of /axis that the bag states, 60 can", read_log, tmp_path / "bag", **SAME)
    with sqlite3.connect(file) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 30) WHERE id = 3")
    database.close()
    refused("message 3 of /axis has no .*copy the bag again", read_log, file, **SAME)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    refused(r"pip install archerfish\[bags\]", read_log, file, **SAME)
    refused("is a folder, and no bag's", read_log, tmp_path)


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.slow)])
def test_a_damaged_bag_is_refused_in_one_line_or_gives_a_sound_recording(tmp_path, ending, count):
    content = write(tmp_path / f"log{ending}", axis(0, 1 if ending == ".bag" else 2), ending).read_bytes()
    path, codes, read = tmp_path / f"damaged{ending}", set(), 0
    before = getrusage(RUSAGE_SELF).ru_maxrss
    for number in range(count):
        draw, started = random.Random(number), time.process_time()
        first, length = draw.randrange(len(content)), draw.choice((1, 1, 4, 100, 10**6))
        changed = draw.choice((b"", draw.randbytes(length), bytes(length), b"\xff" * length))[:1000]
        path.write_bytes(content[:first] + changed + content[first + length :])
        try:
            read += len(read_log(path, **SAME).recordings) > 0
        except InputError as error:
            codes.add(error.code)
            assert "\n" not in str(error)
        assert time.process_time() - started < 10
    assert getrusage(RUSAGE_SELF).ru_maxrss - before < 1e6  # [kB]
    assert (read > 0, None in codes, "damaged" in codes) == (True, False, True)

"""Bags that hold a log: ROS 2 messages, written through rosbags."""

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = "sensor_msgs/msg/JointState"
NUMBER = "std_msgs/msg/Float64"


def header(time):
    stamp = TYPES.types["builtin_interfaces/msg/Time"](int(time), round((time % 1) * 1e9))
    return TYPES.types["std_msgs/msg/Header"](stamp, "base")


def joint_state(time, positions, efforts):
    values = [np.array(each, dtype=np.float64) for each in (positions, np.zeros(2), efforts)]
    return TYPES.types[JOINTS](header(time), ["pitch", "yaw"], *values)


def number(_, value):
    return TYPES.types[NUMBER](value)


def write_bag(path: Path, topics, plugin=StoragePlugin.SQLITE3):
    """Write a bag of topics: name → (type, [(time of receipt [s], message)])."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        messages = []
        for name, (kind, stamped) in topics.items():
            connection = writer.add_connection(name, kind, typestore=TYPES)
            messages += [(round(time * 1e9), connection, message) for time, message in stamped]
        for time, connection, message in sorted(messages, key=lambda each: each[0]):
            writer.write(connection, time, TYPES.serialize_cdr(message, connection.msgtype))


def states(time, u, y):
    return [(t + 0.002, joint_state(t, (0.0, b), (0.0, a))) for t, a, b in zip(time, u, y, strict=True)]


def joint_states(path, time, u, y, plugin=StoragePlugin.SQLITE3):
    write_bag(path, {"/joint_states": (JOINTS, states(time, u, y))}, plugin)
    return [path, "--input", "/joint_states/effort[1]", "--output", "/joint_states/yaw/position"]


def two_topics(path, time, u, y, commands_from=0):
    """The command is sent a third of a period before the angle is sampled."""
    commands = [(t, joint_state(t - 0.003, (0.0, a), (0.0, 0.0))) for t, a in zip(time + 10, u, strict=True)]
    commands = commands[commands_from:]
    write_bag(path, {"/joint_states": (JOINTS, states(time + 10, u, y)), "/command": (JOINTS, commands)})
    return [path, "--input", "/command/yaw/position", "--output", "/joint_states/yaw/position"]


def unstamped(path, time, u, y):
    topics = {
        name: (NUMBER, [(t, number(t, value)) for t, value in zip(time, values, strict=True)])
        for name, values in (("/command", u), ("/angle", y))
    }
    write_bag(path, topics)
    return [path, "--input", "/command/data", "--output", "/angle/data"]


def mixed(path, time, u, y):
    commands = [(t, number(t, a)) for t, a in zip(time, u, strict=True)]
    write_bag(path, {"/joint_states": (JOINTS, states(time, u, y)), "/command": (NUMBER, commands)})
    return [path, "--input", "/command/data", "--output", "/joint_states/yaw/position"]


def write_bag_of_axis(path: Path, time, u, y):
    """Write a bag as the pages have it: commands as joint states of a topic of their own, at the clock of the angle."""
    commands = [(t + 0.001, joint_state(t, (0.0, a), (0.0, 0.0))) for t, a in zip(time, u, strict=True)]
    write_bag(path, {"/joint_states": (JOINTS, states(time, u, y)), "/gimbal_command": (JOINTS, commands)})

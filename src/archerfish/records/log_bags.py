"""Logs in ROS bags: ROS 1 (.bag) and ROS 2 (a folder, or one .db3 or .mcap file), read through rosbags.

A signal is named TOPIC/FIELD with the field's path as in `ros2 topic echo`: "/joint_states/position[0]",
"/gimbal/angle.z". Where a message has names for its values (sensor_msgs/JointState), JOINT/FIELD is understood too:
"/joint_states/yaw/position".
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError, file_error
from archerfish.records.findings import Finding
from archerfish.records.log_table import MAX_BYTES, LogTable
from archerfish.records.message_layout import MessageLayout, message_layout
from archerfish.records.text_file import check_readable

Array = NDArray[np.float64]

_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_ROS1_STAMP = ("header.stamp.secs", "header.stamp.nsecs")


class _Series(NamedTuple):
    nanoseconds: NDArray[np.int64]
    stamped: bool  # by the sender, in the header
    columns: dict[str, Array]


class _Messages(NamedTuple):
    received: NDArray[np.int64]  # ns
    raw: list[bytes]


def bag_files(path: Path) -> list[Path]:
    """Return the files that a bag is made of."""
    return sorted(each for each in path.iterdir() if each.is_file()) if path.is_dir() else [path]


def read_bag(path: Path, inputs: Sequence[str], outputs: Sequence[str]) -> LogTable:
    """Read signals from a bag, on the clock of the outputs' topic.

    Time is the sender's (header.stamp) where the messages have it, else the time at which the bag received them. An
    input of another topic is held from one message to the next, as a command is by the robot that got it.

    Args:
      path: .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
      inputs: signals, TOPIC/FIELD.
      outputs: signals of one topic.

    Raises:
      InputError: if rosbags is not installed, the bag can't be read, or a topic or field is not in it.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        remedy = "install it with: pip install archerfish[bags]"
        raise file_error(path, "reading a bag needs the library rosbags", remedy, "no-library") from error
    for each in bag_files(path):
        check_readable(each)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            series = {
                topic: _series(path, reader, topic, signals)
                for topic, signals in _by_topic(path, reader, [*inputs, *outputs]).items()
            }
    except InputError:
        raise
    except Exception as error:  # SQLite, YAML, MCAP, type and file errors of the libraries below
        problem = f"can't be read as a bag ({' '.join(str(error).split()) or type(error).__name__})"
        raise file_error(path, problem, "check it with `ros2 bag info`, record it again", "damaged") from error
    return _on_one_clock(path, series, inputs, outputs)


def _by_topic(path: Path, reader: Any, signals: Sequence[str]) -> dict[str, list[str]]:
    topics = sorted({connection.topic for connection in reader.connections}, key=len, reverse=True)
    found: dict[str, list[str]] = {}
    for signal in dict.fromkeys(signals):
        topic = next((each for each in topics if signal.startswith(each + "/")), None)
        if topic is None:
            listed = ", ".join(sorted(topics)) or "none"
            remedy = f"name a signal TOPIC/FIELD; the topics are {listed}"
            raise file_error(path, f'holds no topic of signal "{signal}"', remedy, "no-column")
        found.setdefault(topic, []).append(signal)
    return found


def _series(path: Path, reader: Any, topic: str, signals: list[str]) -> _Series:
    connections = [each for each in reader.connections if each.topic == topic]
    kinds = sorted({each.msgtype for each in connections})
    if len(kinds) > 1:
        raise file_error(path, f"topic {topic} has messages of {len(kinds)} types", "record one type", "unknown-format")
    messages = _messages(path, reader, connections, topic)
    count = len(messages.raw)
    columns = {signal: np.full(count, np.nan) for signal in signals}
    stamps = np.zeros(count, dtype=np.int64)
    stamped = True
    for rows, table, layout in _same_structure(path, messages.raw, kinds[0], reader):
        for signal in signals:
            column = _field(path, layout, topic, signal, rows[0])
            columns[signal][rows] = _values(table, layout, column)
        names = next((each for each in (_STAMP, _ROS1_STAMP) if each[0] in layout.numbers), None)
        stamped = stamped and names is not None
        if names is not None:
            seconds, nanoseconds = (_values(table, layout, name).astype(np.int64) for name in names)
            stamps[rows] = seconds * 10**9 + nanoseconds
    # Publishers that leave the stamp unset send zeros.
    stamped = stamped and bool(np.any(stamps))
    return _Series(stamps if stamped else messages.received, stamped, columns)


def _messages(path: Path, reader: Any, connections: list[Any], topic: str) -> _Messages:
    received, raw, size = [], [], 0
    for _, nanoseconds, content in reader.messages(connections=connections):
        received.append(nanoseconds)
        raw.append(bytes(content))
        size += len(content)
        if size > MAX_BYTES:
            problem = f"topic {topic} unpacks to more than {MAX_BYTES / 2**20:.0f} MB"
            raise file_error(path, problem, "cut the bag into shorter ones", "too-large")
    if not raw:
        raise file_error(path, f"topic {topic} has no messages", "pass a bag that has", "no-data")
    # Libraries end the reading at a damaged record without a word.
    if len(raw) < (stated := sum(each.msgcount for each in connections)):
        problem = f"of the {stated} messages of {topic} that the bag states, {len(raw)} can be read"
        remedy = "copy the bag again; if its recorder dropped messages, `ros2 bag reindex` counts those that are there"
        raise file_error(path, problem, remedy, "damaged")
    return _Messages(np.array(received, dtype=np.int64), raw)


def _same_structure(
    path: Path, raw: list[bytes], kind: str, reader: Any
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint8], MessageLayout]]:
    """Yield messages that share a layout: their indices, their bytes, shape (messages, bytes), and the layout."""
    lengths = np.fromiter(map(len, raw), dtype=np.int64, count=len(raw))
    for length in np.unique(lengths):
        left = np.flatnonzero(lengths == length)
        while left.size:
            table = np.frombuffer(b"".join(_picked(raw, left)), dtype=np.uint8).reshape(left.size, length)
            try:
                layout = message_layout(raw[left[0]], kind, reader.typestore.fielddefs, ros2=reader.is2)
            except (struct.error, KeyError, IndexError) as error:
                problem = f"message {left[0] + 1} is no {kind} ({error})"
                raise file_error(path, problem, "record the bag again", "damaged") from error
            fixed = table[:, layout.structure]
            alike = (fixed == fixed[0]).all(axis=1)
            yield left[alike], table[alike], layout
            left = left[~alike]


def _picked(raw: list[bytes], rows: NDArray[np.int64]) -> Iterable[bytes]:
    return raw if rows.size == len(raw) else (raw[row] for row in rows)


def _values(table: NDArray[np.uint8], layout: MessageLayout, field: str) -> NDArray[Any]:
    offset, code = layout.numbers[field]
    return np.ascontiguousarray(table[:, offset : offset + int(code[-1])]).view(code)[:, 0]


def _field(path: Path, layout: MessageLayout, topic: str, signal: str, message: int) -> str:
    """Return the field path that a signal names: as it stands, or FIELD[i] for JOINT/FIELD if name[i] is JOINT."""
    wanted = signal[len(topic) + 1 :]
    if wanted in layout.numbers:
        return wanted
    joint, _, field = wanted.rpartition("/")
    for place, name in layout.strings.items():
        element = f"{field}[{place.removeprefix('name[').removesuffix(']')}]"
        if place.startswith("name[") and name == joint and element in layout.numbers:
            return element
    listed = ", ".join(list(layout.numbers)[:20]) + (", …" if len(layout.numbers) > 20 else "")
    joints = ", ".join(name for place, name in layout.strings.items() if place.startswith("name["))
    remedy = f"its numbers are {listed}" + (f", its joints {joints}" if joints else "")
    raise file_error(path, f'message {message + 1} of {topic} has no number "{wanted}"', remedy, "no-column")


def _on_one_clock(path: Path, series: dict[str, _Series], inputs: Sequence[str], outputs: Sequence[str]) -> LogTable:
    topics = list(dict.fromkeys(next(t for t in series if name in series[t].columns) for name in outputs))
    if len(topics) > 1:
        raise file_error(path, f"the outputs come from {len(topics)} topics", "take them from one topic", "no-column")
    clock = series[topics[0]]
    findings = [] if clock.stamped else [_received(path, topics[0])]
    time, columns = clock.nanoseconds, {}
    start, latest = 0, ""
    for topic, each in series.items():
        if each is clock:
            continue
        if each.stamped != clock.stamped:
            problem = f"{topic} and {topics[0]} are stamped by different clocks"
            raise file_error(path, problem, "record both with header.stamp, or both without", "clocks")
        order = np.argsort(each.nanoseconds, kind="stable")
        last = np.searchsorted(each.nanoseconds[order], time, side="right") - 1
        if (begin := int(np.searchsorted(time, each.nanoseconds[order][0]))) > start:
            start, latest = begin, topic
        for name, values in each.columns.items():
            columns[name] = values[order][np.maximum(last, 0)]
        message = f"the signals of {topic} were brought to the times of {topics[0]}, each message held until the next"
        findings.append(Finding("held-input", "repaired", str(path), message, "nothing to do"))
    if start >= time.size:
        raise file_error(path, "the topics do not overlap in time", "record them together", "no-data")
    if start:
        findings.append(_before_input(path, topics[0], latest, start))
    kept = {name: (columns | clock.columns)[name][start:] for name in [*inputs, *outputs]}
    stamps = (time[start:] - time[start]) * 1e-9
    clock_name = f"{topics[0]}/{'header.stamp' if clock.stamped else 'receive time'}"
    places = np.arange(start + 1, time.size + 1)
    return LogTable(kept, stamps, clock_name, places, "message", str(path), tuple(findings))


def _before_input(path: Path, clock: str, topic: str, count: int) -> Finding:
    message = f"{count} of the messages of {clock} come before the first of {topic} and were left out"
    return Finding("late-input", "repaired", f"{path}: message 1", message, "start the recorder before the axis", count)


def _received(path: Path, topic: str) -> Finding:
    message = f"the messages of {topic} carry no stamp of their own; the time at which the bag got them was taken"
    return Finding("receive-time", "warning", str(path), message, "publish with header.stamp")

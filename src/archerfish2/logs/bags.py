"""Logs in ROS bags of ROS 1 and ROS 2, read through rosbags, on the clock of the outputs' topic.

A signal is named TOPIC/FIELD with the field's path as `ros2 topic echo` prints it ("/joint_states/position[0]",
"/gimbal/angle.z"), or TOPIC/JOINT/FIELD where messages name their values ("/joint_states/yaw/position").
"""

import re
import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.errors import InputError
from archerfish2.logs.recording import Finding, Values
from archerfish2.logs.stamps import held_mean
from archerfish2.logs.table import MAX_BYTES, LogTable, listed, log_fault

BAGS = {b"#ROSBAG": ".bag", b"SQLite f": ".db3", b"\x89MCAP": ".mcap"}
"""How files of a bag begin, and the ending of the name by which rosbags recognises them."""
_RECOVER = {".bag": "rosbag reindex", ".mcap": "mcap recover"}
_MCAP, _MCAP_FOOTER = b"\x89MCAP0\r\n", b"\x02\x14" + bytes(27)
_FIELD = re.compile(r"[A-Za-z]\w*(\[\d{1,9}\])?(\.[A-Za-z]\w*(\[\d{1,9}\])?)*")
_MESSAGE, _ARRAYS = 2, (3, 4)  # kinds of fields in rosbags' definitions of types, next to numbers and strings
_Path = tuple[str | None, tuple[str | int, ...]]
"""The joint whose element of a sequence a number is, and the fields and elements that lead to it."""


class _Series(NamedTuple):
    time: NDArray[np.int64]  # [ns], (N,)
    stamped: bool  # by the sender
    columns: dict[str, Values]  # by signal, (N,)
    numbers: NDArray[np.int64]  # of the messages in their topic, (N,)


def bag_files(path: Path) -> list[Path]:
    """Return the files in a bag's folder; none where it is no bag's."""
    files = sorted(each for each in path.iterdir() if each.is_file())
    return files if any(each.suffix in BAGS.values() for each in files) else []


def read_bag(path: Path, inputs: Sequence[str], outputs: Sequence[str], time: str) -> LogTable:
    """Read signals from a bag, inputs of other topics being held until their next message.

    Time is the sender's (header.stamp) where the messages have it, else that of their receipt.

    Args:
      path: .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
      inputs: names of signals.
      outputs: names of signals of one topic.
      time: name for the column of stamps [s].

    Raises:
      InputError: if rosbags is not installed, the bag can't be read, or a topic or a field is not in it.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        remedy = "install it with: pip install archerfish[bags]"
        raise log_fault(path, "is a ROS bag, which needs the library rosbags", remedy, "no-library") from error
    findings: list[Finding] = []
    with TemporaryDirectory() as folder:
        try:
            files = _readable(path, Path(folder), findings)
            with AnyReader(files, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
                by_topic = _by_topic(path, reader, [*inputs, *outputs])
                series = {topic: _series(path, reader, topic, names, findings) for topic, names in by_topic.items()}
        except InputError:
            raise
        except Exception as error:  # the libraries raise whatever a damaged byte leads them to
            raise _damaged(path, f"is damaged, or no bag ({type(error).__name__}: {str(error)[:200]})") from error
    return _on_one_clock(path, series, outputs, time, findings)


def _damaged(path: Path, problem: str) -> InputError:
    suffixes = {each.suffix for each in (bag_files(path) if path.is_dir() else [path])}
    recover = next((command for suffix, command in _RECOVER.items() if suffix in suffixes), "ros2 bag reindex")
    return log_fault(path, problem, f"copy the bag again, or try `{recover}`", "damaged")


def _readable(path: Path, folder: Path, findings: list[Finding]) -> list[Path]:
    """Return what rosbags can read: the bag, or in `folder` what a recorder that was stopped has written of it."""
    if path.is_dir() and (path / "metadata.yaml").is_file():
        return [path]
    files = []
    for index, file in enumerate(bag_files(path) if path.is_dir() else [path]):
        with file.open("rb") as stream:
            start = stream.read(8)
        if not (suffix := next((each for begin, each in BAGS.items() if start.startswith(begin)), "")):
            continue
        files.append(copy := folder / f"{index}{suffix}")
        log = file.with_name(f"{file.name}-wal")
        if suffix == ".mcap" and not (content := file.read_bytes()).endswith(_MCAP):
            end = _end_of_records(content)
            copy.write_bytes(content[:end] + _MCAP_FOOTER + _MCAP)
            message = f"the last {len(content) - end} bytes are no whole record and were left out: messages are lost"
            remedy = "stop the recorder before its bag is copied"
            findings.append(Finding("truncated", "repaired", str(file), message, remedy))
        elif suffix == ".db3" and log.is_file():  # messages that SQLite has not moved into the file yet
            shutil.copyfile(file, copy)
            shutil.copyfile(log, f"{copy}-wal")
            with closing(sqlite3.connect(copy)) as database:
                database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        else:
            copy.symlink_to(file.absolute())
    return files


def _end_of_records(content: bytes) -> int:
    """Return the length of an MCAP file up to its last whole record, each of a type, a length and its content."""
    end = len(_MCAP)
    while after := end + 9 + int.from_bytes(content[end + 1 : end + 9], "little"):
        if after > len(content) or content[end] == 0:
            break
        end = after
    if content[end : end + 1] == b"\0" and content[end:].strip(b"\0"):
        raise ValueError(f"its records break off at byte {end}")
    return end


def _by_topic(path: Path, reader: Any, signals: Sequence[str]) -> dict[str, list[str]]:
    topics = sorted({each.topic for each in reader.connections}, key=len, reverse=True)
    found: dict[str, list[str]] = {}
    for signal in dict.fromkeys(signals):
        topic = next((each for each in topics if signal.startswith(each + "/")), None)
        if topic is None:
            remedy = f"name a signal TOPIC/FIELD; the topics are {listed(sorted(topics))}"
            raise log_fault(path, f'has no topic of signal "{signal}"', remedy, "no-column")
        found.setdefault(topic, []).append(signal)
    return found


def _series(path: Path, reader: Any, topic: str, signals: list[str], findings: list[Finding]) -> _Series:
    """Read signals of a topic, messages of other joints left out."""
    connections = [each for each in reader.connections if each.topic == topic]
    kind, *others = sorted({each.msgtype for each in connections})
    types = reader.typestore.fielddefs
    if others or kind not in types:
        problem = f"topic {topic} has messages of " + ("several types" if others else f'the unknown type "{kind}"')
        raise log_fault(path, problem, "record one type, as MCAP, which has its definition", "unknown-format")
    places = [_place(path, types, kind, topic, signal) for signal in signals]
    stamp: list[_Path] = [(None, steps) for each in ("sec", "nanosec") if (steps := _steps(types, kind, f"header.stamp.{each}"))]
    received, rows, size, joints, message = [], [], 0, set[str](), None
    for _, nanoseconds, content in reader.messages(connections=connections):
        if (size := size + len(content)) > MAX_BYTES:
            problem = f"topic {topic} unpacks to more than {MAX_BYTES >> 20} MB"
            raise log_fault(path, problem, "cut the bag into shorter ones", "too-large")
        received.append(nanoseconds)
        try:
            message = reader.deserialize(content, kind)
            rows.append([_value(message, *each) for each in (*stamp, *places)])
            joints.update(message.name if places[0][0] else ())
        except IndexError as error:
            problem = f"message {len(received)} of {topic} has fewer elements than {listed(signals)} need"
            raise log_fault(path, problem, "name elements that all messages have", "no-column") from error
        except Exception as error:  # as above
            problem = f"message {len(received)} of {topic} is no {kind} ({type(error).__name__}: {str(error)[:200]})"
            raise _damaged(path, problem) from error
    if (stated := sum(each.msgcount for each in connections)) > len(rows):  # a reader may end at a damaged record
        raise _damaged(path, f"of the {stated} messages of {topic} that the bag states, {len(rows)} can be read")
    numbers = np.flatnonzero([any(value is not None for value in row[len(stamp) :]) for row in rows])
    if not numbers.size:
        problem = f"topic {topic} has no messages" + (f' of "{signals[0]}"; its joints are {listed(sorted(joints))}' if rows else "")
        raise log_fault(path, problem, "pass a bag that has some, or name a joint that is in it", "no-column" if rows else "no-data")
    if other := len(rows) - numbers.size:
        message = f"{other} messages of {topic} are of other joints, and were left out"
        findings.append(Finding("other-joints", "repaired", str(path), message, "nothing to do"))
    table = np.array(rows, dtype=np.float64)[numbers]
    time, sent = np.array(received, dtype=np.int64)[numbers], table[:, : len(stamp)].astype(np.int64)
    if stamped := bool(sent.any()):  # publishers that leave the stamp unset send zeros
        time = 10**9 * sent[:, 0] + sent[:, 1]
    return _Series(time, stamped, dict(zip(signals, table.T[len(stamp) :], strict=True)), numbers + 1)


def _place(path: Path, types: Any, kind: str, topic: str, signal: str) -> _Path:
    joint, _, field = (wanted := signal[len(topic) + 1 :]).rpartition("/")
    named = joint and "name" in dict(types[kind][1])
    steps = _steps(types, kind, f"{field}[0]")[:-1] if named else _steps(types, kind, wanted)
    if not steps:
        remedy = f"its fields are {listed(name for name, _ in types[kind][1])}, as in `ros2 topic echo`"
        raise log_fault(path, f'{kind} of {topic} has no number "{wanted}"', remedy, "no-column")
    return joint or None, steps


def _steps(types: Any, kind: str, field: str) -> tuple[str | int, ...]:
    """Return the fields and elements that lead to a number in messages of a type, none where there is no number."""
    node, steps = (_MESSAGE, kind), list[str | int]()
    for name in re.findall(r"\w+", field) if _FIELD.fullmatch(field) else ():
        if name.isdigit():
            steps.append(int(name))
            node = node[1][0] if node[0] in _ARRAYS else (0, "")
        else:
            steps.append(name)
            node = dict(types[node[1]][1] if node[0] == _MESSAGE else ()).get(name, (0, ""))
    return tuple(steps) if node[0] == 1 and node[1][0] != "string" else ()


def _value(message: Any, joint: str | None, steps: tuple[str | int, ...]) -> float | None:
    """Return a number of a message; None where it names other joints."""
    if joint and joint not in message.name:
        return None
    value = message
    for step in steps:
        value = value[step] if isinstance(step, int) else getattr(value, step)
    return float(value[message.name.index(joint)] if joint else value)


def _on_one_clock(
    path: Path, series: dict[str, _Series], outputs: Sequence[str], time: str, findings: list[Finding]
) -> LogTable:
    """Return signals at the times of the outputs, inputs of other topics averaged from each to the next one."""
    topics = [topic for topic, each in series.items() if not each.columns.keys().isdisjoint(outputs)]
    if len(topics) > 1:
        problem = f"the outputs are of {len(topics)} topics, expected one"
        raise log_fault(path, problem, "take them from one topic", "no-column")
    clock, others = series[topics[0]], {topic: each for topic, each in series.items() if topic != topics[0]}
    if not clock.stamped:
        message = f"messages of {topics[0]} have no stamp of their own, so that the time of their receipt was taken"
        findings.append(Finding("receive-time", "warning", str(path), message, "publish with header.stamp"))
    start = max((int(np.searchsorted(clock.time, each.time.min())) for each in others.values()), default=0)
    seconds = (clock.time[start:] - clock.time[0]) * 1e-9
    if not seconds.size:
        raise log_fault(path, "its topics do not overlap in time", "record them together", "no-data")
    if start:
        message = f"{start} messages of {topics[0]} come before the first one of an input, and were left out"
        remedy = "start the recorder before the axis"
        findings.append(Finding("late-input", "repaired", f"{path}: message 1", message, remedy, start))
    columns = {name: values[start:] for name, values in clock.columns.items()}
    edges = np.append(seconds, 2 * seconds[-1] - seconds[-2:][0])
    increasing = (np.diff(edges) > 0).all()
    for topic, each in others.items():
        if each.stamped != clock.stamped:
            problem = f"{topic} and {topics[0]} are stamped by different clocks"
            raise log_fault(path, problem, "record both with header.stamp, or both without", "clocks")
        order = np.argsort(each.time, kind="stable")
        at = (each.time[order] - clock.time[0]) * 1e-9
        for name, values in each.columns.items():
            held = values[order][np.searchsorted(at, seconds, side="right") - 1]
            columns[name] = held_mean(at, values[order, None], edges)[:, 0] if increasing else held
        message = f"signals of {topic} were brought to the times of {topics[0]}, each message held until the next"
        findings.append(Finding("held-input", "repaired", str(path), message, "nothing to do"))
    return LogTable(columns | {time: seconds}, clock.numbers[start:].tolist(), "message", str(path), tuple(findings))

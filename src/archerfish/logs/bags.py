"""Logs in ROS bags of ROS 1 and ROS 2, read through rosbags, on the clock of the outputs' topic.

A signal is named TOPIC/FIELD with the field's path as ROS tools spell it ("/joint_states/position[0]",
"/gimbal/angle.z", "/gimbal/angle/z"), or TOPIC/JOINT/FIELD where messages name their values
("/joint_states/yaw/position"). A quaternion has fields yaw, pitch and roll ("/imu/orientation/yaw"): angles [rad] about
z, y and x, of which pitch is positive with the nose down, as in ROS.
"""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from archerfish.errors import InputError
from archerfish.logs.recording import Finding, LogTable, Signals, Values, listed, log_fault, log_files

_MCAP, _MCAP_FOOTER = b"\x89MCAP0\r\n", b"\x02\x14" + bytes(27)
_LARGEST_LAG_S, _SMALL_LAG_S = 1.0, 0.05
"""Differences of stamps from receipts, between topics: from two clocks, and those that a delay may come from."""
ENCODINGS = {"protobuf", "jsonschema", "flatbuffer", "ros1msg"}
"""Of messages in MCAP files, but for those of ROS 2, by which rosbags looks for a reader."""
_LISTED = 8  # elements of an array, up to which they are listed
_Series = tuple[Any, Values]
RECOVER = "copy the bag again, or try `mcap recover`, `ros2 bag reindex` or `rosbag reindex`"


def read_bag(path: Path, signals: Signals) -> LogTable:
    """Read signals from a bag, each message in a row of its own, and the times of the messages as "time_s".

    Time is the sender's (header.stamp) where the messages have it, else that of their receipt.

    Args:
      path: .bag, .db3 or .mcap file, or the folder of a ROS 2 bag.
      signals: their names; of messages with equal times those of the last output's topic come last.

    Raises:
      ImportError: if rosbags is not installed.
      InputError: if a record is lost, or a topic or a field is not in it.
      Exception: whatever a damaged byte leads the libraries to.
    """
    findings: list[Finding] = []
    with _reader(path, findings) as reader:
        of = {signal: _topic(path, reader, signal, signals) for signal in (*signals.inputs, *signals.outputs)}
        order = sorted(set(of.values()), key=of[signals.outputs[-1]].__eq__)
        series = [_series(path, reader, topic, of, findings) for topic in order]
    return _one_table(path, series, list(of), findings)


def bag_signals(path: Path) -> tuple[str, ...]:
    """Return the numbers that the first message of each topic has, as TOPIC/FIELD or TOPIC/JOINT/FIELD.

    Raises:
      ImportError: if rosbags is not installed.
      Exception: whatever a damaged byte leads the libraries to.
    """
    names = list[str]()
    with _reader(path, []) as reader:
        for topic, info in sorted(reader.topics.items()):
            for _, _, content in itertools.islice(reader.messages(connections=info.connections), 1):
                names += _numbers(topic, "", reader.deserialize(content, info.msgtype))
    return tuple(names)


def bag_tables(path: Path) -> Iterator[LogTable]:
    """Yield a table of each topic that has numbers, with the times of its messages as "time_s".

    Raises:
      ImportError: if rosbags is not installed.
      Exception: whatever a damaged byte leads the libraries to.
    """
    signals, findings = bag_signals(path), list[Finding]()
    with _reader(path, findings) as reader:
        of = {signal: _topic(path, reader, signal, Signals((), (), None)) for signal in signals}
        for topic in dict.fromkeys(of.values()):
            own = {signal: each for signal, each in of.items() if each == topic}
            yield _one_table(path, [_series(path, reader, topic, own, findings)], list(own), findings)


def _numbers(topic: str, field: str, value: Any, joints: Sequence[str] = ()) -> Iterator[str]:
    """Yield the names of the numbers in a message or a field, without those of long arrays, as covariances."""
    if isinstance(value, int | float | np.number):
        yield f"{topic}/{field}"
    elif isinstance(value, np.ndarray | list):
        if joints and len(joints) == len(value):
            yield from (f"{topic}/{joint}/{field}" for joint in joints)
        elif len(value) <= _LISTED:
            for index, element in enumerate(value):
                yield from _numbers(topic, f"{field}[{index}]", element)
    elif _is_quaternion(value):
        yield from (f"{topic}/{field}.{angle}" for angle in ("yaw", "pitch", "roll"))
    elif hasattr(value, "__msgtype__"):
        for part in value.__dataclass_fields__:
            if part not in ("header", "name", "__msgtype__"):
                path = f"{field}.{part}".removeprefix(".")
                yield from _numbers(topic, path, getattr(value, part), getattr(value, "name", ()))


@contextmanager
def _reader(path: Path, findings: list[Finding]) -> Iterator[Any]:
    """Open a bag; what was left out of its files is added to the findings."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with TemporaryDirectory() as folder:
        indexed = (path / "metadata.yaml").is_file()
        files = [path] if indexed else [_whole(file, folder, findings) for file in log_files(path)]
        with AnyReader(files, default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            if not reader.connections:
                raise ValueError("it has no topics")
            yield reader


def _whole(file: Path, folder: str, findings: list[Finding]) -> Path:
    """Return a bag's file, or a copy in a folder without the record that a recorder left half when it was stopped."""
    content = file.read_bytes()
    if not content.startswith(_MCAP) or content.endswith(_MCAP):
        return file
    end = after = len(_MCAP)  # of its last whole record, which are a type, the length of what follows, and that
    written = len(content.rstrip(b"\0"))
    while after <= len(content) and end < written:
        end, after = after, after + 9 + int.from_bytes(content[after + 1 : after + 9], "little")
        if content[end : end + 1] == b"\0" and end < written:
            raise ValueError(f"its records break off at byte {end}")
    (copy := Path(folder, file.name)).write_bytes(content[:end] + _MCAP_FOOTER + _MCAP)
    message, remedy = f"the last {len(content) - end} bytes are no whole record", "stop the recorder before copying"
    findings.append(Finding("truncated", "repaired", str(file), f"{message}, and were left out", remedy))
    return copy


def _topic(path: Path, reader: Any, signal: str, signals: Signals) -> str:
    inside = f"/{signal.removeprefix('/')}"
    named = {f"/{topic.removeprefix('/')}": topic for topic in reader.topics}
    if found := [topic for place, topic in named.items() if inside.startswith((f"{place}/", f"{place}."))]:
        return str(max(found, key=len))
    remedy = f"it has {listed(bag_signals(path))}; {signals._replace(time=None).remedy(())}"
    raise log_fault(path, f'has no topic of signal "{signal}"', remedy, "no-column")


def _series(path: Path, reader: Any, topic: str, of: dict[str, str], findings: list[Finding]) -> _Series:
    """Read signals of a topic, without the messages that name other joints alone.

    Returns:
      Number in the topic, receipt and stamp [ns] of N messages, (3, N), and signals, (N, m), NaN where not in them.
    """
    info = reader.topics[topic]
    _, described = reader.typestore.fielddefs.get(info.msgtype, ((), ()))
    fields = [name for name, _ in described]
    steps = {signal: _steps(signal, topic, fields) for signal, own in of.items() if own == topic}
    joints, times, rows, seen, count = {joint for joint, _ in steps.values()}, [], [], {""}, 0
    for count, (_, received, content) in enumerate(reader.messages(connections=info.connections), 1):
        try:
            message = reader.deserialize(content, info.msgtype)
            if any(joints) and not hasattr(message, "name"):
                there = listed(_numbers(topic, "", message))
                problem = f"the messages of {topic} have no {listed(steps)}"
                raise log_fault(path, problem, f"they have {there}", "no-column")
            seen.update(here := message.name if any(joints) else ())
            if not all(joints) or not joints.isdisjoint(here):
                rows.append(
                    [_value(path, topic, name, message, *steps[name]) if name in steps else None for name in of]
                )
                stamp = getattr(getattr(message, "header", None), "stamp", None)
                times.append((count, received, stamp.sec * 10**9 + stamp.nanosec if stamp else 0))
        except InputError:
            raise
        except Exception as error:  # of any kind
            problem = f"message {count} of {topic} has no sound content ({error!s:.200})"
            remedy = "copy the bag again" if fields else f"record MCAP, which defines the fields of {info.msgtype}"
            raise log_fault(path, problem, remedy, "damaged") from error
    if info.msgcount > count:  # a reader may end at a damaged record
        raise log_fault(path, f"{count} of {info.msgcount} messages of {topic} can be read", RECOVER, "damaged")
    if not rows or joints - seen:
        problem = f"topic {topic} has {count} messages, none with {listed(joints - seen)}"
        raise log_fault(path, problem, f"it has {listed(sorted(seen))}", "no-column" if count else "no-data")
    if count > len(rows):
        message = f"messages of {topic} that name other joints left out: {count - len(rows)}"
        findings.append(Finding("other-joints", "repaired", str(path), message, "nothing to do"))
    return np.array(times, dtype=np.int64).T, np.array(rows, dtype=np.float64)


def _steps(signal: str, topic: str, fields: Sequence[str]) -> tuple[str, list[str]]:
    """Return the joint that a signal names, if its topic has no such field, and the path to the field."""
    joint, field = "", signal.removeprefix("/")[len(topic.removeprefix("/")) + 1 :]
    if re.split(r"[./\[]", field)[0] not in fields:
        joint, _, field = field.rpartition("/")
    return joint, re.findall(r"[^./\[\]]+", field)


def _value(path: Path, topic: str, signal: str, message: Any, joint: str, steps: Sequence[str]) -> float | None:
    """Return a number of a message; None where it does not name the joint."""
    names, value = list(getattr(message, "name", ())), message
    try:
        for step in steps:
            if _is_quaternion(value) and step in ("x", "y", "z", "w"):
                remedy = f'name "{signal[:-2]}/yaw", or its pitch or roll'
                raise log_fault(path, f'"{signal}" is a component of a quaternion, no angle', remedy, "no-column")
            if _is_quaternion(value) and step in ("yaw", "pitch", "roll"):
                return _angle(step, value.w, value.x, value.y, value.z)
            value = value[int(step)] if step.isdigit() else getattr(value, step)
        if joint:
            return float(value[names.index(joint)]) if joint in names else None
        if not np.ndim(value):
            return float(value)
    except (AttributeError, IndexError, TypeError) as error:
        there = listed(_numbers(topic, "", message))
        raise log_fault(
            path, f'the messages of {topic} have no "{signal}"', f"they have {there}", "no-column"
        ) from error
    remedy = f'name an element, "{signal}[0]", or a joint, as TOPIC/JOINT/FIELD'
    raise log_fault(path, f'"{signal}" is an array of {len(value)}', remedy, "no-column")


def _is_quaternion(value: Any) -> bool:
    return str(getattr(value, "__msgtype__", "")).endswith("/Quaternion")


def _angle(name: str, w: float, x: float, y: float, z: float) -> float:
    """Return an angle of a quaternion of any length [rad]: of rotations about z, y and x, in this order."""
    forward = w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)  # where the x axis points
    if name == "roll":
        return math.atan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
    return math.atan2(forward[1], forward[0]) if name == "yaw" else math.atan2(-forward[2], math.hypot(*forward[:2]))


def _one_table(path: Path, series: list[_Series], signals: list[str], findings: list[Finding]) -> LogTable:
    """Return the messages of all topics in order of time, and of the topics where times are equal."""
    if len(stamped := {bool(stamps.any()) for (_, _, stamps), _ in series}) > 1:
        problem = "some topics have header.stamp, and some the time of their receipt alone"
        raise log_fault(path, problem, "record all with header.stamp, or all without", "clocks")
    # Where all topics are recorded: a simulated clock may be slower than that of the receipts.
    begin = max(received[0] for (_, received, _), _ in series)
    end = min(received[-1] for (_, received, _), _ in series)
    both = [(received >= begin) & (received <= end) for (_, received, _), _ in series]
    lags = [
        float(np.median((stamps - received)[among])) * 1e-9 if among.any() else 0.0
        for ((_, received, stamps), _), among in zip(series, both, strict=True)
    ]
    by_receipt = stamped == {False} or (apart := max(lags) - min(lags)) > _LARGEST_LAG_S
    if stamped == {True} and apart > _SMALL_LAG_S:
        message = f"header.stamp of the topics differs from their receipts by {min(lags):.4g} to {max(lags):.4g} s: "
        message += "two clocks, and the receipts were taken" if by_receipt else "their delay is in doubt by as much"
        severity: Literal["repaired", "warning"] = "repaired" if by_receipt else "warning"
        findings.append(Finding("clocks", severity, str(path), message, "set all clocks by one"))
    if stamped == {False}:
        message = "messages have no stamp of their own: the time of their receipt was taken"
        findings.append(Finding("receive-time", "warning", str(path), message, "publish with header.stamp"))
    clocks = [times[1 if by_receipt else 2] for times, _ in series]
    # A time that goes back in a topic is to be found, not sorted away.
    order = np.argsort(np.concatenate([np.maximum.accumulate(clock) for clock in clocks]), kind="stable")
    times, numbers = np.concatenate(clocks)[order], np.concatenate([number for (number, *_), _ in series])[order]
    columns = dict(zip(signals, np.concatenate([values for _, values in series])[order].T, strict=True))
    columns["time_s"] = (times - times.min()) * 1e-9
    return LogTable(columns, numbers.tolist(), "message", str(path), tuple(findings))

"""Where the numbers lie in a serialised ROS message: CDR (ROS 2) and ROS 1's packed form.

A layout is found once, by walking one message along its type; every message with the same structure (the same lengths
of its strings and sequences) is then read by position, thousands at a time. That is what makes a minute at 1 kHz a
matter of a tenth of a second.
"""

import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_CODES = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1", "octet": "u1",
    "uint16": "u2", "int16": "i2", "uint32": "u4", "int32": "i4", "uint64": "u8", "int64": "i8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4  # kinds of node in a type definition of rosbags

_ENCAPSULATION = 4  # bytes before a CDR message: byte order and options

TypeDefinitions = Mapping[str, tuple[Any, list[tuple[str, Any]]]]


class MessageLayout(NamedTuple):
    """Positions of the fields in messages of one structure."""

    numbers: dict[str, tuple[int, str]]
    """Field path ("position[0]", "header.stamp.sec") → offset in bytes and NumPy type."""
    strings: dict[str, str]
    """Field path → text, the same in all messages of the structure."""
    structure: NDArray[np.bool_]
    """Bytes that make the structure: lengths and texts, shape (bytes of a message,)."""


def message_layout(raw: bytes, message_type: str, types: TypeDefinitions, *, ros2: bool) -> MessageLayout:
    """Find where the fields of a message lie.

    Args:
      raw: one message.
      message_type: its type, for instance "sensor_msgs/msg/JointState".
      types: definitions of the types, as rosbags keeps them.
      ros2: whether it is CDR (fields aligned to their size), else ROS 1 (packed, little-endian).

    Raises:
      struct.error: if the message is shorter than its type says.
      KeyError: if a type is not defined.
    """
    walk = _Walk(raw, types, ros2)
    walk.message("", message_type)
    return MessageLayout(walk.numbers, walk.strings, walk.structure)


class _Walk:
    """The position while a message is walked, and what was found."""

    def __init__(self, raw: bytes, types: TypeDefinitions, ros2: bool) -> None:
        self.raw, self.types, self.ros2 = raw, types, ros2
        self.at = _ENCAPSULATION if ros2 else 0
        self.order = ">" if ros2 and raw[1] == 0 else "<"
        self.numbers: dict[str, tuple[int, str]] = {}
        self.strings: dict[str, str] = {}
        self.structure = np.zeros(len(raw), dtype=np.bool_)
        self.structure[: self.at] = True

    def message(self, path: str, name: str) -> None:
        for field, kind in self.types[name][1]:
            self.node(f"{path}.{field}" if path else field, kind)

    def node(self, path: str, kind: Any) -> None:
        readers: dict[int, Callable[[str, Any], None]] = {
            _BASE: self.base,
            _ARRAY: self.array,
            _SEQUENCE: self.sequence,
        }
        if int(kind[0]) == _NAME:
            self.message(path, kind[1])
        else:
            readers[int(kind[0])](path, kind[1])

    def array(self, path: str, of: Any) -> None:
        for index in range(of[1]):
            self.node(f"{path}[{index}]", of[0])

    def sequence(self, path: str, of: Any) -> None:
        count = self.length()
        if count > len(self.raw):
            raise struct.error(f"{path} claims {count} elements")
        self.array(path, (of[0], count))

    def base(self, path: str, of: Any) -> None:
        if of[0] in ("string", "wstring"):
            size = self.length()
            content = self.raw[self.at : self.at + size]
            self.structure[self.at : self.at + size] = True
            self.strings[path] = content.rstrip(b"\0").decode("utf-8", "replace")
            self.at += size
            return
        code = _CODES.get(of[0])
        if code is None:
            raise struct.error(f"{path} is of type {of[0]}, which is not read")
        self.numbers[path] = (self.advance(int(code[1])), self.order + code)

    def length(self) -> int:
        start = self.advance(4)
        self.structure[start : start + 4] = True
        return int(struct.unpack_from(f"{self.order}I", self.raw, start)[0])

    def advance(self, size: int) -> int:
        """Return where a field of a size begins, and step behind it."""
        if self.ros2:
            self.at += -(self.at - _ENCAPSULATION) % size
        start, self.at = self.at, self.at + size
        if self.at > len(self.raw):
            raise struct.error(f"ends after {len(self.raw)} bytes")
        return start

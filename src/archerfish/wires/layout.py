"""A frame as a table: constants, numbers with their scales, and checksums over all bytes before them.

Each field is a text:

- `= 53 50`: constant bytes; every frame begins with some, by which it is found
- `NAME TYPE`: a number; TYPE is one of u8 i8 u16 i16 u32 i32 u64 i64 f32 f64
- `NAME TYPE x4`: four numbers
- `NAME TYPE *0.001 +20`: the value is 0.001 times the number on the wire, plus 20; either may be left out
- `crc NAME`: one of `CHECKSUMS`, least significant byte first; `crc NAME big`: most significant byte first
"""

import re
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from archerfish.errors import InputError, meant
from archerfish.wires.checksums import CHECKSUMS, checksum

_TYPES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q"}
_TYPES |= {"f32": "f", "f64": "d"}
_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_FIELD = re.compile(rf"([a-z]\w*) ({'|'.join(_TYPES)})(?: x([1-9]\d?))?(?: \*({_NUMBER}))?(?: \+({_NUMBER}))?")
_FORMS = f'"= 53 50", "crc NAME" or "NAME TYPE xCOUNT *SCALE +OFFSET", TYPE one of {" ".join(_TYPES)}'


class _Numbers(NamedTuple):
    """Numbers of one name."""

    name: str
    place: int  # of the first byte
    packing: struct.Struct
    scale: float
    offset: float
    is_whole: bool


class Layout:
    """A frame of fixed length."""

    def __init__(self, name: str, fields: Sequence[str], endian: str = "little") -> None:
        """Read the table of a frame.

        Args:
          name: of the frame.
          fields: texts as above, in the order of the bytes.
          endian: "little" or "big", of its numbers; not of its checksums.

        Raises:
          InputError: if a text is no field, or the frame begins with no constant.
        """
        self.name, self.length = name, 0
        self._order = "<" if endian == "little" else ">"
        self._constants: list[tuple[int, bytes]] = []
        self._checksums: list[tuple[int, str]] = []
        self._numbers: dict[str, _Numbers] = {}
        for number, text in enumerate(fields, 1):
            try:
                self.length += self._add(text)
            except ValueError as error:
                problem = error if isinstance(error, InputError) else f"expected {_FORMS}; correct it"
                raise InputError(f"field {name}.fields: entry {number}, {text[:60]!r}: {problem}") from error
        if not fields or not fields[0].startswith("="):
            raise InputError(f"field {name}.fields: a frame begins with constant bytes; write them first, as = 53 50")
        self.head = self._constants[0][1]
        """Bytes by which the frame is found in a stream."""

    def __repr__(self) -> str:
        return f"Layout({self.name}, {self.length} bytes)"

    @property
    def names(self) -> list[str]:
        """Of its numbers."""
        return [*self._numbers]

    def step(self, name: str) -> float:
        """Return the least difference between two values of a number on the wire; zero where it is floating point."""
        numbers = self._numbers[name]
        return abs(numbers.scale) if numbers.is_whole else 0.0

    def is_valid(self, frame: bytes) -> bool:
        """Whether bytes are this frame: of its length, with its constants and checksums."""
        if len(frame) != self.length:
            return False
        if any(not frame.startswith(constant, place) for place, constant in self._constants):
            return False
        return all(frame.startswith(checksum(name, frame[:place]), place) for place, name in self._checksums)

    def decode(self, frame: bytes) -> dict[str, Any]:
        """Return the numbers of a valid frame by their names, a list where a name has several."""
        values = dict[str, Any]()
        for name, place, packing, scale, offset, _ in self._numbers.values():
            numbers = [number * scale + offset for number in packing.unpack_from(frame, place)]
            values[name] = numbers if len(numbers) > 1 else numbers[0]
        return values

    def encode(self, values: Mapping[str, float | Sequence[float]]) -> bytes:
        """Return the frame of some numbers; those that are not given are zero on the wire.

        Raises:
          InputError: if there is no such number, or the wire has no room for its value.
        """
        if unknown := sorted(values.keys() - self._numbers.keys()):
            remedy = meant(unknown[0], self._numbers, f"they are {', '.join(self._numbers)}")
            raise InputError(f"frame {self.name} has no number {unknown[0]}; {remedy}")
        frame = bytearray(self.length)
        for place, constant in self._constants:
            frame[place : place + len(constant)] = constant
        for name, value in values.items():
            self._pack(frame, self._numbers[name], value if isinstance(value, Sequence) else [value])
        for place, check in self._checksums:
            code = checksum(check, bytes(frame[:place]))
            frame[place : place + len(code)] = code
        return bytes(frame)

    def _pack(self, frame: bytearray, field: _Numbers, values: Sequence[float]) -> None:
        try:
            numbers: list[float] = [(value - field.offset) / field.scale for value in values]
            if field.is_whole:
                numbers = [round(number) for number in numbers]
            field.packing.pack_into(frame, field.place, *numbers)
        except (struct.error, ValueError, OverflowError) as error:
            text = f"frame {self.name}: the wire has no room for {field.name} {list(values)} ({error})"
            raise InputError(f"{text}; limit it, or choose another type") from error

    def _add(self, text: str) -> int:
        """Add a field at the end; return its length in bytes."""
        kind, _, rest = text.partition(" ")
        if kind == "=":
            constant = bytes.fromhex(rest)
            self._constants.append((self.length, constant))
            return len(constant)
        if kind == "crc":
            check = rest.removesuffix(" big")
            if check not in CHECKSUMS:
                remedy = meant(check, CHECKSUMS, f"they are {', '.join(CHECKSUMS)}")
                raise InputError(f"there is no such checksum; {remedy}")
            self._checksums.append((self.length, rest))
            return CHECKSUMS[check].size
        match = _FIELD.fullmatch(text)
        if match is None:
            raise InputError(f"expected {_FORMS}; correct it")
        name, code, count, scale, offset = match.groups()
        if name in self._numbers or float(scale or 1.0) == 0.0:
            raise InputError("a name is there once, and no scale is zero; correct it")
        packing = struct.Struct(self._order + _TYPES[code] * int(count or 1))
        is_whole = not code.startswith("f")
        numbers = _Numbers(name, self.length, packing, float(scale or 1.0), float(offset or 0.0), is_whole)
        self._numbers[name] = numbers
        return packing.size

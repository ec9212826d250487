"""Records: strict structs whose fields are checked, whether a file or a program makes them.

msgspec checks types and bounds. Arrays are decoded as nested lists of numbers, for NumPy alone would take texts,
booleans and None as well.
"""

import functools
import re
import reprlib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from archerfish2.errors import InputError, file_error, one_line
from archerfish2.storage import plain, read_json, write_json

T = TypeVar("T")
Matrix = NDArray[np.float64]
Counts = NDArray[np.int64]
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
"""A finite number; msgspec's bounds refuse NaN, too."""
Count = Annotated[int, Meta(ge=0, le=1_000_000)]
Angle = Annotated[float, Meta(ge=-100.0, le=100.0)]
"""[rad]."""
Time = Annotated[float, Meta(ge=-10.0, le=10.0)]
"""[s]."""
Duration = Annotated[float, Meta(ge=0.0, le=10.0)]
"""[s]."""
Deviation = Annotated[float, Meta(ge=0.0, le=10.0)]
"""A standard deviation [rad or m]."""
Intervals = dict[str, tuple[Number, Number]]
"""95 % interval of each estimated field."""
Fact = str | int | Number | None
Provenance = dict[str, Fact | list[str] | dict[str, Fact]]
"""Seed, commit, library versions and input hashes of the making."""


class Struct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, eq=False):
    """A record whose fields are checked against their types and bounds, whether a file or a program makes it.

    Raises:
      InputError: naming the field, what it is and what was expected.
    """

    def __post_init__(self) -> None:
        for name, kind in _types(type(self)).items():
            value = plain(getattr(self, name))
            try:
                value = msgspec.convert(value, kind, dec_hook=_array)
            except msgspec.ValidationError as error:
                raise InputError(f"{type(self).__name__}: {_fault(error, value, f'.{name}')}; correct it") from error
            msgspec.structs.force_setattr(self, name, value)

    def replace(self, **changes: Any) -> Self:
        """Return the same record with some fields changed."""
        return type(self)(**{name: getattr(self, name) for name in self.__struct_fields__} | changes)


@functools.cache
def _types(kind: type[Struct]) -> dict[str, Any]:
    return {each.name: each.type for each in msgspec.structs.fields(kind)}


def _array(kind: Any, value: Any) -> Any:
    number: Any = Count if kind == Counts else Number
    nested = value
    for _ in range(3):  # the largest rank; a file may nest lists as deep as it likes
        if isinstance(nested, list):
            number, nested = list[number], nested[0] if nested else None
    try:
        array = np.array(msgspec.convert(value, number), np.int64 if kind == Counts else np.float64)
    except msgspec.ValidationError as error:
        raise ValueError(str(error).replace("`$", "`")) from None
    array.flags.writeable = False
    return array


def _fault(error: msgspec.ValidationError, content: Any, name: str = "") -> str:
    """Return which field is wrong, what was expected and what is there."""
    if isinstance(error.__cause__, InputError):  # of a record inside, which has said it all
        return str(error.__cause__).removesuffix("; correct it")
    text, _, place = str(error).replace("`", "").partition(" - at $")
    if text.startswith("Expected") and ", got" not in text and "..." not in place:
        for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place):
            content = content[key or int(index)]
        text += f", got {reprlib.repr(content)}"
    field = f"field {(name + place).removeprefix('.')}: " if name + place else ""
    return one_line(field + text[0].lower() + text[1:])


def read_struct(path: Path, kind: type[T], schema: str, remedy: str) -> T:
    """Read a JSON file as a struct.

    Args:
      path: the file.
      kind: what it holds beside its schema.
      schema: name and version, for instance "archerfish.plant/3".
      remedy: what to do about another or a damaged file.

    Raises:
      InputError: naming the field, what it is and what was expected.
    """
    content = read_json(path, remedy)
    found = content.pop("schema", None) if isinstance(content, dict) else type(content).__name__
    if found != schema:
        raise file_error(path, f'field schema: expected "{schema}", got {reprlib.repr(found)}', remedy)
    try:
        return msgspec.convert(content, kind, dec_hook=_array)
    except msgspec.ValidationError as error:
        raise file_error(path, _fault(error, content), remedy) from error


class Record(Struct, frozen=True, kw_only=True):
    """A record with a file of its own."""

    schema: ClassVar[str]
    remedy: ClassVar[str] = "identify again"

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a record.

        Raises:
          InputError: if the file is no such record, or a field is missing, unknown or out of range.
        """
        return read_struct(Path(path), cls, cls.schema, cls.remedy)

    def save(self, path: str | Path) -> None:
        """Write the record to a .json file."""
        write_json(Path(path), {"schema": self.schema, **plain(self)})


def check_intervals(intervals: Intervals) -> None:
    """Refuse intervals whose ends are swapped."""
    for name, (low, high) in intervals.items():
        if low > high:
            raise InputError(f"intervals.{name}: expected low ≤ high, got {low:g} and {high:g}")

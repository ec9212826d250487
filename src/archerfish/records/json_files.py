"""JSON and TOML files, read strictly: what is not as expected is named in one line.

msgspec checks types and bounds. Arrays are decoded as nested lists of numbers, for NumPy alone would take texts,
booleans and None as well.
"""

import json
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from archerfish.errors import InputError, file_error, meant, one_line
from archerfish.storage import read_bytes, text_of, write_bytes

T = TypeVar("T")
Matrix = NDArray[np.float64]
Counts = NDArray[np.int64]
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
"""A finite number; msgspec's bounds refuse NaN, too."""
_MOST_TOML_BYTES = 1_000_000  # people write these files
SampleCount = Annotated[int, Meta(ge=0, le=1_000_000)]


def read_json(path: Path, remedy: str = "write the file again") -> Any:
    """Read a JSON file.

    Raises:
      InputError: if it is missing, unreadable, larger than `MOST_BYTES` or not JSON; neither NaN, infinity nor a field
        that is there twice, which Python would read, are.
    """
    return parse_json(read_bytes(path, remedy), path, remedy)


def parse_json(content: bytes, path: Path, remedy: str) -> Any:
    """Return the content of JSON in a file; see `read_json`.

    Raises:
      InputError: if it is not JSON, or has NaN, infinity or a field twice.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        fields = dict(pairs)
        if len(fields) < len(pairs):
            raise ValueError(f"a field is there twice, among {', '.join(reprlib.repr(name) for name in fields)}")
        return fields

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number")

    try:
        return json.loads(text_of(content), object_pairs_hook=unique, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise file_error(path, f"is not JSON ({one_line(str(error))[:200]})", remedy) from error


def read_toml(path: Path, remedy: str) -> dict[str, Any]:
    """Read a TOML file.

    Args:
      path: the file.
      remedy: what to do about a damaged file.

    Raises:
      InputError: if it is missing, unreadable, larger than a megabyte or not TOML.
    """
    import tomllib  # slow to load

    content = read_bytes(path, remedy)
    if len(content) > _MOST_TOML_BYTES:
        raise file_error(path, f"has {len(content)} bytes, expected at most {_MOST_TOML_BYTES}", remedy)
    try:
        return tomllib.loads(text_of(content))
    except (ValueError, RecursionError) as error:  # a number of thousands of digits is a ValueError, too
        raise file_error(path, f"is not TOML ({one_line(str(error))[:200]})", remedy) from error


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
    return to_struct(read_json(path, remedy), path, kind, schema, remedy)


def to_struct(content: Any, path: Path, kind: type[T], schema: str | None, remedy: str) -> T:
    """Return the content of a file as a struct; see `read_struct`. One without a schema has None.

    Raises:
      InputError: naming the field, what it is and what was expected.
    """
    found = content.pop("schema", None) if isinstance(content, dict) else type(content).__name__
    if found != schema:
        raise file_error(path, f'field schema: expected "{schema}", got {reprlib.repr(found)}', remedy)
    try:
        return msgspec.convert(content, kind, dec_hook=decode)
    except (msgspec.ValidationError, UnicodeEncodeError) as error:
        raise file_error(path, fault(error, content, kind=kind), remedy) from error


def decode(kind: Any, value: Any) -> Any:
    """Decode paths, and arrays as nested lists of numbers, as a hook of msgspec.

    Raises:
      ValueError: if a value is no such list, which msgspec turns into a `ValidationError`.
    """
    if kind is Path:
        return Path(value)
    number: Any = SampleCount if kind == Counts else Number
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


def fault(error: Exception, content: Any, name: str = "", kind: Any = None) -> str:
    """Return which field is wrong, what was expected and what is there.

    Args:
      error: of msgspec.
      content: what was converted.
      name: of the content, before the names of its fields.
      kind: to which it was converted, for the words and fields that it may have.
    """
    if isinstance(error.__cause__, InputError):  # of a record inside, which has said it all
        return str(error.__cause__).removesuffix("; correct it")
    text, _, place = re.sub(r" - at key in \$", " - at $", str(error).replace("`", "")).partition(" - at $")
    expected = _expected(text, kind, place)
    if text.startswith("Expected") and ", got" not in text and "..." not in place:
        for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place):
            content = content[key or int(index)]
        text += f", got {reprlib.repr(content)}"
    field = f"field {(name + place).removeprefix('.')}: " if name + place else ""
    return one_line(field + text[0].lower() + text[1:] + expected)


def _expected(text: str, kind: Any, place: str) -> str:
    """Return what may be in the place of an unknown word or field; nothing for other errors."""
    whole = kind
    unknown = re.sub("^(Invalid enum value|Object contains unknown field) ", "", text)
    for name in re.findall(r"\.(\w+)", place):
        kind = next((field.type for field in _fields(kind) if field.name == name), None)
    if text.startswith("Invalid enum value"):
        literals = [part for part in (kind, *get_args(kind)) if get_origin(part) is Literal]
        known = [str(word) for literal in literals for word in get_args(literal) if word != ""]
        expected = f", expected one of {', '.join(known)}" if known else ""
    elif text.startswith("Object contains unknown field"):
        if place and any(field.name == unknown for field in _fields(whole)):
            return ", which belongs to the top level (in TOML, above the tables)"
        known, expected = [field.name for field in _fields(kind)], ""
    else:
        return ""
    near = "" if unknown.isdecimal() else meant(unknown.strip("'"), known, "")
    return f"{expected}; {near}" if near else expected


def _fields(kind: Any) -> tuple[msgspec.structs.FieldInfo, ...]:
    """Return the fields of a record, or of that in a union; none of anything else."""
    records = [part for part in (kind, *get_args(kind)) if isinstance(part, type) and issubclass(part, msgspec.Struct)]
    return msgspec.structs.fields(records[0]) if records else ()


def plain(value: Any) -> Any:
    """Return what JSON can hold of structs, arrays and paths.

    Raises:
      InputError: if there is something else.
    """

    def convert(each: Any) -> Any:
        if isinstance(each, np.ndarray | np.generic):
            return each.tolist()
        if isinstance(each, Path):
            return str(each)
        raise InputError(f"expected numbers, texts and records, got {one_line(repr(each))[:60]}; give one of these")

    return msgspec.to_builtins(value, enc_hook=convert)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON whole, with a line per field; the content is as `plain` returns it, without NaN and infinity."""
    lines = (f" {json.dumps(name)}: {json.dumps(value, allow_nan=False)}" for name, value in content.items())
    write_bytes(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())

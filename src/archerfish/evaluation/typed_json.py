"""Frozen dataclasses to and from JSON, with the path of the field in every complaint."""

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Sequence
from typing import Any, TypeVar

from archerfish.records.errors import InputError

Record = TypeVar("Record")

_SCALARS = {float: (int, float), int: (int,), bool: (bool,), str: (str,)}
_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text"}


def from_json(kind: type[Record], value: Any) -> Record:
    """Build a frozen dataclass from what JSON holds, by the annotations of its fields.

    Known are dataclasses, `dict[str, T]`, `tuple[T, ...]`, tuples of fixed length, `T | None`, numbers, texts, booleans
    and `Any`. A field with a default may be missing.

    Raises:
      InputError: naming the first field that is missing, unknown, of another type or not finite.
    """
    return typing.cast(Record, _converted(kind, value, ""))


def _converted(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return _plain(value, where)
    if origin in (typing.Union, types.UnionType):
        (inner,) = (each for each in arguments if each is not type(None))
        return None if value is None else _converted(inner, value, where)
    if origin is dict:
        items = _expect(value, dict, where, "an object").items()
        return {name: _converted(arguments[1], each, _below(where, name)) for name, each in items}
    if origin is tuple:
        return _tuple(arguments, value, where)
    if dataclasses.is_dataclass(kind):
        return _record(kind, value, where)
    return _scalar(kind, value, where)


def _record(kind: Any, value: Any, where: str) -> Any:
    facts = _expect(value, dict, where, "an object")
    known = {each.name: each for each in dataclasses.fields(kind)}
    for name in facts:
        if name not in known:
            raise InputError(f'unknown field "{_below(where, name)}"; known are {", ".join(known)}')
    for name, field in known.items():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and name not in facts:
            raise InputError(f'field "{_below(where, name)}" is missing')
    hints = _hints(kind)
    values = {name: _converted(hints[name], each, _below(where, name)) for name, each in facts.items()}
    try:
        return kind(**values)
    except InputError as error:
        raise InputError(f'field "{where}": {error}' if where else str(error)) from error


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _tuple(arguments: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    items: Sequence[Any] = _expect(value, (list, tuple), where, "a list")
    kinds = [arguments[0]] * len(items) if arguments[-1] is Ellipsis else list(arguments)
    if len(items) != len(kinds):
        raise InputError(f'field "{where}" has {len(items)} entries, expected {len(kinds)}')
    return tuple(
        _converted(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, items, strict=True))
    )


def _scalar(kind: Any, value: Any, where: str) -> Any:
    _expect(value, _SCALARS[kind], where, _WORDS[kind])
    # JSON's true is a Python int as well.
    if isinstance(value, bool) and kind is not bool:
        raise _unexpected(value, where, _WORDS[kind])
    return kind(_finite(value, where))


def _plain(value: Any, where: str) -> Any:
    """Check a value of any kind, deeply, for what JSON can hold."""
    if isinstance(value, dict):
        return {name: _plain(each, _below(where, name)) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each, f"{where}[{i}]") for i, each in enumerate(value)]
    return _finite(_expect(value, (int, float, str, types.NoneType), where, "a number, a text or null"), where)


def _finite(value: Any, where: str) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        raise _unexpected(value, where, "a finite number")
    return value


def _expect(value: Any, kind: type | tuple[type, ...], where: str, words: str) -> Any:
    if not isinstance(value, kind):
        raise _unexpected(value, where, words)
    return value


def _unexpected(value: Any, where: str, words: str) -> InputError:
    found = repr(value)
    shown = found if len(found) <= 60 else f"{found[:57]}..."
    return InputError(f'field "{where}" is {shown}, expected {words}')


def _below(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name

"""Options back from the configuration that a run folder holds, and words that contradict them."""

import types
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from archerfish.records.errors import InputError, file_error

Options = TypeVar("Options")

REMEDY = "put back what was changed"
_PLAIN: dict[Any, Any] = {
    bool: bool,
    int: int,
    float: (int, float),
    str: str,
    Path: str,
    types.NoneType: types.NoneType,
}
"""Type of an option → type of what JSON holds of it."""
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text", Path: "a text"}


def restore_options(kind: type[Options], plain: dict[str, Any], source: Path, prefix: str = "") -> Options:
    """Build options from what `setting.configuration` wrote of them; what it does not hold has its default.

    Args:
      kind: dataclass whose fields are the options.
      plain: name → value, as JSON holds it.
      source: the file that holds it, for messages.
      prefix: of the names in that file, for messages.

    Raises:
      InputError: naming file and field, if a value is out of range, or of another type than the option.
    """
    hints = get_type_hints(kind)
    known = [each.name for each in fields(kind) if each.name in plain]  # type: ignore[arg-type]
    values = {name: _restored(hints[name], f"{prefix}{name}", plain[name], source) for name in known}
    try:
        return kind(**values)
    except InputError as error:
        where = f'"{prefix[:-1]}": ' if prefix else ""
        raise file_error(source, f"{where}{error}", REMEDY) from error


def _restored(hint: Any, name: str, value: Any, source: Path) -> Any:
    kinds = get_args(hint) if get_origin(hint) in (types.UnionType, Union) else (hint,)
    if not any(_fits(each, value) for each in kinds):
        words = dict.fromkeys(_words(each) for each in kinds if each is not types.NoneType)
        raise file_error(source, f'"{name}" is {value!r}, expected {" or ".join(words)}', REMEDY)
    nested = next((each for each in kinds if is_dataclass(each)), None)
    if nested is not None and isinstance(value, dict):
        return restore_options(nested, value, source, f"{name}.")  # type: ignore[arg-type]
    if isinstance(value, str) and Path in kinds:
        return Path(value)
    return tuple(value) if isinstance(value, list) else value


def _fits(kind: Any, value: Any) -> bool:
    """Tell whether a value of JSON can be that of an option of a type."""
    if get_origin(kind) is Literal:
        return isinstance(value, str) and value in get_args(kind)
    if get_origin(kind) is tuple:
        return isinstance(value, list) and all(_fits(get_args(kind)[0], each) for each in value)
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, dict if is_dataclass(kind) else _PLAIN[kind])


def _words(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}"
    return "a list" if get_origin(kind) is tuple else _WORDS.get(kind, "an object")


def with_default_flags(options: Options) -> Options:
    """Return options whose flags are as though none was given: a flag that is set can only be typed as its opposite."""
    changes: dict[str, Any] = {}
    for each in fields(options):  # type: ignore[arg-type]
        value = getattr(options, each.name)
        if is_dataclass(value):
            changes[each.name] = with_default_flags(value)
        elif isinstance(value, bool) and each.default is not MISSING:
            changes[each.name] = each.default
    return replace(options, **changes)  # type: ignore[type-var]


def contradictions(said: Any, begun: Any, free: frozenset[str], prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield option, value as said and value as begun, where the two differ.

    Args:
      said: options that were read with `with_default_flags(begun)` for those that are not given.
      begun: options of the run.
      free: names of options that may change.
      prefix: of the options' names.
    """
    for each in fields(said):
        ours, theirs = getattr(said, each.name), getattr(begun, each.name)
        if each.name in free:
            continue
        if is_dataclass(ours):
            # The files of a robot are options without a prefix.
            yield from contradictions(ours, theirs, free, "" if each.name == "setting" else f"{prefix}{each.name}.")
        elif ours != theirs and not (isinstance(ours, bool) and ours == each.default):
            yield f"--{prefix}{each.name.replace('_', '-')}", ours, theirs

"""Options back from the configuration that a run folder holds, and words that contradict them."""

import types
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, get_args, get_type_hints

from archerfish.records.errors import file_error

Options = TypeVar("Options")


def restore_options(kind: type[Options], plain: dict[str, Any], source: Path) -> Options:
    """Build options from what `setting.configuration` wrote of them; what it does not hold has its default.

    Args:
      kind: dataclass whose fields are the options.
      plain: name → value, as JSON holds it.
      source: the file that holds it, for messages.

    Raises:
      InputError: if a value is out of range, or of another type than a text or a path that the option takes.
    """
    hints = get_type_hints(kind)
    known = [each.name for each in fields(kind) if each.name in plain]  # type: ignore[arg-type]
    return kind(**{name: _restored(hints[name], name, plain[name], source) for name in known})


def _restored(hint: Any, name: str, value: Any, source: Path) -> Any:
    kinds = get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    nested = next((each for each in kinds if is_dataclass(each)), None)
    if nested is not None and isinstance(value, dict):
        return restore_options(nested, value, source)  # type: ignore[arg-type]
    if {str, Path} & set(kinds) and not isinstance(value, str) and not (value is None and types.NoneType in kinds):
        raise file_error(source, f'"{name}" is {value!r}, expected a text', "put back what was changed")
    if isinstance(value, str) and Path in kinds:
        return Path(value)
    return tuple(value) if isinstance(value, list) else value


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

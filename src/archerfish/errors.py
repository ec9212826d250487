"""The error that every bad argument, file or record raises.

One type, so that the command line can print any of them in one line and end with status 2, while a programming fault
keeps its traceback.
"""

import difflib
import functools
import inspect
import numbers
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
_LARGEST = 2**63  # which NumPy has no room for


class InputError(ValueError):
    """Something that was given can't be used: the message names it, what was expected, and what to do."""

    def __init__(self, message: str, code: str | None = None) -> None:
        super().__init__(one_line(message))  # names and contents of files may hold anything
        self.code = code
        """Short, stable name of the fault ("time-backward"), for programs that act on it; None where none is given."""

    def _render_traceback_(self) -> list[str]:
        """Return what a notebook shows: the message, for the code in between is not the user's."""
        return [f"{type(self).__name__}: {self}"]


def file_error(path: str | Path, problem: str, remedy: str, code: str | None = None) -> InputError:
    """Build the error for a file.

    Args:
      path: the file.
      problem: what is wrong, with the line or field and what was expected.
      remedy: what to do about it.
      code: short, stable name of the fault.
    """
    return InputError(f"{path}: {problem}; {remedy}", code)


def meant(name: str, known: Iterable[str], otherwise: str) -> str:
    """Return the remedy for an unknown name: the nearest of those that there are, or if none is near another one."""
    near = difflib.get_close_matches(name.lower(), [*known], 1, cutoff=0.7)
    return f"perhaps you meant {near[0]}" if near else otherwise


def one_line(text: str) -> str:
    """Return a text in one line with what can't be printed escaped: names and contents of files may hold anything."""
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in " ".join(text.split()))


def checked_arguments(verb: Callable[P, R]) -> Callable[P, R]:
    """Have a function refuse, before it begins, arguments that its annotations exclude.

    Those annotations are checked that have texts, words, names of files, truth values, whole and finite numbers alone.

    Raises:
      InputError: naming the argument.
    """

    @functools.cache
    def parameters() -> tuple[list[str], dict[str, tuple[Any, ...]]]:
        names = [name for name, each in inspect.signature(verb).parameters.items() if each.kind != each.KEYWORD_ONLY]
        kinds = {name: _kinds(hint) for name, hint in typing.get_type_hints(verb).items()}
        return names, {name: all_kinds for name, all_kinds in kinds.items() if _EXPECTED.keys() >= {*all_kinds}}

    @functools.wraps(verb)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        names, kinds = parameters()
        for name, value in [*zip(names, arguments, strict=False), *named.items()]:
            allowed, least = kinds.get(name), 0 if name == "seed" else -_LARGEST
            if allowed and not any(_is(kind, value, least) for kind in allowed):
                expected = " or ".join(_EXPECTED[kind] for kind in allowed) + (" from 0 on" if name == "seed" else "")
                raise InputError(f"{name}: expected {expected}, got {ascii(value)[:60]}; correct it")
            if allowed and Path in allowed and value is not None:
                check_name(value)  # type: ignore[arg-type]
        return verb(*arguments, **named)

    return call


_EXPECTED = {bool: "True or False", int: "a whole number", float: "a finite number", str: "a text", Path: "a Path"}
_EXPECTED |= {type(None): "None", Sequence[str]: "texts"}


def _kinds(hint: Any) -> tuple[Any, ...]:
    """Return the kinds of a union; words are texts, which the function itself compares."""
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    kinds = typing.get_args(hint) if is_union else (hint,)
    return tuple(str if typing.get_origin(kind) is typing.Literal else kind for kind in kinds)


def _is(kind: Any, value: Any, least: int) -> bool:
    if kind in (int, float):
        number = numbers.Integral if kind is int else numbers.Real
        return isinstance(value, number) and not isinstance(value, bool) and least <= value < _LARGEST  # type: ignore[operator]
    if kind == Sequence[str]:
        return isinstance(value, Sequence) and all(isinstance(text, str) for text in value)
    return isinstance(value, kind)


def check_name(path: str | Path) -> None:
    """Refuse a name that no file or folder can have, or that can't be reached.

    Raises:
      InputError: saying why.
    """
    try:
        Path(path).stat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        problem = f"can't be a file's name ({getattr(error, 'strerror', None) or error})"
        raise file_error(str(path)[:200], problem, "name another file") from error

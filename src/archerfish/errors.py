"""The error that every bad argument, file or record raises.

One type, so that the command line can print any of them in one line and end with status 2, while a programming fault
keeps its traceback.
"""

import difflib
from collections.abc import Iterable
from pathlib import Path


class InputError(ValueError):
    """Something that was given can't be used: the message names it, what was expected, and what to do."""

    def __init__(self, message: str, code: str | None = None) -> None:
        super().__init__(message)
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

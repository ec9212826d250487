"""The error that every bad argument, file or record raises.

One type, so that the command line can print any of them in one line and exit with status 2, while a programming fault
keeps its traceback.
"""

from pathlib import Path


class InputError(ValueError):
    """Something the user gave can't be used: the message names it, what was expected, and what to do."""


def file_error(path: str | Path, problem: str, remedy: str) -> InputError:
    """Build the error for a file.

    Args:
      path: the file.
      problem: what is wrong, with the line or field and what was expected.
      remedy: what the user can do about it.
    """
    return InputError(f"{path}: {problem}; {remedy}")

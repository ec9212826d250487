"""Options from the words of a command line: tyro's parser, but a fault is one line."""

import inspect
import io
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, TypeVar

import tyro

from archerfish.records.errors import InputError

Options = TypeVar("Options")

_SETTINGS = (tyro.conf.FlagCreatePairsOff,)
_WIDEST = 100


def parse(kind: type[Options], program: str, words: Sequence[str], default: Options | None = None) -> Options:
    """Parse the options of a command; `--help` prints them and exits with status 0.

    Args:
      kind: dataclass whose fields are the options and whose docstring describes the command.
      program: name of the command, as typed.
      words: what follows it.
      default: what options have that are not given; that of their fields if there is none.

    Raises:
      InputError: if an option is unknown or its value can't be used.
    """
    told, shown = io.StringIO(), _Shown()
    try:
        with redirect_stderr(told), redirect_stdout(shown):
            told_apart: dict[str, Any] = {} if default is None else {"default": default}
            options: Options = tyro.cli(
                kind, prog=program, args=list(words), description=description(kind), config=_SETTINGS, **told_apart
            )
            return options
    except SystemExit as ended:
        if not ended.code:
            print(_usage_wrapped(shown.getvalue()), end="")  # noqa: T201
            raise
        raise InputError(f"{one_line(told.getvalue())}; see {program} --help") from None


class _Shown(io.StringIO):
    """Standard output as it is, but kept: tyro never wraps its usage line."""

    def __init__(self) -> None:
        super().__init__()
        self._kept = sys.stdout

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._kept.encoding

    def isatty(self) -> bool:
        return self._kept.isatty()


def _usage_wrapped(shown: str) -> str:
    usage, line_break, rest = shown.partition("\n")
    words = [word.replace(" ", "\0") for word in re.findall(r"\[[^\]]*\]|\S+", usage)]
    width = shutil.get_terminal_size().columns
    wrapped = textwrap.fill(" ".join(words), width, subsequent_indent="  ", break_on_hyphens=False)
    return wrapped.replace("\0", " ") + line_break + rest


def summary(kind: type) -> str:
    """Return the first sentence of a command's docstring."""
    return inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0]


def description(kind: type) -> str:
    """Return a command's docstring, its paragraphs wrapped for the terminal; indented blocks keep their lines."""
    width = min(shutil.get_terminal_size().columns, _WIDEST)
    first, *rest = inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    return "\n".join([first, *(_wrapped(paragraph, width) for paragraph in rest)])


def _wrapped(paragraph: str, width: int) -> str:
    if "\n  " in paragraph:
        return f"\n{paragraph}"
    # tyro joins lines that begin with a letter; bullet and indentation keep the wrapping.
    return textwrap.fill(" ".join(paragraph.split()), width, initial_indent="  • ", subsequent_indent="    ")


def one_line(box: str) -> str:
    """Condense a fault that tyro has drawn as a box: what is wrong, and what it takes for a misspelling.

    Args:
      box: framed with its title in the upper edge; where the terminal has no such characters, title, rule, content.
    """
    rows = [re.sub(r"\x1b\[[0-9;]*m", "", row).strip("│ ") for row in box.splitlines()]
    content = [row for row in rows if row and row[0] not in "╭╰"]
    title_apart = len(content) == len([row for row in rows if row])
    parts = [part.strip().split("\n") for part in re.split(r"^[─-]{3,}$", "\n".join(content), flags=re.MULTILINE)]
    parts = parts[1:] if title_apart and len(parts) > 1 else parts
    message = " ".join(parts[0]).removeprefix("Error parsing ").rstrip(".")
    # A fault that a group of options found by itself reads "group: name must …".
    message = re.sub(r"^(\w+): (\w+) must", lambda found: f"--{found[1]}.{found[2].replace('_', '-')} must", message)
    message = re.sub(r"invalid literal for int\(\) with base 10: ", "expected a whole number, got ", message)
    message = re.sub(r"could not convert string to float: ", "expected a number, got ", message)
    meant = [part[1].split()[0] for part in parts[1:] if part[0].startswith("Perhaps") and len(part) > 1]
    return message + (f"; perhaps you meant {meant[0]}" if meant else "")


def check_file_name(option: str, name: str) -> None:
    """Raise InputError unless the value of an option can begin the names of files in a folder."""
    if not name or Path(name).name != name or name.startswith("."):
        raise InputError(
            f"{option} names files, so it must not be empty, hold a slash or begin with a dot, got {name!r}"
        )

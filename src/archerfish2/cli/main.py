"""The command line: finds the command, prints faults in one line, and ends with the right status."""

import contextlib
import difflib
import importlib
import inspect
import io
import itertools
import os
import shlex
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from archerfish2 import __version__
from archerfish2.cli.signals import Stopped, stop_requests
from archerfish2.errors import InputError, one_line

INPUT_ERROR = 2
_IDENTIFY = ("identify", "identify axis", "identify muzzle", "identify sensing")
_NAMES = ("record", *_IDENTIFY, "excite", "train", "evaluate", "export", "transfer", "reproduce", "sweep", "report")
_CLASSES = {"record": "RecordRobot", "report": "WriteReport"}  # whose usual names are those of other things
COMMANDS = {
    name: (f"archerfish2.cli.{name.replace(' ', '_')}", _CLASSES.get(name, name.title().replace(" ", "")))
    for name in _NAMES
}
"""Command → module and class. Named, not imported: a command waits for the libraries of no other one."""
_OVERVIEW = """\
usage: archerfish2 COMMAND [OPTIONS]

Archerfish {version}: from gimbal logs to a policy that out-shoots classical auto-aim.

commands:
{commands}

archerfish2 COMMAND --help explains a command and its options; archerfish2 --version prints the version.
A fault ends with one line and status 2, Ctrl-C with status 130; neither leaves anything half-written. No command
replaces what it reads, nor, without --overwrite, what it did not write itself."""


def program() -> NoReturn:
    """Run as a program: the arguments of the process, and its exit status."""
    # Many threads make the small matrix products of a robot's model slower; set before NumPy is imported.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        with stop_requests():
            try:
                main(sys.argv[1:])
            finally:
                sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has gone, and Python would flush once more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except Stopped as stopped:
        print(f"archerfish2: {stopped.word}", file=sys.stderr)  # noqa: T201
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(stopped.status)  # the usual end would free what a compiler's threads still use
    sys.exit(0)


def main(arguments: Sequence[str]) -> None:
    """Run a command.

    Args:
      arguments: the command and its options.

    Raises:
      SystemExit: with the status, if it is not 0.
    """
    words = 2 if " ".join(arguments[:2]) in COMMANDS else 1
    name = " ".join(arguments[:words]) or "--help"
    try:
        if name == "--version":
            print(__version__)  # noqa: T201
        elif name in ("--help", "-h"):
            lines = [f"  {each:<17} {_command(each).__doc__.partition(chr(10))[0]}" for each in COMMANDS]
            print(_OVERVIEW.format(version=__version__, commands="\n".join(lines)))  # noqa: T201
        elif name not in COMMANDS:
            near = difflib.get_close_matches(name, COMMANDS, 1)
            meant = f"perhaps you meant {near[0]}" if near else "archerfish2 --help lists them"
            raise InputError(f"there is no command {name!r}, expected one of {', '.join(COMMANDS)}; {meant}")
        else:
            options = arguments[words:]
            _options(name, options).run(shlex.join(options))
    except InputError as error:
        print(f"archerfish2: {one_line(str(error))}", file=sys.stderr)  # noqa: T201
        sys.exit(INPUT_ERROR)


def _options(name: str, arguments: Sequence[str]) -> Any:
    """Return the options of a command; a fault in them, which tyro prints as a box of several lines, becomes one."""
    import tyro

    words: dict[str, Any] = {"prog": f"archerfish2 {name}", "description": inspect.getdoc(_command(name))}
    printed = io.StringIO()
    try:
        with contextlib.redirect_stderr(printed):
            return tyro.cli(_command(name), args=arguments, config=(tyro.conf.FlagCreatePairsOff,), **words)
    except SystemExit as end:
        if not end.code:
            raise
        _, *rows = (line.strip("│ ") for line in printed.getvalue().splitlines())  # a title, the fault, a rule, help
        parts = (list(part) for rule, part in itertools.groupby(rows, lambda row: not row.strip("─-")) if not rule)
        fault = " ".join(next(parts, []))
        raise InputError(f"{fault.rstrip('.')}; archerfish2 {name} --help explains the options") from end


def _command(name: str) -> Any:
    module, options = COMMANDS[name]
    return getattr(importlib.import_module(module), options)

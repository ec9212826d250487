"""The command line: finds the command, prints faults in one line, and ends with the right status."""

import ast
import contextlib
import dataclasses
import errno
import gc
import importlib
import inspect
import io
import itertools
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from archerfish import __version__
from archerfish.cli.options import Ending
from archerfish.cli.signals import Stopped, stop_requests
from archerfish.errors import InputError, meant, one_line

INPUT_ERROR = 2
_IDENTIFY = ("identify", "identify axis", "identify muzzle", "identify sensing")
_NAMES = (
    "record",
    "look",
    *_IDENTIFY,
    "excite",
    "train",
    "evaluate",
    "view",
    "export",
    "rehearse",
    "emulate",
    "deploy",
    "transfer",
    "reproduce",
    "sweep",
    "report",
)
_CLASSES = {
    "record": "RecordRobot",
    "report": "WriteReport",
    "view": "ViewRobot",
}  # whose usual names are those of other things
COMMANDS = {
    name: (f"archerfish.cli.{name.replace(' ', '_')}", _CLASSES.get(name, name.title().replace(" ", "")))
    for name in _NAMES
}
"""Command → module and class. Named, not imported: a command waits for the libraries of no other one."""
_OVERVIEW = """\
usage: archerfish COMMAND [OPTIONS]

Archerfish {version}: from gimbal logs to a policy that out-shoots classical auto-aim.

commands:
{commands}

archerfish COMMAND --help explains a command and its options; archerfish --version prints the version.
A fault ends with one line and status 2, Ctrl-C with status 130; neither leaves anything half-written. No command
replaces what it reads, nor, without --overwrite, what it did not write itself."""


def program() -> NoReturn:
    """Run as a program: the arguments of the process, and its exit status."""
    # Many threads make the small matrix products of a robot's model slower; set before NumPy is imported.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal of another encoding has no place for some characters
            stream.reconfigure(errors="replace")
    try:
        with stop_requests():
            try:
                main(sys.argv[1:])
            finally:
                sys.stdout.flush()
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.ENOSPC):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python would flush once more
        if error.errno == errno.EPIPE:  # the reader of the output has gone
            sys.exit(1)
        print("archerfish: the output can't be written (no space left); free space", file=sys.stderr)  # noqa: T201
        sys.exit(INPUT_ERROR)
    except Stopped as stopped:
        print(f"archerfish: {stopped.word}", file=sys.stderr)  # noqa: T201
        sys.stdout.flush()
        sys.stderr.flush()
        status = stopped.status
    else:
        sys.exit(0)
    gc.collect()  # frees the semaphores of worker processes, of which Python would warn
    os._exit(status)  # the usual end would free what a compiler's threads still use


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
            lines = [f"  {command:<17} {_summary(command)}" for command in COMMANDS]
            print(_OVERVIEW.format(version=__version__, commands="\n".join(lines)))  # noqa: T201
        elif name not in COMMANDS:
            remedy = meant(name, COMMANDS, "archerfish --help lists them")
            raise InputError(f"there is no command {name!r}, expected one of {', '.join(COMMANDS)}; {remedy}")
        else:
            options, begun = arguments[words:], time.monotonic()
            ending = _options(name, options).run(shlex.join(options))
            if ending:
                print(_last_lines(ending, time.monotonic() - begun))  # noqa: T201
    except InputError as error:
        print(f"archerfish: {one_line(str(error))}", file=sys.stderr)  # noqa: T201
        sys.exit(INPUT_ERROR)


def _last_lines(ending: Ending, seconds: float) -> str:
    took = f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.1f} minutes"
    following = f"\nnext: {ending.then}" if ending.then else ""
    return f"{ending.found}\n\n{ending.where} ({took}){following}"


def _options(name: str, arguments: Sequence[str]) -> Any:
    """Return the options of a command; a fault in them, which tyro prints as a box of several lines, becomes one."""
    import tyro

    words: dict[str, Any] = {"prog": f"archerfish {name}", "description": inspect.getdoc(_command(name))}
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
        if fault.startswith("Unrecognized options"):  # whose words tyro joins by commas
            fault = fault.replace(", ", " ")
        known = ["--" + field.name.replace("_", "-") for field in dataclasses.fields(_command(name))]
        unknown = [word for word in arguments if word.startswith("--") and word.partition("=")[0] not in known]
        remedy = meant(unknown[0] if unknown else "", known, f"archerfish {name} --help explains the options")
        raise InputError(f"{fault.rstrip('.')}; {remedy}") from end


def _summary(name: str) -> str:
    """Return the first line of a command's docstring, as its file has it: to import all commands takes seconds."""
    module, options = COMMANDS[name]
    file = Path(__file__).with_name(f"{module.rpartition('.')[2]}.py")
    classes = [part for part in ast.parse(file.read_bytes()).body if isinstance(part, ast.ClassDef)]
    texts = {part.name: ast.get_docstring(part) or "" for part in classes}
    return texts[options].partition("\n")[0]


def _command(name: str) -> Any:
    module, options = COMMANDS[name]
    return getattr(importlib.import_module(module), options)

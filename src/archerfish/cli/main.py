"""The command line: `archerfish COMMAND`, one short file per command.

A command is a frozen dataclass, whose fields are its options, and a function that runs it and returns what --json
writes. This module imports nothing that takes long: signals are answered from the first moment on.
"""

import difflib
import gc
import importlib
import multiprocessing.util
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, redirect_stdout, suppress
from typing import Any, NoReturn

from archerfish import __version__
from archerfish.cli.interrupts import Stopped, stop_requests
from archerfish.records.errors import InputError, one_line

INPUT_ERROR = 2
INTERRUPTED = 130
TERMINATED = 143

COMMANDS = {
    "reproduce": ("archerfish.cli.reproduce", "Reproduce", "run_reproduce"),
    "excite": ("archerfish.cli.excite", "Excite", "run_excite"),
    "record": ("archerfish.cli.record", "Record", "run_record"),
    "range": ("archerfish.cli.range", "Range", "run_range"),
    "identify gimbal": ("archerfish.cli.identify_gimbal", "IdentifyGimbal", "run_gimbal"),
    "identify rigid": ("archerfish.cli.identify_rigid", "IdentifyRigid", "run_rigid"),
    "identify sensing": ("archerfish.cli.identify_sensing", "IdentifySensing", "run_sensing"),
    "identify muzzle": ("archerfish.cli.identify_muzzle", "IdentifyMuzzle", "run_muzzle"),
    "transfer": ("archerfish.cli.transfer", "Transfer", "run_transfer"),
    "train": ("archerfish.cli.train", "Train", "run_train"),
    "sweep": ("archerfish.cli.sweep", "Sweep", "run_sweep"),
    "evaluate": ("archerfish.cli.evaluate", "Evaluate", "run_evaluate"),
    "report": ("archerfish.cli.report", "Report", "run_report"),
    "export": ("archerfish.cli.export", "Export", "run_export"),
    "view": ("archerfish.cli.view", "View", "run_view"),
}
"""Command → module, options, function. Named, not imported: a command waits for the libraries of no other one, and
Ctrl-C while they load is answered like any other."""

_OVERVIEW = """\
usage: archerfish COMMAND [OPTIONS]

Archerfish {version}: from gimbal logs to a policy that out-shoots classical auto-aim.

commands:
{commands}

examples:
  archerfish reproduce --quick
  archerfish identify gimbal sweep.csv step.csv --axis pitch --out runs/my-robot
  archerfish train --command-limit gate --out runs/train
  archerfish evaluate runs/train/policy.json
  archerfish view runs/train

archerfish COMMAND --help tells the options of a command; archerfish --version the version.
A fault ends in one line and status 2, Ctrl-C in status 130, but 0 where it is the way to end (view); neither leaves
anything half-written. No command writes over what it reads, and without --overwrite over what it did not write itself.
A training that was stopped goes on with archerfish train --resume FOLDER."""


def program() -> None:
    """Run as the console script: like `main`, but after Ctrl-C or SIGTERM the process ends at once.

    The usual way out of the interpreter takes down what a compiler's threads still use, and crashes.
    """
    with stop_requests(may_exit=True) as requests:
        try:
            main()
        except SystemExit as ended:
            if ended.code in (INTERRUPTED, TERMINATED):
                _exit(ended.code)
            raise
        requests.at_once = True
        if requests.came:
            _exit(128 + requests.came)
    gc.freeze()  # the interpreter, on its way out, would look through all that is left for cycles
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # The interpreter, on its way out, would drop a KeyboardInterrupt.
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _exit(status: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # the reader has gone
            stream.flush()
    # What it shared with workers is given back, else Python complains.
    multiprocessing.util._exit_function()  # type: ignore[attr-defined]
    os._exit(status)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; a wrong argument or file ends in one line and exit status 2, Ctrl-C in 130, SIGTERM in 143.

    Args:
      arguments: without the program's name; those of the process if not given.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    error: BaseException | None = None
    with stop_requests() as requests:
        try:
            try:
                _answer(words)
                sys.stdout.flush()
            except BaseException as raised:
                error = raised
            requests.settle()
        except Stopped as late:
            error = late
            requests.settle()
        if requests.came and not isinstance(error, Stopped):
            # Dropped or made into another error by a library, or too late for the command to notice.
            error = Stopped(requests.came)
        try:
            _end(error)
        finally:
            del error  # it holds this frame, which holds it


def _end(error: BaseException | None) -> None:
    """Exit with what a command ended by, if that was an error."""
    if isinstance(error, InputError):
        _fail(f"error: {error}" + (f" ({error.code})" if error.code else ""), INPUT_ERROR)
    if isinstance(error, Stopped):
        _fail(error.told, error.status)
    if isinstance(error, KeyboardInterrupt):
        _fail("interrupted; what was unfinished is discarded", INTERRUPTED)
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone; Python would complain once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    if error is not None:
        raise error


def _answer(words: list[str]) -> None:
    if words == ["--version"]:
        print(f"archerfish {__version__}")  # noqa: T201
        return
    for name in COMMANDS:
        length = len(name.split())
        if words[:length] == name.split():
            kind, function = load(name)
            run(_read(kind, f"archerfish {name}", words[length:]), function)
            return
    if words in (["-h"], ["--help"], ["identify", "-h"], ["identify", "--help"]):
        print(overview(words[0] if words[1:] else ""))  # noqa: T201
        return
    found = f"no command {' '.join(words[:2])!r}" if words else "no command given"
    raise InputError(f"{found}, expected one of {', '.join(COMMANDS)}; {_meant(words)}see archerfish --help")


def _meant(words: Sequence[str]) -> str:
    """Return the command that a mistyped one is close to, word by word, as the end of a sentence; empty if none is."""
    names = [name.split() for name in COMMANDS]
    found: list[str] = []
    for word in words[:2]:
        following = {name[len(found)]: None for name in names if len(name) > len(found) and name[: len(found)] == found}
        found += difflib.get_close_matches(word.lower(), following, 1)
    return f"perhaps you meant {' '.join(found)}; " if " ".join(found) in COMMANDS else ""


def _read(kind: type, program: str, words: Sequence[str]) -> Any:
    from archerfish.cli.parsing import parse

    command: Any = parse(kind, program, words)
    # A command that goes on with an earlier one takes the options of that one where the words give none.
    if hasattr(command, "resumed"):
        return command.resumed(lambda default: parse(kind, program, words, default))
    return command


def load(name: str) -> tuple[type, Callable[[Any], dict[str, Any]]]:
    """Return the options of a command and the function that runs it."""
    module, kind, function = COMMANDS[name]
    # What is imported stays: looking for cycles in it, while it grows and ever after, is a tenth of the time.
    collecting = gc.isenabled()
    gc.disable()
    try:
        loaded = importlib.import_module(module)
    finally:
        if collecting:
            gc.enable()
    gc.freeze()
    return getattr(loaded, kind), getattr(loaded, function)


def overview(beginning: str = "") -> str:
    """Return what `archerfish --help` prints, with the commands whose names have a beginning."""
    from archerfish.cli.parsing import summary

    rows = [f"  {name:<17}{summary(load(name)[0])}" for name in COMMANDS if name.startswith(beginning)]
    return _OVERVIEW.format(version=__version__, commands="\n".join(rows))


def run(command: Any, function: Callable[[Any], dict[str, Any]]) -> None:
    """Run a parsed command and write its JSON where it asks for it.

    Args:
      command: its options.
      function: runs it and returns what --json writes.

    Raises:
      InputError: if an argument or a file can't be used.
    """
    from archerfish.cli.json_output import STDOUT, write_json_output
    from archerfish.cli.outputs import check_outputs

    if command.seed not in range(2**32):
        raise InputError(f"--seed must be within 0…{2**32 - 1}, got {command.seed}")
    check_outputs(command)
    # What is printed goes elsewhere, where standard output is to hold JSON and nothing else.
    with redirect_stdout(sys.stderr) if command.json == STDOUT else nullcontext():
        result = function(command)
    if command.json is not None:
        write_json_output(command.json, result)


def _fail(message: str, status: int) -> None:
    print(f"archerfish: {one_line(message)}", file=sys.stderr)  # noqa: T201
    sys.exit(status)

"""The command line: `archerfish COMMAND`, one short file per command.

A command is a frozen dataclass, whose fields are its options, and a function that runs it and returns what --json writes.
"""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from archerfish import __version__
from archerfish.cli.evaluate import Evaluate, run_evaluate
from archerfish.cli.identify import IdentifyGimbal, IdentifyMuzzle, run_gimbal, run_muzzle
from archerfish.cli.report import Report, run_report
from archerfish.cli.reproduce import Reproduce, run_reproduce
from archerfish.cli.train import Train, run_train
from archerfish.records import storage
from archerfish.records.errors import InputError

INPUT_ERROR = 2
INTERRUPTED = 130


@dataclass(frozen=True)
class Identify:
    """Identify a gimbal axis or the muzzle from logs."""

    what: Annotated[IdentifyGimbal, tyro.conf.subcommand("gimbal")] | Annotated[
        IdentifyMuzzle, tyro.conf.subcommand("muzzle")
    ]


Command = (
    Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[Identify, tyro.conf.subcommand("identify")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Report, tyro.conf.subcommand("report")]
)

RUNNERS: dict[type, Callable[[Any], dict[str, Any]]] = {
    Reproduce: run_reproduce,
    IdentifyGimbal: run_gimbal,
    IdentifyMuzzle: run_muzzle,
    Train: run_train,
    Evaluate: run_evaluate,
    Report: run_report,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; a wrong argument or file ends in one line and exit status 2, Ctrl-C in 130.

    Args:
      arguments: without the program's name; those of the process if not given.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments == ["--version"]:
        print(f"archerfish {__version__}")  # noqa: T201
        return
    try:
        command = tyro.cli(
            Command,  # type: ignore[arg-type]
            prog="archerfish",
            description=f"Archerfish {__version__}: from gimbal logs to a policy that out-shoots classical auto-aim.",
            args=arguments,
            config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes),
        )
        run(command.what if isinstance(command, Identify) else command)
    except InputError as error:
        _fail(f"error: {error}", INPUT_ERROR)
    except KeyboardInterrupt:
        _fail("interrupted; nothing was written", INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone; Python would complain once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def run(command: Any) -> None:
    """Run a parsed command and write its JSON where it asks for it.

    Raises:
      InputError: if an argument or a file can't be used.
    """
    path: Path | None = command.json
    if path is not None:
        storage.check_writable(path.parent)
    result = RUNNERS[type(command)](command)
    if path is not None:
        storage.write_json(path, result)


def _fail(message: str, status: int) -> None:
    print(f"archerfish: {message}", file=sys.stderr)  # noqa: T201
    sys.exit(status)

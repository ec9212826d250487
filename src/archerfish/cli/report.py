"""`archerfish report`: the page of a run, made anew from its results alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from archerfish.cli.options import JsonFile
from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import read_results


@dataclass(frozen=True)
class Report:
    """Render report.html anew from the results.json of a run.

    The page and its figures (figures/*.svg beside it) are made from that file alone; nothing is computed again.

    Examples:
      archerfish report runs/reproduce
      archerfish report runs/evaluate --out evaluate.html
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """Run folder that holds results.json."""
    out: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="(default: report.html in the run folder)")
    ] = None
    """File to write."""
    seed: int = 0
    """Not used; the seed of the run is in its results."""
    json: JsonFile = None
    """Also write what is printed to this file."""


def run_report(command: Report) -> dict[str, Any]:
    """Write the page, print where, and return what --json writes.

    Raises:
      InputError: if the folder holds no results or the page can't be written.
    """
    path = command.out or command.run / "report.html"
    write_report(read_results(command.run / "results.json"), path)
    Console().print(f"report: {path}")
    return {"report": str(path)}

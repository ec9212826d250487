"""`archerfish report`: the page of a run, made anew from its results alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import read_results


@dataclass(frozen=True)
class Report:
    """Render report.html anew from the results.json of a run."""

    run: tyro.conf.Positional[Path]
    """Run folder that holds results.json."""
    out: Path | None = None
    """File to write. [report.html in the run folder]"""
    seed: int = 0
    """Not used; the seed of the run is in its results."""
    json: Path | None = None
    """Also write what is printed to this file."""


def run_report(command: Report) -> dict[str, Any]:
    """Write the page, print where, and return what --json writes.

    Raises:
      InputError: if the folder holds no results or the page can't be written.
    """
    from rich.console import Console  # noqa: PLC0415

    path = command.out or command.run / "report.html"
    write_report(read_results(command.run / "results.json"), path)
    Console().print(f"report: {path}")
    return {"report": str(path)}

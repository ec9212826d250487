"""`archerfish report`: the page of a run, made anew from its results alone."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from archerfish.cli.options import JsonFile
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.run_folder import run_folder
from archerfish.cli.written_files import find_written
from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import read_results

RESULTS = "results.json"


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
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        page = _page(self)
        files, named = ((page,), ()) if self.out is None else ((), (page,))
        return Outputs(files, (page.parent / "figures",), named, owner=_owner(self))


def run_report(command: Report) -> dict[str, Any]:
    """Write the page, print where, and return what --json writes.

    Raises:
      InputError: if the folder holds no results or the page can't be written.
    """
    path, results = _page(command), read_results(command.run / RESULTS)
    with run_folder(path.parent, make_writer(command)) as folder:
        write_report(results, folder / path.name, path.parent)
    Console().print(f"report: {path}")
    return {"report": str(path)}


def _page(command: Report) -> Path:
    return command.out or command.run / "report.html"


def _owner(command: Report) -> str:
    """Return the command whose run the page belongs to; none where the page is put elsewhere, or nobody knows."""
    results = command.run / RESULTS
    if not results.is_file() or _page(command).parent.resolve() != command.run.resolve():
        return ""
    written = find_written(results)
    return written.command if written else ""
